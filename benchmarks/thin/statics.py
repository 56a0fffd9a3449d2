"""Closed forms of bodies at rest. Each function takes a number of cells or segments and gives (found, expected)."""

import numpy as np
import torch

from benchmarks.thin.bodies import (
    GRAVITY,
    Rope,
    Sheet,
    around,
    at_rest,
    end_of,
    held_rope,
    held_strip,
)
from benchmarks.thin.meshes import rectangle, scattered
from benchmarks.thin.theory import catenary_sag, heavy_elastica, plate_stiffness
from physreal_core.simulation import Clamp, PointLoad

STIFF = Sheet(youngs_modulus=5e6)
"""A strip of 10 cm of it bends by a fifth of its thickness a centimetre: its deflection is small."""
THIN = Sheet(thickness=0.001)
"""A strip of 10 cm of it hangs straight down but for a bend of 2 cm."""


def _cantilever(sheet: Sheet, cells: int, jitter: float, across: int, width: float) -> tuple[float, float]:
    body, clamp = held_strip(sheet, (cells, across), width=width, jitter=jitter)
    # sheets that hang almost straight swing like chains; stiff ones are at rest soon
    x = at_rest(sheet, body, (clamp,), seconds=10.0)
    _, down = heavy_elastica(sheet.weight, 0.1, sheet.bending)
    return -end_of(body, x)[2], down


