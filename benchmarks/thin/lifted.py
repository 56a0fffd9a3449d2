"""The rig's lift of a cloth by our shell with the same numbers: `python -m benchmarks.thin.lifted [--out FOLDER]`

Mesh, hold, stiffnesses, mass and path of the hand are MuJoCo's. What varies is how finely our sheet is cut, its stretch limit, its damping and
its friction; the true friction should follow the cloth best. Writes thin_lifted.md.
"""

import argparse
import time
from collections.abc import Iterator
from itertools import product
from pathlib import Path

import numpy as np
import torch

from benchmarks.thin.results import RESULTS
from data.rig.thin_scenes import CLOTH, cloth_lift
from data.rig.thin_simulate import run
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array, Float, Int
from physreal_core.fitting.grip import springs
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator, shell_body

CUTS = (0, 1)
"""How often each of MuJoCo's triangles is cut into four."""
LIMITS, FRICTIONS = (0.005, 0.001, None), (0.2, 0.3, 0.4)
HOLD, HOLD_DAMPING, COURANT = 1e4, 0.01, 0.7
"""Stiffness [N] and damping [N s/m] of a vertex' bonds, and the Courant number."""


def main() -> None:
    """Roll out every case and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=RESULTS)
    out = parser.parse_args().out
    torch.set_num_threads(1)
    truth = run(cloth_lift())
    lines = [*_head(), *_rows(truth)]
    out.mkdir(parents=True, exist_ok=True)
    (out / "thin_lifted.md").write_text("\n".join(lines) + "\n")


def _head() -> list[str]:
    true, frictions = cloth_lift().material.friction_coefficient, ", ".join(f"{value:g}" for value in FRICTIONS)
    return [
        "# The rig's cloth, lifted by our shell",
        "`python -m benchmarks.thin.lifted` (one thread, float32)",
        "",
        "`cloth_lift` with MuJoCo's own mesh (8 mm; in rows of 4 mm each triangle is cut into four), hold, mass, stiffnesses and path of the hand.",
        f"Distances are means over MuJoCo's nodes, of the 42 observed frames / of the 18 after them, with a friction of {frictions}; true is {true:g}.",
        "",
        "| spacing | stretch limit | damping | "
        + " | ".join(f"friction {value:g}" for value in FRICTIONS)
        + " | seconds |",
        "|--:|--:|--:|" + "--:|" * (len(FRICTIONS) + 1),
    ]


def _rows(truth: Trajectory) -> Iterator[str]:
    for cuts, limit, damping in product(CUTS, LIMITS, (0.0, CLOTH.damping)):
        body, held = sheet(truth, cuts, limit)
        begun = time.perf_counter()
        errors = [distances(truth, body, held, friction, damping) for friction in FRICTIONS]
        seconds = (time.perf_counter() - begun) / len(FRICTIONS)
        observed = cloth_lift().observed
        cells = [f"{e[:observed].mean():.1f} / {e[observed:].mean():.1f} mm" for e in errors]
        shown = "none" if limit is None else f"{100 * limit:g} %"
        row = f"| {1e3 * body.spacing:.1f} mm | {shown} | {1e3 * damping:g} ms | {' | '.join(cells)} | {seconds:.0f} |"
        print(row, flush=True)
        yield row


def sheet(truth: Trajectory, cuts: int, limit: float | None) -> tuple[Body, Int[Array, " held"]]:
    """MuJoCo's middle surface in frame 0, finer, whose first vertices are its nodes; and the vertices that the hand holds."""
    middle = truth.middle
    start, rest, triangles = middle.vertices[0].astype(float), middle.rest.astype(float), middle.elements
    lower, upper = (bound(start[middle.gripped, :2], axis=0) for bound in (np.min, np.max))
    for _ in range(cuts):
        edges, triangles = _cut(triangles, len(start))
        start, rest = (np.concatenate([x, x[edges].mean(axis=1)]) for x in (start, rest))
    body = shell_body(start, triangles, CLOTH.thickness, CLOTH.density, rest, stretch_limit=limit)
    inside = (start[:, :2] > lower - 1e-4) & (start[:, :2] < upper + 1e-4)
    return body, np.flatnonzero(inside.all(axis=1))


def _cut(triangles: Int[Array, "F 3"], vertices: int) -> tuple[Int[Array, "E 2"], Int[Array, "G 3"]]:
    """The edges, in whose middles new vertices come after the old ones, and four triangles for each."""
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=-1)
    edges, number = np.unique(sides.reshape(-1, 2), axis=0, return_inverse=True)
    a, b, c = (vertices + number.reshape(-1, 3)).T
    p, q, r = triangles.T
    parts = [(p, a, c), (a, q, b), (c, b, r), (a, b, c)]
    return edges, np.concatenate([np.stack(part, axis=1) for part in parts])


def distances(
    truth: Trajectory, body: Body, held: Int[Array, " held"], friction: float, damping: float
) -> Float[Array, "frames nodes"]:
    """From each of MuJoCo's nodes to our vertex there [mm]."""
    points = _around(body.x0[held])
    grip = springs(body.x0, held, points, body.spacing, len(points))
    terms = ("bending", *(["viscosity"] if damping else []))
    config = SimulationConfig(fps=cloth_lift().fps, terms=terms, courant=COURANT)
    with torch.no_grad():
        path = torch.from_numpy(points + truth.hand[:, None])
        x = Simulator(body, config, grip).rollout(_parameters(friction, damping), path).x.double().numpy()
    nodes = truth.middle.vertices
    return 1e3 * np.linalg.norm(x[:, : nodes.shape[1]] - nodes, axis=2)


def _around(held: Float[Array, "held 3"]) -> Float[Array, "8 3"]:
    """Points of a hand: corners of a box around what it holds [m]."""
    lower, upper = held.min(axis=0) - 0.01, held.max(axis=0) + 0.01
    return np.array(list(product(*zip(lower, upper, strict=True))))


def _parameters(friction: float, damping: float) -> Parameters:
    """The rig's numbers of its cloth."""
    E, nu = CLOTH.membrane_stiffness / CLOTH.thickness, CLOTH.poissons_ratio
    ratio = 12 * (1 - nu**2) * CLOTH.bending_stiffness / (E * CLOTH.thickness**3)
    number = lambda value: torch.tensor(float(value))
    shear, volume = E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))
    viscosity = {"viscosity": damping * torch.tensor([shear, volume])} if damping else {}
    values = map(number, (E, nu, friction, HOLD, HOLD_DAMPING))
    return Parameters(*values, bending_ratio=number(ratio), **viscosity)


if __name__ == "__main__":
    main()
