"""A sensor's noise from the capture itself: how far tracked points stray from what their neighbours do.

Between two frames a small part of a body moves by an affine map, whatever acts on it. What a track's displacement differs from the
affine map of its neighbours is noise. Half the mean square of these differences over a lag of d frames is the noise's variogram,
sigma^2 (1 - c^d) for an autoregressive process of first order (Cressie 1993, "Statistics for Spatial Data", section 2.3.1). So a data
sheet's number need not be right.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float, Int

NEIGHBOURS = 6
"""Tracks beside one whose affine map it is compared with. So few lie near, where a body that bends is affine still; a capture has
enough tracks and frames to make up for it."""

FLAT = 0.02
"""Smallest extent of the neighbours along an axis, relative to their largest, along which their map is fitted: a rope has one
axis, a cloth two."""

LAGS = (1, 2, 4, 8, 16)
"""Distances of two frames that are compared."""

PAIRS = 40
"""Pairs of frames that are compared for each lag, evenly spread."""

ENOUGH = 100
"""Comparisons of a lag, each of a track in two frames, below which nothing is said about it."""

OFTEN = 6.0
"""Robust standard deviations of what all tracks stray by, beyond which one has slipped."""

ROUNDS = 8
"""How often the worst of every neighbourhood is taken out."""

ROBUST = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""

LEAST = 0.5
"""Least deviation with which a measurement counts, in units of the stated one. What a camera errs by is also in the pose, the hold and
the shape that it saw; there it does not average out over the tracks."""

TINY = 1e-12
"""Mean square below which tracks have no noise at all, in units of the stated variance."""

STRONGEST = 0.95
"""Correlation from frame to frame; beyond it, noise could not be told from an error of the start."""


@dataclass(frozen=True)
class SeenNoise:
    """Noise of tracked points, alike along all axes and independent from track to track.

    Args:
        sensor: its standard deviation along each axis [m], shape [T, J].
        correlation: from one frame to the next, 0 to below 1.
        sigma: standard deviation with which a measurement counts in fits [m], shape [T, J].
    """

    sensor: Float[Array, "frames tracks"]
    correlation: float
    sigma: Float[Array, "frames tracks"]

    @classmethod
    def known(cls, sigma: Float[Array, "frames tracks"], correlation: float = 0.0) -> SeenNoise:
        """Noise of known size [m], with which a measurement counts."""
        return cls(sigma, correlation, sigma)


def learnt_noise(
    points0: Float[Array, "tracks 3"],
    points: Float[Array, "frames tracks 3"],
    valid: Bool[Array, "frames tracks"],
    stated: Float[Array, "frames tracks"],
) -> SeenNoise:
    """The noise of tracked points on one body.

    Its pattern over frames and tracks stays as stated, its size is learnt; where there are too few tracks, both are as stated.

    Args:
        points0: where the tracks are in frame 0 [m]; what the neighbours' map is a function of.
        points: measured [m]; anything where not valid. Frame 0 takes no part, for its noise is that of `points0`.
        valid: entries with a measurement that may be looked at.
        stated: standard deviation [m], positive.
    """
    known = {lag: half for lag in LAGS if (half := _variogram(points0, points, valid, stated, lag)) is not None}
    if not known:
        return SeenNoise.known(stated)
    size, correlation = _autoregressive(np.array([*known]), np.array([*known.values()]))
    return SeenNoise(stated * size, correlation, stated * max(size, LEAST))


def _variogram(points0, points, valid, stated, lag: int) -> float | None:
    """Half the mean square difference over a lag, in units of the stated variance; None without enough comparisons."""
    last = len(points) - lag
    if last < 2:
        return None
    frames = np.unique(np.linspace(1, last - 1, PAIRS).astype(int)).tolist()
    moved, both = points[lag:] - points[:last], valid[lag:] & valid[:last]
    found = np.concatenate([_Strays(points0, moved[t], both[t], stated[t]).by for t in frames])
    return 0.5 * float((found**2).mean()) if len(found) >= ENOUGH else None


def trusted(
    points0: Float[Array, "tracks 3"],
    points: Float[Array, "frames tracks 3"],
    valid: Bool[Array, "frames tracks"],
    stated: Float[Array, "frames tracks"],
) -> Bool[Array, "frames tracks"]:
    """The valid entries but those that have slipped off the body: far more than others do they stray from their neighbours.

    Args:
        points0, points, valid, stated: as of `learnt_noise`.
    """
    moved = points - points0
    found = [_Strays(points0, moved[t], valid[t], stated[t]) for t in range(len(points))]
    sizes = np.concatenate([own.by for own in found])
    if len(sizes) < ENOUGH:
        return valid
    allowed = OFTEN * max(ROBUST * float(np.median(np.abs(sizes))), LEAST)
    kept = valid.copy()
    for frame, strays in enumerate(found):
        for _ in range(ROUNDS):
            worst = strays.worst(allowed)
            if not len(worst):
                break
            kept[frame, worst] = False
            strays = _Strays(points0, moved[frame], kept[frame], stated[frame])
    return kept


class _Strays:
    """How far tracks stray from their neighbours' affine map.

    Args:
        points0: places that the map is a function of [m], shape [J, 3].
        moved: displacements [m], shape [J, 3].
        known: tracks that have one.
        stated: standard deviation of a measurement [m], shape [J].

    Attributes:
        tracks: that are compared, none where there are too few.
        by: along each axis, in units of the stated deviation.
    """

    def __init__(self, points0, moved, known, stated) -> None:
        self.tracks = np.flatnonzero(known)
        if len(self.tracks) <= NEIGHBOURS:
            self.tracks, self._near, self.by = self.tracks[:0], np.zeros((0, 1), int), np.zeros((0, 3))
            return
        places = points0[self.tracks]
        _, self._near = cKDTree(places).query(places, k=NEIGHBOURS + 1)
        strayed = np.einsum("jk,jkx->jx", _beside_affine(places[self._near]), moved[self.tracks][self._near])
        self.by = strayed / stated[self.tracks, None]

    def worst(self, allowed: float) -> Int[Array, " worst"]:
        """Which stray by more than is allowed, and more than their neighbours: one that has slipped draws these with it."""
        by = np.abs(self.by).max(1, initial=0.0)
        return self.tracks[(by > allowed) & (by >= by[self._near].max(1, initial=0.0))]


def _beside_affine(places: Float[Array, "tracks near 3"]) -> Float[Array, "tracks near"]:
    """Weights of a sum over each track (the first) and its neighbours that leaves nothing of an affine function, of unit length."""
    centred = places - places.mean(1, keepdims=True)
    along, extents, _ = np.linalg.svd(centred, full_matrices=False)
    along = np.where(extents[:, None] > FLAT * extents[:, None, :1], along, 0.0)
    weights = -1.0 / places.shape[1] - np.einsum("ja,jka->jk", along[:, 0], along)
    weights[:, 0] += 1.0
    return weights / np.linalg.norm(weights, axis=1, keepdims=True)


def _autoregressive(lags: Array, halves: Array) -> tuple[float, float]:
    """Size and correlation of the process whose variogram is nearest to a given one, on a logarithmic scale."""

    def left(correlation: float) -> Array:
        return np.log(np.maximum(halves, TINY)) - np.log1p(-(correlation**lags))

    best = minimize_scalar(lambda c: float(left(c).var()), bounds=(0.0, STRONGEST), method="bounded")
    return float(np.exp(0.5 * left(best.x).mean())), float(best.x)