def cantilever_small(cells: int, jitter: float = 0.0) -> tuple[float, float]:
    """Tip of a strip that bends little under its own weight [m], beside the elastica."""
    return _cantilever(STIFF, cells, jitter, max(1, cells // 5), 0.02)


def cantilever_large(cells: int, jitter: float = 0.0) -> tuple[float, float]:
    """Tip of a strip that hangs down by its own weight [m], beside the elastica."""
    return _cantilever(Sheet(), cells, jitter, max(1, cells // 5), 0.02)


def cantilever_irregular(cells: int) -> tuple[float, float]:
    """The same with the inner vertices moved by up to a fifth of a cell."""
    return _cantilever(Sheet(), cells, 0.2, max(2, 2 * cells // 5), 0.04)


def cantilever_poisson(cells: int) -> tuple[float, float]:
    """The same strip with a Poisson's ratio of 0.3, narrow enough to be a beam."""
    return _cantilever(Sheet(poissons_ratio=0.3), cells, 0.0, max(1, cells // 10), 0.005)


def cantilever_rope(segments: int) -> tuple[float, float]:
    """Tip of a rope that is held level at one end [m], beside the elastica."""
    rope = Rope()
    body, clamp = held_rope(rope, segments)
    x = at_rest(rope, body, (clamp,), seconds=10.0)
    _, down = heavy_elastica(rope.weight, 0.1, rope.bending)
    return -end_of(body, x)[2], down


def drape(cells: int) -> tuple[float, float]:
    """Chord's angle below the level of a thin square that hangs over an edge [rad] (Peirce's cantilever test)."""
    body, clamp = held_strip(THIN, (cells, cells), width=0.1)
    x = end_of(body, at_rest(THIN, body, (clamp,), rate=8.0, seconds=12.0))
    along, down = heavy_elastica(THIN.weight, 0.1, THIN.bending)
    return float(np.arctan2(-x[2], x[0])), float(np.arctan2(down, along))


def _arc(length: float, span: float, pieces: int) -> np.ndarray:
    """Vertices in equal steps along a polygon of that length on an arc that hangs from both ends [m]."""
    low, high = 1e-3, 2.0 * np.pi
    for _ in range(60):  # of the arc's angle: chord over length falls with it
        angle = (low + high) / 2.0
        steps = pieces * np.sin(angle / (2 * pieces))
        low, high = (angle, high) if np.sin(angle / 2.0) / steps > span / length else (low, angle)
    radius = span / (2.0 * np.sin(angle / 2.0))
    at = np.linspace(-angle / 2.0, angle / 2.0, pieces + 1)
    return np.stack([radius * np.sin(at), 0.0 * at, radius * (np.cos(angle / 2.0) - np.cos(at))], 1)


def catenary_rope(segments: int) -> tuple[float, float]:
    """Sag of a limp rope that hangs from both ends [m]."""
    rope = Rope(youngs_modulus=2e7)
    start = _arc(0.3, 0.2, segments)
    body = rope.body(start, np.full(segments, 0.3 / segments))
    limp = torch.tensor(1e-4, dtype=torch.float64)
    x = at_rest(rope, body, (around(start[0]), around(start[-1])), bending_ratio=limp)
    return -x[:, 2].min(), catenary_sag(0.3, 0.2)


def catenary_strip(cells: int) -> tuple[float, float]:
    """Sag of a limp strip that hangs from both ends [m]."""
    sheet = Sheet(youngs_modulus=2e6)
    rest, triangles = rectangle((cells, max(1, cells // 10)), (0.3, 0.03))
    start = np.repeat(_arc(0.3, 0.2, cells), max(1, cells // 10) + 1, axis=0)
    start[:, 1] = rest[:, 1]
    ends = [Clamp(start[i] - (1e-6, 1.0, 1e-6), start[i] + (1e-6, 1.0, 1e-6)) for i in (0, -1)]
    limp = torch.tensor(1e-3, dtype=torch.float64)
    x = at_rest(sheet, sheet.body(start, triangles, rest), tuple(ends), bending_ratio=limp)
    return -x[:, 2].min(), catenary_sag(0.3, 0.2)


def stretch_strip(cells: int) -> tuple[float, float]:
    """How much a strip that hangs down stretches by its own weight [m]: rho g L^2 / 2 E."""
    sheet = Sheet(youngs_modulus=1e6)
    flat, triangles = rectangle((cells, max(1, cells // 5)), (0.2, 0.04))
    flat = scattered(flat, 0.2)
    start = np.stack([0.0 * flat[:, 0], flat[:, 1], -flat[:, 0]], 1)
    x = at_rest(sheet, sheet.body(start, triangles), (Clamp((-1.0, -1.0, -1e-6), (1.0, 1.0, 1e-6)),), rate=20.0)
    lowest = flat[:, 0] > 0.2 - 1e-9
    return -x[lowest, 2].mean() - 0.2, sheet.density * GRAVITY * 0.2**2 / (2.0 * sheet.youngs_modulus)


def stretch_rope(segments: int) -> tuple[float, float]:
    """The same of a rope."""
    rope = Rope(youngs_modulus=1e5)
    start = np.zeros((segments + 1, 3))
    start[:, 2] = -np.linspace(0.0, 0.2, segments + 1)
    x = at_rest(rope, rope.body(start), (around(start[0]),), rate=20.0)
    return -x[-1, 2] - 0.2, rope.density * GRAVITY * 0.2**2 / (2.0 * rope.youngs_modulus)


PLATE = Sheet(poissons_ratio=0.3)


def plate_twist(cells: int) -> tuple[float, float]:
    """Twist w / (x y) of a free square with opposite forces at its corners [1/m]: P / (2 D (1 - nu)) (Timoshenko)."""
    side, force = 0.1, 5e-5
    vertices, triangles = rectangle((cells, cells), (side, side))
    body = PLATE.body(vertices, triangles)
    corners = np.array([0, len(vertices) - 1, len(vertices) - cells - 1, cells])  # at (0, 0), (1, 1), (1, 0), (0, 1)
    loads = tuple(
        PointLoad(corners[[i]], np.ones(1), (0.0, 0.0, sign * force)) for i, sign in enumerate((1, 1, -1, -1))
    )
    z = at_rest(PLATE, body, loads=loads, gravity=0.0, seconds=6.0)[corners, 2]
    D = plate_stiffness(PLATE.youngs_modulus, PLATE.poissons_ratio, PLATE.thickness)
    return (z[0] + z[1] - z[2] - z[3]) / side**2, force / (2.0 * D * (1.0 - PLATE.poissons_ratio))


def _bent_plate(cells: int) -> tuple[float, float, float]:
    """Curvatures along and across of a free plate with moments at both ends, and the moment of a metre [N]."""
    size, moment = np.array([0.16, 0.08]), 2e-4
    vertices, triangles = rectangle((2 * cells, cells), tuple(size))
    columns = np.unique(vertices[:, 0])
    body = PLATE.body(vertices, triangles)
    cell, loads = columns[1] - columns[0], []
    for column, sign in zip(columns[[0, 1, -2, -1]], (1.0, -1.0, -1.0, 1.0), strict=True):
        there = np.flatnonzero(vertices[:, 0] == column)
        weights = np.where(np.isin(vertices[there, 1], (0.0, size[1])), 0.5, 1.0)
        loads.append(PointLoad(there, weights, (0.0, 0.0, sign * moment * size[1] / cell)))
    x = at_rest(PLATE, body, loads=tuple(loads), gravity=0.0, seconds=6.0)
    middle = np.abs(body.x0[:, 0] - size[0] / 2) < size[0] / 4
    u, v, w = (x - x.mean(0))[middle].T
    design = np.stack([np.ones_like(u), u, v, u * u / 2, v * v / 2, u * v], 1)
    fit = np.linalg.lstsq(design, w, rcond=None)[0]
    return float(fit[3]), float(fit[4]), moment


def plate_bent(cells: int) -> tuple[float, float]:
    """Curvature along a free plate with moments at both ends [1/m]: 12 M / (E t^3)."""
    along, _, moment = _bent_plate(cells)
    return along, moment / PLATE.bending


def plate_anticlastic(cells: int) -> tuple[float, float]:
    """Curvature across it over that along it: minus Poisson's ratio."""
    along, across, _ = _bent_plate(cells)
    return across / along, -PLATE.poissons_ratio
