"""Patches of the constitutive field: farthest points on the particles and the weights that spread their values
(eq. patch_to_particle)."""

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.geometry.ways import distances_along


def farthest_points(
    points: Float[Array, "points 3"],
    count: int,
    *,
    start: int | None = None,
    ways: Int[Array, "ways 2"] | None = None,
) -> Int[Array, " count"]:
    """Indices of `count` points, each the farthest from those before it.

    Args:
        points: [m], shape [points, 3].
        count: how many; no more than there are points.
        start: the first one; the point farthest from the centroid by default, so that the choice needs no seed.
        ways: of a thin body (`ways.ways_of`), along which distances then count; straight ones by default.
    """
    points = np.asarray(points, float)
    count = min(count, len(points))
    first = int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))) if start is None else start
    chosen = np.empty(count, np.int64)
    nearest = np.full(len(points), np.inf)
    for i in range(count):
        chosen[i] = first if i == 0 else int(np.argmax(nearest))
        nearest = np.minimum(nearest, _squared(points, int(chosen[i]), ways))
    return chosen


def _squared(points: Array, origin: int, ways: Array | None) -> Float[Array, " points"]:
    if ways is None:
        return ((points - points[origin]) ** 2).sum(axis=1)
    return distances_along(points, ways, np.array([origin]))[:, 0] ** 2


def patch_weights(
    x0: Float[Array, "particles 3"],
    patches: Int[Array, " patches"],
    neighbours: int = 4,
    ways: Int[Array, "ways 2"] | None = None,
) -> tuple[Int[Array, "particles k"], Float[Array, "particles k"]]:
    """Interpolation from patches to particles over the nearest `k` patches, weights summing to one.

    Shepard weights with compact support (Franke and Nielson 1980), w = (1/d - 1/d')^2 where d' is the distance to the
    first patch left out: a patch that leaves a particle's list has weight zero there, so the field is continuous, and a
    patch's own particle carries the patch's value exactly.

    Args:
        x0: particle positions [m], shape [particles, 3].
        patches: particle indices of the patch centres, shape [patches].
        ways: of a thin body, as of `farthest_points`.

    Returns:
        Positions in `patches` and weights, both of shape [particles, min(neighbours, patches)].
    """
    if ways is not None:
        return weights_at(distances_along(x0, ways, patches), neighbours)
    return weights_at(np.linalg.norm(x0[:, None] - x0[patches][None], axis=2), neighbours)


def weights_at(
    distance: Float[Array, "particles patches"], neighbours: int
) -> tuple[Int[Array, "particles k"], Float[Array, "particles k"]]:
    """The same from the distances to the patches [m]; one that cannot be reached is at infinity."""
    k = min(neighbours, distance.shape[1])
    order = np.argsort(distance, axis=1, kind="stable")
    nearest = order[:, :k]
    d = np.maximum(np.take_along_axis(distance, nearest, axis=1), 1e-9)
    if k < distance.shape[1]:
        support = np.maximum(np.take_along_axis(distance, order[:, k : k + 1], axis=1), d[:, -1:])
        weights = np.maximum(1.0 / d - 1.0 / support, 0.0) ** 2
    else:
        weights = 1.0 / d**2
    total = weights.sum(axis=1, keepdims=True)
    # All k patches as far as the one left out: nothing tells them apart, so they share equally.
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1.0), 1.0 / k)
    return nearest, weights
