"""Closed skins of sheets and ropes, as a scan or a rig gives them."""

import numpy as np

from physreal_core.geometry import Mesh
from physreal_core.geometry.mesh import oriented
from physreal_core.geometry.remeshing import rims_of
from tests.simulation.thin.scenes import sheet


def skin_of_sheet(upper: np.ndarray, lower: np.ndarray, triangles: np.ndarray) -> Mesh:
    """Both sides [V, 3] m of a surface with one rim, and the strip around it."""
    count, rim = len(upper), rims_of(triangles)[0]
    onward = np.roll(rim, -1)
    strip = [np.stack([rim, rim + count, onward], 1), np.stack([onward, rim + count, onward + count], 1)]
    faces = np.concatenate([triangles, triangles[:, ::-1] + count, *strip])
    return oriented(np.concatenate([upper, lower]), faces, None)


def flat_skin(size: tuple[float, float], thickness: float, cells: tuple[int, int] = (6, 5)) -> Mesh:
    """Of a level sheet from the origin."""
    vertices, triangles = sheet(cells, size)
    half = np.array([0.0, 0.0, thickness / 2])
    return skin_of_sheet(vertices + half, vertices - half, triangles)


def rolled(radius: float, size: tuple[float, float], cells: tuple[int, int], offset: float = 0.0) -> tuple:
    """Vertices and triangles of a sheet bent about the y axis, `offset` [m] towards the axis."""
    flat, triangles = sheet(cells, size)
    angle = flat[:, 0] / radius
    x, z = (radius - offset) * np.sin(angle), radius - (radius - offset) * np.cos(angle)
    return np.stack([x, flat[:, 1], z], axis=1), triangles


def tube(path: np.ndarray, radius: float, around: int = 12) -> Mesh:
    """The skin of a rope along a path [P, 3] m that is nowhere vertical, with flat ends."""
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third, angle = np.cross(tangent, across), 2 * np.pi * np.arange(around) / around
    ring = np.cos(angle)[:, None] * across[:, None] + np.sin(angle)[:, None] * third[:, None]
    vertices = np.concatenate([(path[:, None] + radius * ring).reshape(-1, 3), path[[0, -1]]])
    k, count = np.arange(around), len(path)
    k1 = (k + 1) % around
    first = around * np.arange(count - 1)[:, None]
    a, b, c, d = (
        (first + k).ravel(),
        (first + k1).ravel(),
        (first + around + k).ravel(),
        (first + around + k1).ravel(),
    )
    caps = [
        np.stack([np.full(around, around * count), k1, k], 1),
        np.stack([np.full(around, around * count + 1), around * (count - 1) + k, around * (count - 1) + k1], 1),
    ]
    return oriented(vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1), *caps]), None)
