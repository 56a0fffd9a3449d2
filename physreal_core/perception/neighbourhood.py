"""How the tracks around a point move: the affine map that carries it, and how far they themselves depart from it."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int

_NORMAL = 1.4826  # median absolute deviation to standard deviation, of a normal distribution
_REWEIGHTINGS = 2


@dataclass(frozen=True)
class LocalMap:
    """What the neighbourhood says of each of N points.

    Attributes:
        points: [N, 2] where the neighbours carry the point [px].
        linear: [N, 2, 2], d(target) / d(source), of the neighbourhood.
        spread: [N] px, how far the neighbours depart from the map themselves (robust standard deviation).
        support: [N], how many neighbours speak.
    """

    points: Float[Array, "N 2"]
    linear: Float[Array, "N 2 2"]
    spread: Float[Array, " N"]
    support: Int[Array, " N"]


def nearest_others(points: Float[Array, "J 2"], count: int) -> Int[Array, "J K"]:
    """The nearest `count` other points of each point, fewer where there are fewer, the nearest first."""
    from scipy.spatial import cKDTree

    count = min(count, len(points) - 1)
    if count < 1:
        return np.zeros((len(points), 0), np.intp)
    index = cKDTree(points).query(points, k=count + 1)[1]
    own = index == np.arange(len(points))[:, None]
    own[~own.any(1), -1] = True  # of several points at one place, one may be missing in its own list
    return index[~own].reshape(len(points), count)


def nearest_among(points: Float[Array, "J 2"], which: Array, among: Array, count: int) -> Int[Array, "N K"]:
    """For each of the points `which` [N], the nearest `count` of the points `among` [M], fewer where there are fewer."""
    from scipy.spatial import cKDTree

    count = min(count, len(among))
    if count == 0 or len(which) == 0:
        return np.zeros((len(which), count), np.intp)
    index = cKDTree(points[among]).query(points[which], k=count)[1].reshape(len(which), count)
    return among[index]


def local_map(
    centres: Float[Array, "N 2"],
    source: Float[Array, "N K 2"],
    target: Float[Array, "N K 2"],
    usable: Bool[Array, "N K"],
    *,
    floor: float,
) -> LocalMap:
    """The affine map of the neighbours' motion, by least squares that outliers lose their weight in (Cauchy's).

    Near neighbours count more. The linear part shrinks towards a mere shift where few neighbours speak.

    Args:
        centres: the points in the source frame [px].
        source, target: their neighbours in both frames [px].
        usable: which neighbours are known in both.
        floor: a spread below this is not told from none [px].
    """
    offset, shift = (source - centres[:, None]).astype(float), (target - source).astype(float)
    distance = np.linalg.norm(offset, axis=-1)
    scale = (
        np.maximum(np.median(distance, axis=1, keepdims=True), 1.0) if distance.shape[1] else np.ones((len(centres), 1))
    )
    near = np.where(usable, np.exp(-0.5 * (distance / scale) ** 2) + 1e-3, 0.0)
    terms = np.concatenate([np.ones((*distance.shape, 1)), offset / scale[..., None]], -1)  # [N, K, 3]
    weight = near
    for _ in range(1 + _REWEIGHTINGS):
        coefficients = _solve(terms, shift, weight)
        miss = np.linalg.norm(shift - terms @ coefficients, axis=-1)
        spread = np.maximum(_masked_median(miss, usable) * _NORMAL, floor)
        weight = near / (1.0 + (miss / (2.0 * spread[:, None])) ** 2)
    linear = np.eye(2) + coefficients[:, 1:].transpose(0, 2, 1) / scale[..., None]
    return LocalMap(
        (centres + coefficients[:, 0]).astype(np.float32),
        linear.astype(np.float32),
        spread.astype(np.float32),
        usable.sum(1),
    )


def _solve(terms: Array, shift: Array, weight: Array) -> Array:
    """Coefficients [N, 3, 2]; the linear ones are drawn to zero as by a twentieth of the neighbours."""
    weighted = (terms * weight[..., None]).transpose(0, 2, 1)  # [N, 3, K]
    normal = weighted @ terms
    normal += np.diag([0.0, 0.05, 0.05]) * weight.sum(1)[:, None, None] + 1e-9 * np.eye(3)
    return np.linalg.solve(normal, weighted @ shift)


def _masked_median(values: Float[Array, "N K"], mask: Bool[Array, "N K"]) -> Float[Array, " N"]:
    """Median of each row's masked values; 0 where there are none."""
    if values.shape[1] == 0:
        return np.zeros(len(values))
    ordered = np.sort(np.where(mask, values, np.inf), axis=1)
    count = mask.sum(1)
    low, high = (ordered[np.arange(len(values)), np.maximum(i, 0)] for i in ((count - 1) // 2, count // 2))
    with np.errstate(invalid="ignore"):
        return np.where(count > 0, 0.5 * (np.where(count > 0, low, 0) + np.where(count > 0, high, 0)), 0.0)
