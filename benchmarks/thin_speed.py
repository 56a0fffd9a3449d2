"""Speed of shells and rods beside volumes: `python -m benchmarks.thin_speed --device cpu|cuda:0 [--quick] [--json FILE]`

A cloth of 2 000 triangles beside a block of 2 000 particles, and a rope of 200 segments beside a block of 200: each falls, lies on the
ground with friction, and is held by two moving points at its first vertices or particles. Their moduli are such that a frame takes 50
substeps. Runs of a pair take turns, so that a busy machine hits both alike. A run is a whole rollout, or a rollout and the gradient by
Young's modulus of every vertex or particle; alone, and 64 at once with moduli of their own. Prints the time of one substep of one
rollout and the ratio of thin to volume: medians, on the CPU of processor time (one thread for a rollout), on a GPU of wall time.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median

import numpy as np
import torch

from benchmarks.simulation import machine
from benchmarks.thin.results import write_part
from benchmarks.thin_scenes import sheet
from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator, rod_body, shell_body
from physreal_core.simulation.timestep import needed_substeps

SPACING, DENSITY, FPS = 0.01, 300.0, 30  # m, kg/m3, 1/s
SUBSTEPS = 50  # of a frame
SOFTEST = 0.8  # of the moduli of a batch, as a share of the stiffest
ROLLOUTS = 64
WORK = ("forward", "gradient")


def cloth() -> Body:
    """2 000 triangles, 1 066 vertices."""
    return shell_body(*sheet((25, 40), (25 * SPACING, 40 * SPACING), 0.005), 0.002, DENSITY)


def rope() -> Body:
    """200 segments, 201 vertices."""
    along = SPACING * np.arange(201)
    return rod_body(np.stack([along, 0 * along, 0 * along + 0.005], 1), 0.004, DENSITY)


def block(*counts: int) -> Body:
    """Particles of a block on the ground."""
    index = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3)
    count = len(index)
    return Body((index + 0.5) * SPACING, np.full(count, SPACING**3), np.full(count, DENSITY), SPACING)


PAIRS = {
    "cloth of 2 000 triangles": (cloth, "block of 2 000 particles", lambda: block(10, 10, 20)),
    "rope of 200 segments": (rope, "block of 200 particles", lambda: block(5, 5, 8)),
}


class Runs:
    """A body in the scene, and how long rollouts of it take.

    Args:
        body: thin or a volume.
        device: "cpu" or "cuda:0".
        frames: of a rollout.
        rollouts: at once.
    """

    def __init__(self, body: Body, device: str, frames: int, rollouts: int) -> None:
        held = np.arange(10)
        points = body.x0[[0, 9]] + np.array([-0.01, -0.01, 0.02])
        lengths = np.linalg.norm(body.x0[held] - points[held % 2], axis=1)
        config = SimulationConfig(fps=FPS, device=device)
        self._simulator = Simulator(body, config, Grip(held, held % 2, np.ones(10), lengths))
        self._frames, self._rollouts, self._device = frames, rollouts, device
        path = torch.arange(frames + 1)[:, None, None] * torch.tensor([0.0, 0.001, 0.002])
        self._points = (torch.as_tensor(points, dtype=torch.float32) + path).to(device)
        guess = Parameters(
            torch.full((len(body.x0),), 1e5, device=device), torch.full((len(body.x0),), 0.3, device=device)
        )
        stiffest = 1e5 * (0.999 * SUBSTEPS / needed_substeps(body, config, guess)) ** 2
        shares = torch.linspace(SOFTEST, 1.0, rollouts) if rollouts > 1 else torch.ones(1)
        self._moduli = (stiffest * shares[:, None]).expand(-1, len(body.x0)).to(device)
        assert self._simulator.substeps(self._parameters(self._moduli[-1])) == SUBSTEPS

    def _parameters(self, E: torch.Tensor) -> Parameters:
        grip = {"grip_stiffness": torch.tensor(0.3), "grip_damping": torch.tensor(0.005)}
        return Parameters(E, torch.tensor(0.3), friction_coefficient=torch.tensor(0.4), **grip)

    def seconds(self, what: str) -> float:
        """Of one substep of one rollout; what: of `WORK`."""
        E = self._moduli.clone().requires_grad_(what == "gradient")
        clock = time.process_time if self._device == "cpu" else time.perf_counter
        began = clock()
        with torch.set_grad_enabled(what == "gradient"):
            if self._rollouts == 1:
                x = self._simulator.rollout(self._parameters(E[0]), self._points).x
            else:
                states = self._simulator.rollout_batch(self._parameters(E), self._points)
                if any(states.failures):
                    raise SystemExit(f"a rollout failed: {states.failures}")
                x = states.x
        if what == "gradient":
            x.square().sum().backward()
            float(E.grad[0, 0])  # waits for the device
        float(x[..., -1, 0, 0].detach().sum())
        return (clock() - began) / (self._rollouts * self._frames * SUBSTEPS)


def measured(
    pair: dict[str, Callable[[], Body]], device: str, frames: int, rollouts: int, rounds: int
) -> dict[str, dict]:
    """Median seconds of a substep by body and kind of work; the bodies take turns."""
    runs = {name: Runs(make(), device, frames, rollouts) for name, make in pair.items()}
    found = {name: {what: [] for what in WORK} for name in runs}
    for attempt in range(rounds + 1):
        for what in WORK:
            for name, run in runs.items():
                taken = run.seconds(what)
                if attempt:  # the first one compiles
                    found[name][what].append(taken)
    return {name: {what: median(taken) for what, taken in times.items()} for name, times in found.items()}


def report(device: str, frames: int, rounds: int) -> dict:
    """Prints the table; times [s] and ratios by thin body and number of rollouts."""
    print("| rollouts | body | vertices or particles | forward [µs] | with gradient [µs] | forward | with gradient |")
    print("|--:|---|--:|--:|--:|--:|--:|", flush=True)
    ratios, seconds = {}, {}
    for thin, (make_thin, volume, make_volume) in PAIRS.items():
        pair = {thin: make_thin, volume: make_volume}
        for rollouts in (1, ROLLOUTS):
            times = measured(pair, device, frames, rollouts, rounds)
            ratio = {what: times[thin][what] / times[volume][what] for what in WORK}
            ratios.setdefault(thin, {})[str(rollouts)] = ratio
            seconds.setdefault(thin, {})[str(rollouts)] = times
            for name, make in pair.items():
                shown = [f"{1e6 * times[name][what]:.3g}" for what in WORK]
                shown += [f"{ratio[what]:.2f}" if name == thin else "1" for what in WORK]
                print(f"| {rollouts} | {name} | {len(make().x0)} | {' | '.join(shown)} |", flush=True)
    return {"speed_ratio": ratios, "seconds_of_a_substep": seconds}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cpu", help="cpu or cuda:0")
    parser.add_argument("--quick", action="store_true", help="10 frames and 3 rounds")
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--rounds", type=int, default=7, help="measurements of each body")
    parser.add_argument("--json", type=Path, help="write the numbers there as well")
    args = parser.parse_args()
    if args.device == "cpu":
        torch.set_num_threads(1)
    frames, rounds = (10, 3) if args.quick else (args.frames, args.rounds)
    print(f"{machine(args.device)}; {frames} frames of {SUBSTEPS} substeps, {rounds} rounds\n")
    result = {"machine": machine(args.device), "device": args.device, "frames": frames, "rounds": rounds}
    result |= report(args.device, frames, rounds)
    if args.json:
        args.json.write_text(json.dumps(result, indent=2) + "\n")
        kind = "cpu" if args.device == "cpu" else "gpu"
        write_part(f"speed_ratio_{kind}", result["speed_ratio"], args.json.parent)


if __name__ == "__main__":
    main()
