"""Patches of the constitutive field: farthest points on the particles and the weights that spread their values
(eq. patch_to_particle)."""

import numpy as np

from physreal_core.array_types import Array, Float, Int


def farthest_points(points: Float[Array, "points 3"], count: int, *, start: int | None = None) -> Int[Array, " count"]:
    """Indices of `count` points, each the farthest from those before it.

    Args:
        points: [m], shape [points, 3].
        count: how many; no more than there are points.
        start: the first one; the point farthest from the centroid by default, so that the choice needs no seed.
    """
    points = np.asarray(points, float)
    count = min(count, len(points))
    first = int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))) if start is None else start
    chosen = np.empty(count, np.int64)
    nearest = np.full(len(points), np.inf)
    for i in range(count):
        chosen[i] = first if i == 0 else int(np.argmax(nearest))
        nearest = np.minimum(nearest, ((points - points[chosen[i]]) ** 2).sum(axis=1))
    return chosen


def patch_weights(
    x0: Float[Array, "particles 3"], patches: Int[Array, " patches"], neighbours: int = 4
) -> tuple[Int[Array, "particles k"], Float[Array, "particles k"]]:
    """Interpolation from patches to particles over the nearest `k` patches, weights summing to one.

    Shepard weights with compact support (Franke and Nielson 1980), w = (1/d - 1/d')^2 where d' is the distance to the
    first patch left out: a patch that leaves a particle's list has weight zero there, so the field is continuous, and a
    patch's own particle carries the patch's value exactly.

    Args:
        x0: particle positions [m], shape [particles, 3].
        patches: particle indices of the patch centres, shape [patches].

    Returns:
        Positions in `patches` and weights, both of shape [particles, min(neighbours, patches)].
    """
    distance = np.linalg.norm(x0[:, None] - x0[patches][None], axis=2)
    k = min(neighbours, len(patches))
    order = np.argsort(distance, axis=1, kind="stable")
    nearest = order[:, :k]
    d = np.maximum(np.take_along_axis(distance, nearest, axis=1), 1e-9)
    if k < len(patches):
        support = np.maximum(np.take_along_axis(distance, order[:, k : k + 1], axis=1), d[:, -1:])
        weights = np.maximum(1.0 / d - 1.0 / support, 0.0) ** 2
    else:
        weights = 1.0 / d**2
    total = weights.sum(axis=1, keepdims=True)
    # All k patches as far as the one left out: nothing tells them apart, so they share equally.
    weights = np.where(total > 0, weights / np.where(total > 0, total, 1.0), 1.0 / k)
    return nearest, weights
