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

from benchmarks.thin.meshes import rectangle
from benchmarks.thin.touching import block, folded, two_blocks
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
    if radius is not None:
        return folded(CELLS, SIZE, THICKNESS, radius, turn)
    return shell_body(*rectangle(CELLS, SIZE, THICKNESS / 2), THICKNESS, 300.0)


def rope() -> Body:
    """Two hundred segments in a coil whose turns lie beside each other."""
    turn = np.linspace(0.0, 10 * np.pi, 201)
    radius = 0.02 + 0.0105 * turn / (2 * np.pi)
    x = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(201, 0.005)], 1)
    return rod_body(x, 0.005, 600.0)


def blocks(count: int) -> Body:
    """Two thousand particles in one block, or in two that lie on each other."""
    spacing = 0.008
    if count == 2:
        return two_blocks(spacing, (10, 10, 10), (10, 10, 10), (0.3 * spacing, 0.4 * spacing), 0.1 * spacing)
    x0 = block((10, 10, 20), spacing, (0.0, 0.0, 0.0))
    return Body(x0, np.full(len(x0), spacing**3), np.full(len(x0), 300.0), spacing)


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
