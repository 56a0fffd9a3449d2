"""What the hand's record does to a body that it swings: `python -m benchmarks.hand_record [--out FILE]`

A bar of 500 particles is led through the benchmark's four motions. Its truth is a rollout with the exact path at 240
frames/s. Beside it stand rollouts with a record at the stated frame rate and error: led along straight lines between
frames, along the simulator's cubics, and along cubics through the estimated path. Prints a markdown table of distances
from the truth, root mean square over particles, frames, motions and `--seeds` [mm].

"Less what is open": with what the modes of `estimate_hand` stand for taken out of the estimated path's error, so what
a search for missing effects might take for an effect.
"""

from __future__ import annotations

import argparse
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.fitting.hand_record import estimate_hand
from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator

if TYPE_CHECKING:
    from data.rig.rig_scene import Motion

COUNTS, SPACING, DENSITY = (20, 5, 5), 0.01, 200.0
MATERIAL = {"youngs_modulus": 4e4, "poissons_ratio": 0.3, "friction_coefficient": 0.4}
GRIP = {"grip_stiffness": 20.0, "grip_damping": 0.01}
FINE, SECONDS = 240, 2.0
FRAME_RATES = (24, 30, 60)
ERRORS = (0.0, 0.0003, 0.0006)
"""Of the record along each axis, standard deviation [m]."""
WAYS = ("straight lines", "cubics", "estimated", "less what is not known")


def held_bar() -> tuple[Body, Grip, Float[Array, "points 3"]]:
    """The bar on the ground, its bonds at one end, and the hand's points at frame 0 [m]."""
    index = np.stack(np.meshgrid(*map(np.arange, COUNTS), indexing="ij"), -1).reshape(-1, 3)
    x0 = (index + 0.5) * SPACING
    body = Body(x0, np.full(len(x0), SPACING**3), np.full(len(x0), DENSITY), SPACING)
    points = np.array([[0.0, y, z] for y in (0.0, 0.05) for z in (0.0, 0.05)])
    held = np.flatnonzero(x0[:, 0] < 3 * SPACING)
    lengths = np.linalg.norm(x0[held][:, None] - points, axis=-1)
    pairs = np.repeat(held, 4), np.tile(np.arange(4), len(held)), np.full(4 * len(held), 0.25), lengths.ravel()
    return body, Grip(*pairs), points


def led(path: Float[Array, "frames 3"], fps: float) -> Float[Array, "frames particles 3"]:
    """Where the bar goes [m] with the hand on a path [m]."""
    body, grip, points = held_bar()
    simulator = Simulator(body, SimulationConfig(fps=fps, courant=0.7), grip)
    given = Parameters(**{name: torch.tensor(value) for name, value in (MATERIAL | GRIP).items()})
    with torch.no_grad():
        return simulator.rollout(given, torch.from_numpy(points + path[:, None])).x.double().numpy()


def compared(
    motion: Callable[[np.random.Generator], Motion], seed: int, fps: int, error: float
) -> tuple[dict[str, float], float]:
    """Mean square distance from the truth by way [m2], and the learnt error of the record [m]."""
    from data.rig.recording import HAND_SECONDS, lasting

    random = np.random.default_rng([seed, fps])
    fine = motion(random).displacement(np.arange(round(SECONDS * FINE) + 1) / FINE)
    step = FINE // fps
    truth, true_path = led(fine, FINE)[::step], fine[::step]
    off = error * lasting(true_path.shape, np.exp(-1 / (HAND_SECONDS * fps)), random)
    record = true_path + off - off[0]
    found = estimate_hand(np.repeat(record[:, None], 4, axis=1), fps)
    estimated = found.controllers[:, 0]
    at = np.arange(len(fine)) / step
    lines = np.stack([np.interp(at, np.arange(len(record)), axis) for axis in record.T], 1)
    paths = {
        "cubics": record,
        "estimated": estimated,
        "less what is not known": estimated - _along(found.modes, estimated - true_path),
    }
    moved = {"straight lines": led(lines, FINE)[::step]} | {way: led(path, fps) for way, path in paths.items()}
    return {way: float(((x - truth) ** 2).sum(-1).mean()) for way, x in moved.items()}, found.error


def _along(modes: Float[Array, "modes frames"], error: Float[Array, "frames 3"]) -> Float[Array, "frames 3"]:
    """The part of an error that the modes span."""
    basis, _ = np.linalg.qr(modes.T)
    return basis @ (basis.T @ error)


def main() -> None:
    from data.rig.motions import MOTIONS  # not at the top: a machine without the rig's packages imports this, too

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--out", type=Path, default=None)
    args = parser.parse_args()
    lines = [f"| frames/s | error | learnt | {' | '.join(WAYS)} |", "|--:|--:|--:|" + "--:|" * len(WAYS)]
    for fps in FRAME_RATES:
        for error in ERRORS:
            squares, learnt = defaultdict(list), []
            for motion in MOTIONS.values():
                for seed in range(args.seeds):
                    found, size = compared(motion, seed, fps, error)
                    learnt.append(size)
                    for way, square in found.items():
                        squares[way].append(square)
            row = " | ".join(f"{1e3 * np.sqrt(np.mean(squares[way])):.2f}" for way in WAYS)
            lines.append(f"| {fps} | {1e3 * error:.1f} | {1e3 * np.exp(np.log(learnt).mean()):.2f} | {row} |")
            print(lines[-1], flush=True)
    if args.out:
        head = f"# The hand's record\n\n`python -m benchmarks.hand_record`: {len(MOTIONS) * args.seeds} records a row; all numbers in mm."
        args.out.write_text("\n".join([head, "", *lines, ""]))


if __name__ == "__main__":
    main()
