"""What a limit of the membrane's stiffness does to a cloth's motion and its steps: `python -m benchmarks.thin.stretch_limit [--out FOLDER]`

A cotton cloth is lifted by a corner from the ground, and swings from two corners. Each is simulated with several stretch limits; written are
substeps, seconds, and how far vertices are from those without a limit. Writes thin_stretch_limit.md.
"""

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from benchmarks.thin.meshes import rectangle
from benchmarks.thin.results import RESULTS
from physreal_core.simulation import Grip, Parameters, SimulationConfig, Simulator, shell_body

SIDE, CELLS, THICKNESS, DENSITY = 0.3, 20, 5e-4, 400.0
STIFFNESS = 2000.0
"""Of the membrane [N/m], as of a cotton weave."""
BENDING = 1e-5
"""[N m]"""
LIMITS = (0.02, 0.01, 0.005, 0.0025, 0.001, None)
FPS, SECONDS = 30.0, 1.2


@dataclass(frozen=True)
class Motion:
    """How the hands move: which corners they hold and where they are after so many seconds."""

    name: str
    corners: tuple[int, ...]
    lift: float
    aside: float


MOTIONS = (Motion("lifted by a corner", (0,), 0.25, 0.1), Motion("swung by two corners", (0, 1), 0.35, 0.15))


def run(motion: Motion, limit: float | None) -> tuple[np.ndarray, int, float]:
    """Places of the vertices at frame times [m], substeps a frame, and seconds that it took."""
    vertices, triangles = rectangle((CELLS, CELLS), (SIDE, SIDE), THICKNESS / 2.0)
    body = shell_body(vertices, triangles, THICKNESS, DENSITY, stretch_limit=limit)
    E = STIFFNESS / THICKNESS
    ratio = BENDING / (E * THICKNESS**3 / 12.0)
    corners = np.array([0, CELLS])[list(motion.corners)]
    held, owner = _around(vertices, corners)
    points = vertices[corners] + [0.0, 0.0, 0.01]
    grip = Grip(held, owner, np.ones(len(held)) / 3.0, np.linalg.norm(vertices[held] - points[owner], axis=1))
    simulator = Simulator(body, SimulationConfig(fps=FPS, terms=("bending", "fabric", "drag")), grip)
    frames = int(SECONDS * FPS)
    share = np.clip(np.arange(frames) / (0.6 * frames), 0.0, 1.0)
    share = share**2 * (3.0 - 2.0 * share)
    path = points[None] + share[:, None, None] * np.array([motion.aside, 0.0, motion.lift])
    number = lambda value: torch.tensor(float(value))
    parameters = Parameters(
        number(E), number(0.0), number(0.5), number(20.0), number(0.05),
        bending_ratio=number(ratio), shear_ratio=number(0.1), linear_drag=0.5 * torch.tensor(body.mass),
    )  # fmt: skip
    begun = time.perf_counter()
    with torch.no_grad():
        states = simulator.rollout(parameters, torch.tensor(path))
    return states.x.numpy(), simulator.substeps(parameters), time.perf_counter() - begun


def _around(vertices: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The three vertices nearest to each corner, and which corner's they are."""
    nearest = [np.argsort(((vertices - vertices[c]) ** 2).sum(1))[:3] for c in corners]
    return np.concatenate(nearest), np.repeat(np.arange(len(corners)), 3)


def _apart(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Mean distance of the vertices in every frame [mm]."""
    return 1e3 * np.linalg.norm(one - other, axis=-1).mean(1)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=RESULTS)
    out = parser.parse_args().out
    torch.set_num_threads(1)
    lines = [
        "# A limit of the membrane's stiffness",
        "`python -m benchmarks.thin.stretch_limit` (one thread, float32)",
        "",
        f"A cloth of {SIDE:g} m, {DENSITY * THICKNESS:g} kg/m2, {STIFFNESS:g} N/m and {BENDING:g} N m, {2 * CELLS**2} triangles, over {SECONDS:g} s at {FPS:g} frames/s.",
        "Distances are of vertices from those without a limit, and beside them from those with half of the limit.",
        "",
        "| motion | limit | substeps | seconds | mean distance | largest mean of a frame | mean distance to half the limit |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for motion in MOTIONS:
        found = {limit: run(motion, limit) for limit in LIMITS}
        for limit, finer in zip(LIMITS, (*LIMITS[1:], None), strict=True):
            apart, to_finer = (_apart(found[limit][0], found[other][0]) for other in (None, finer))
            shown = "none" if limit is None else f"{100 * limit:g} %"
            lines.append(
                f"| {motion.name} | {shown} | {found[limit][1]} | {found[limit][2]:.1f} | {apart.mean():.2f} mm |"
                f" {apart.max():.2f} mm | {to_finer.mean():.2f} mm |"
            )
            print(lines[-1], flush=True)
    out.mkdir(parents=True, exist_ok=True)
    (out / "thin_stretch_limit.md").write_text("\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
