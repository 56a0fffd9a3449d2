"""Points bound to the cell of a thin body that they lie on: the corners of a triangle, or the ends of a segment.

`carry_points` then follows the corners' tangent planes, blended linearly: of a surface of curvature c and a point of it this is off by c times half of the
weighted mean of the squared distances from the corners, at most c edge^2 / 6 in a triangle with equal sides and c length^2 / 8 on a segment. A point beside
the surface keeps its distance along the turned normal. Nearest vertices by the straight way would bind it to layers that only lie there.
"""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.rendering.binding import Binding

CANDIDATES = 24
"""Cells with the nearest middles, of which the nearest is taken: enough where cells are of about one size."""


def bind_to_cells(
    points: Float[Tensor, "points 3"] | Array,
    x0: Float[Tensor, "vertices 3"] | Array,
    cells: Int[Array, "cells corners"],
) -> Binding:
    """Bind points to the corners of their nearest cells with the weights of the nearest place in it.

    Args:
        points: [m].
        x0: vertices in the initial configuration [m].
        cells: vertices of segments [S, 2] or of triangles [M, 3], of about one size.
    """
    points, x0 = (np.asarray(torch.as_tensor(a).detach().cpu(), dtype=np.float64) for a in (points, x0))
    cells = np.asarray(cells, np.int64)
    corners = x0[cells]
    count = min(CANDIDATES, len(cells))
    _, near = cKDTree(corners.mean(axis=1)).query(points, k=np.arange(1, count + 1))
    asked = np.repeat(points[:, None], count, axis=1)
    weights = (_in_segment if cells.shape[1] == 2 else _in_triangle)(asked, corners[near])
    places = np.einsum("gnc,gnck->gnk", weights, corners[near])
    best = ((places - asked) ** 2).sum(-1).argmin(axis=1)
    row = np.arange(len(points))
    return Binding(cells[near[row, best]], weights[row, best].astype(np.float32))


def _in_segment(points: Float[Array, "*batch 3"], ends: Float[Array, "*batch 2 3"]) -> Float[Array, "*batch 2"]:
    """Weights of the nearest place between two ends."""
    start, way = ends[..., 0, :], ends[..., 1, :] - ends[..., 0, :]
    share = ((points - start) * way).sum(-1) / np.maximum((way**2).sum(-1), 1e-300)
    share = np.clip(share, 0.0, 1.0)
    return np.stack([1.0 - share, share], axis=-1)


def _in_triangle(points: Float[Array, "*batch 3"], corners: Float[Array, "*batch 3 3"]) -> Float[Array, "*batch 3"]:
    """Weights of the nearest place in a triangle: below the point, or on the nearest edge."""
    a, b, c = np.moveaxis(corners, -2, 0)
    normal = np.cross(b - a, c - a)
    square = np.maximum((normal**2).sum(-1), 1e-300)
    over = lambda p, q: (np.cross(q - p, points - p) * normal).sum(-1) / square
    inside = np.stack([over(b, c), over(c, a), over(a, b)], axis=-1)
    best, least = inside, np.where((inside >= 0.0).all(-1), 0.0, np.inf)
    for e in range(3):
        i, j = (e + 1) % 3, (e + 2) % 3
        along = _in_segment(points, corners[..., [i, j], :])
        weights = np.zeros_like(inside)
        weights[..., i], weights[..., j] = along[..., 0], along[..., 1]
        off = ((np.einsum("...c,...ck->...k", weights, corners) - points) ** 2).sum(-1)
        better = off < least
        best, least = np.where(better[..., None], weights, best), np.where(better, off, least)
    return best
