"""The body's shape at frame 0, as effects see it: middle, axes, extent, bumps, and which particles are exposed."""

from collections.abc import Mapping

import numpy as np
import torch
from scipy.cluster.vq import kmeans2
from scipy.spatial import ConvexHull, QhullError, cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.effect import Limits, Setting
from physreal_core.simulation import Body

FLAT = 0.1
"""Least share of a facet's normal that points down, if a body may rest on it."""
PLACES = 12
"""In which something local is looked for: a body several times as long as thick is covered to about its thickness."""
REACH = 1.8
"""Radius in which neighbours are counted [spacings]: the 26 around a lattice point, whose corners lie at 1.73."""


def middle(body: Body) -> Float[Array, "3"]:
    """Centre of volume [m]."""
    return (body.volume[:, None] * body.x0).sum(0) / body.volume.sum()


def axes(body: Body) -> Float[Array, "3 3"]:
    """Principal axes as rows, the longest first; the largest component of each is positive."""
    _, _, rows = np.linalg.svd(body.x0 - body.x0.mean(0), full_matrices=False)
    largest = np.abs(rows).argmax(1)
    return rows * np.sign(rows[np.arange(3), largest])[:, None]


def extent(body: Body) -> float:
    """Diagonal of the box around the body [m]."""
    return float(np.linalg.norm(np.ptp(body.x0, axis=0)))


def underside(body: Body) -> tuple[float, float, float] | None:
    """The plane that the body rests on where it stands still: height [m] below its middle, slopes along x and y.

    Of the convex hull's facets, the one below the centre of mass; of the particles' lower faces, half a spacing down. None for a
    sheet or a line of particles, which span no volume.
    """
    try:
        hull, mass = ConvexHull(body.x0), body.volume * body.density
    except (QhullError, ValueError):
        return None
    centre = (mass[:, None] * body.x0).sum(0) / mass.sum()
    normals, offsets = hull.equations[:, :3], hull.equations[:, 3]
    with np.errstate(divide="ignore"):
        heights = np.where(normals[:, 2] < -FLAT, -(offsets + normals[:, :2] @ centre[:2]) / normals[:, 2], -np.inf)
    facet = int(heights.argmax())
    slope = -normals[facet, :2] / normals[facet, 2]
    height = heights[facet] + slope @ (middle(body)[:2] - centre[:2]) - 0.5 * body.spacing
    return float(height), float(slope[0]), float(slope[1])


def exposure(body: Body) -> Float[Array, " particles"]:
    """Share of the surface that each particle carries, by how many of its neighbours are missing; sums to one.

    Of a thin body its share of the whole, for every vertex lies open.
    """
    if body.elements is not None:
        return body.volume / body.volume.sum()
    neighbours = cKDTree(body.x0).query_ball_point(body.x0, REACH * body.spacing, return_length=True)
    missing = np.maximum(1.0 - neighbours / neighbours.max(), 0.0) * body.volume
    return missing / missing.sum() if missing.any() else body.volume / body.volume.sum()


def bump(points: Float[Tensor, "points 3"], place: Float[Tensor, "3"], radius: Tensor) -> Float[Tensor, " points"]:
    """exp(-|x - c|^2 / (2 r^2)); 1 at the place c."""
    return torch.exp(-(points - place).square().sum(-1) / (2 * radius**2))


def box(body: Body) -> Limits:
    """Of a place `x`, `y`, `z` [m] at frame 0: the box around the body."""
    lower, upper = body.x0.min(0), body.x0.max(0)
    return {axis: (float(low), float(high)) for axis, low, high in zip("xyz", lower, upper, strict=True)}


def carried_place(
    values: Mapping[str, float], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]
) -> dict[str, float]:
    """`values` with the place in `x`, `y`, `z` [m] moved to R x + t."""
    place = rotation @ [values[axis] for axis in "xyz"] + translation
    return {**values, **dict(zip("xyz", map(float, place), strict=True))}


def places(body: Body) -> Float[Array, "places 3"]:
    """Where in the body something local may sit [m]: `PLACES` centres from which no part of it is far (k-means)."""
    along = np.argsort(body.x0 @ axes(body)[0], kind="stable")
    first = along[np.linspace(0, len(along) - 1, min(PLACES, len(along))).round().astype(int)]
    centres, _ = kmeans2(body.x0, body.x0[first], minit="matrix", iter=50)
    return centres


def local_starts(setting: Setting, share: float) -> tuple[dict[str, float], ...]:
    """One start per place: a bump with `x`, `y`, `z` there, and as `radius` a share of the extent."""
    radius = share * extent(setting.body)
    return tuple({**dict(zip("xyz", map(float, at), strict=True)), "radius": radius} for at in places(setting.body))
