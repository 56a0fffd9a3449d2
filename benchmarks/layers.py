"""What contact of a body with itself costs: a cloth of 2000 triangles, level and folded in half at rest, a rope, and 2000 particles of a
volume, one block or two that lie on each other.

    python -m benchmarks.layers [threads]
    python -m benchmarks.layers --device cuda:0 [--rollouts 64]

It prints substeps a frame and the time of one frame, forward and with the gradient. On the CPU it is the median of the last frames: with one
thread processor time, so that other work on the machine counts less, with more of them wall time. On a card it is the mean over the frames of
a second rollout.
"""

import argparse
import statistics
import time
from dataclasses import replace

import numpy as np
import torch

from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator, rod_body, shell_body

THICKNESS = 0.002
CELLS, SIZE = (50, 20), (0.4, 0.16)
FRAMES, TIMED = 24, 8


def cloth(radius: float | None, turn: float = 0.0) -> Body:
    """A rectangle of 2000 triangles on the ground, folded in half with this radius [m], or level.

    Args:
        radius: of the fold.
        turn: of the fold's line against the mesh [rad], so that the layers' vertices do not lie on each other.
    """
    u, v = np.meshgrid(*(np.linspace(-s / 2, s / 2, n + 1) for s, n in zip(SIZE, CELLS, strict=True)), indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    rest = np.stack([u.ravel(), v.ravel(), np.full(u.size, THICKNESS / 2)], 1)
    if radius is None:
        return shell_body(rest, triangles, THICKNESS, 300.0)
    along = np.array([np.cos(turn), np.sin(turn), 0.0])
    s = rest @ along
    angle = np.clip(s / radius + np.pi / 2, 0.0, np.pi)
    beyond = s - np.clip(s, -np.pi * radius / 2, np.pi * radius / 2)
    start = rest + (radius * np.sin(angle) - np.abs(beyond) - s)[:, None] * along
    start[:, 2] += radius * (1 - np.cos(angle))
    return shell_body(start, triangles, THICKNESS, 300.0, rest)


def rope() -> Body:
    """Two hundred segments in a coil whose turns lie beside each other."""
    turn = np.linspace(0.0, 10 * np.pi, 201)
    radius = 0.02 + 0.0105 * turn / (2 * np.pi)
    x = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(201, 0.005)], 1)
    return rod_body(x, 0.005, 600.0)


def blocks(count: int) -> Body:
    """Two thousand particles in so many blocks that lie on each other."""
    spacing, heights = 0.008, 20 // count
    cells = np.stack(np.meshgrid(np.arange(10), np.arange(10), np.arange(heights), indexing="ij"), -1).reshape(-1, 3)
    x0 = np.concatenate([spacing * (cells + 0.5 + [0.3 * n, 0.4 * n, 1.01 * heights * n]) for n in range(count)])
    pieces = np.repeat(np.arange(count), len(cells))
    return Body(x0, np.full(len(x0), spacing**3), np.full(len(x0), 300.0), spacing, pieces=pieces)


def scene(body: Body, contact: bool, device: str) -> tuple[Simulator, Parameters]:
    """What is simulated."""
    terms = ("drag",) if body.elements is None else ("drag", "bending")
    simulator = Simulator(body, SimulationConfig(fps=30, self_contact=contact, terms=terms, device=device))
    parameters = Parameters(
        torch.tensor(1e5, requires_grad=True), torch.tensor(0.3), torch.tensor(0.4),
        linear_drag=torch.tensor(3.0) * torch.tensor(body.mass).float(),
        bending_ratio=torch.tensor(0.05) if "bending" in terms else None,
        layer_friction=torch.tensor(0.4) if contact else None,
    )  # fmt: skip
    return simulator, parameters


def run(body: Body, contact: bool) -> tuple[int, float, float]:
    """Substeps a frame, and milliseconds of a frame on the CPU, forward and with the gradient."""
    simulator, parameters = scene(body, contact, "cpu")
    stamps: list[float] = []
    clock = time.process_time if torch.get_num_threads() == 1 else time.perf_counter
    states = simulator.rollout(parameters, torch.zeros(FRAMES + 1, 0, 3), progress=lambda *_: stamps.append(clock()))
    forward = statistics.median(np.diff(stamps)[-TIMED:])
    stamps.clear()
    states.x[-1].square().sum().backward()
    backward = statistics.median(np.diff(stamps)[:TIMED])
    return simulator.substeps(parameters), 1e3 * forward, 1e3 * (forward + backward)


def run_on_card(body: Body, contact: bool, device: str, rollouts: int) -> tuple[int, float, float]:
    """Substeps a frame, and milliseconds of a frame of all rollouts, forward and with the gradient."""
    simulator, parameters = scene(body, contact, device)
    many = replace(parameters, youngs_modulus=torch.full((rollouts, 1), 1e5, requires_grad=True))
    for _ in range(2):  # the first one compiles
        begun = time.perf_counter()
        states = simulator.rollout_batch(many, torch.zeros(FRAMES + 1, 0, 3))
        torch.cuda.synchronize()
        forward = time.perf_counter() - begun
        states.x[:, -1].square().sum().backward()
        torch.cuda.synchronize()
        whole = time.perf_counter() - begun
    return simulator.substeps(parameters), 1e3 * forward / FRAMES, 1e3 * whole / FRAMES


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("threads", nargs="?", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--rollouts", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    on_card = args.device != "cpu"
    bodies = {
        "cloth, level": cloth(None),
        "cloth, folded, layers' vertices on each other": cloth(0.0012),
        "cloth, folded askew": cloth(0.0012, 0.3),
        "rope, coiled": rope(),
        "volume, one block": blocks(1),
        "volume, two blocks on each other": blocks(2),
    }
    if on_card:
        print(f"{torch.cuda.get_device_name(args.device)}, {args.rollouts} rollouts at once\n")
    print("| body | substeps | ms a frame | ms with the gradient |\n|---|---|---|---|")
    for name, body in bodies.items():
        without, touching = (
            run_on_card(body, contact, args.device, args.rollouts) if on_card else run(body, contact)
            for contact in (False, True)
        )
        cells = (f"{a:.3g} → {b:.3g} ({b / a:.2f})" for a, b in zip(without, touching, strict=True))
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
