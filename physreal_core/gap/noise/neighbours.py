"""A sensor's noise from the capture itself: how far tracked points stray from what their neighbours do.

Between two frames a small part of a body moves by an affine map, whatever acts on it. What a track's displacement differs from the
affine map of its neighbours is noise. Half the mean square of these differences over a lag of d frames is the noise's variogram,
sigma^2 (1 - c^d) for an autoregressive process of first order (Cressie 1993, "Statistics for Spatial Data", section 2.3.1). So a data
sheet's number need not be right: a depth reading may be better than it says, and a pixel far better than a reading.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.noise.sensor import Sensor

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

OFTEN, HARMLESS = 6.0, 0.25
"""How far a track may stray from its neighbours: so many robust standard deviations of what all do, and this share of the stated
deviation at least."""

ROUNDS = 8
"""How often the worst of every neighbourhood is taken out."""

ROBUST = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation."""

FINEST = 0.02
"""Least size of the noise, in units of the stated one."""

STRONGEST = 0.95
"""Correlation from frame to frame; beyond it, noise could not be told from an error of the start."""


def learnt_sensor(
    points0: Float[Array, "tracks 3"],
    points: Float[Array, "frames tracks 3"],
    valid: Bool[Array, "frames tracks"],
    stated: Float[Array, "frames tracks"],
    axes: Float[Array, "frames tracks 3 3"] | None = None,
    until: int | None = None,
) -> Sensor:
    """The noise of tracked points on one body along the sensor's axes.

    Its pattern over frames and tracks stays as stated, its size is learnt; where there are too few tracks, both are as stated.

    Args:
        points0: where the tracks are in frame 0 [m]; what the neighbours' map is a function of.
        points: measured [m]; anything where not valid. Frame 0 takes no part, for its noise is that of `points0`.
        valid: entries with a measurement.
        stated: standard deviation [m], positive.
        axes: of the sensor, as of `Sensor`.
        until: frames before this one are looked at; all by default.
    """
    seen = points0, points[:until], valid[:until], stated, axes
    variogram = {lag: _variogram(*seen, lag) for lag in LAGS}
    known = {lag: found for lag, found in variogram.items() if found is not None}
    alike = Sensor.alike(stated)
    if not known:
        return Sensor(alike.sigma, alike.correlation, axes)
    lags, halves = np.array([*known]), np.array([*known.values()])
    if axes is None:
        halves = np.repeat(halves.mean(1, keepdims=True), 3, axis=1)
    sizes, correlations = zip(*(_autoregressive(lags, own) for own in halves.T), strict=True)
    return Sensor(alike.sigma * np.array(sizes), np.array(correlations), axes)


def _variogram(points0, points, valid, stated, axes, lag: int) -> Float[Array, " 3"] | None:
    """Half the mean square difference over a lag along each axis, in units of the stated variance; None without a comparison."""
    last = len(points) - lag
    if last < 2:
        return None
    frames = np.unique(np.linspace(1, last - 1, PAIRS).astype(int)).tolist()
    moved, both = points[lag:] - points[:last], valid[lag:] & valid[:last]
    squares = [_Strays(points0, moved, both[t], stated, axes, t).by ** 2 for t in frames]
    found = np.concatenate(squares)
    return 0.5 * found.mean(0) if len(found) >= ENOUGH else None


def trusted(
    points0: Float[Array, "tracks 3"],
    points: Float[Array, "frames tracks 3"],
    valid: Bool[Array, "frames tracks"],
    stated: Float[Array, "frames tracks"],
    axes: Float[Array, "frames tracks 3 3"] | None = None,
) -> Bool[Array, "frames tracks"]:
    """The valid entries but those that have slipped off the body: far more than others do they stray from their neighbours.

    Args:
        points0, points, valid, stated, axes: as of `learnt_sensor`.
    """
    since_start = [_Strays(points0, points - points0, valid[t], stated, axes, t) for t in range(len(points))]
    sizes = np.concatenate([own.by for own in since_start])
    if len(sizes) < ENOUGH:
        return valid
    allowed = np.maximum(OFTEN * ROBUST * np.median(np.abs(sizes), axis=0), HARMLESS)
    kept = valid.copy()
    for frame, found in enumerate(since_start):
        for _ in range(ROUNDS):
            worst = found.tracks[found.worst(allowed)]
            if not len(worst):
                break
            kept[frame, worst] = False
            found = _Strays(points0, points - points0, kept[frame], stated, axes, frame)
    return kept


class _Strays:
    """How far tracks stray from their neighbours' affine map in one frame.

    Args:
        points0: places that the map is a function of [m].
        moved: displacements, of which the ones of `frame` are looked at [m], shape [T, J, 3].
        known: tracks that have one.
        stated: standard deviation of a measurement [m], shape [T, J].
        axes: of the sensor, as of `Sensor`.
        frame: of them all.

    Attributes:
        tracks: that are compared, none where there are too few.
        by: along each axis, in units of the stated deviation.
    """

    def __init__(self, points0, moved, known, stated, axes, frame: int) -> None:
        self.tracks = np.flatnonzero(known)
        if len(self.tracks) <= NEIGHBOURS:
            self.tracks, self._near, self.by = self.tracks[:0], np.zeros((0, 1), int), np.zeros((0, 3))
            return
        places = points0[self.tracks]
        _, self._near = cKDTree(places).query(places, k=NEIGHBOURS + 1)
        strayed = np.einsum("jk,jkx->jx", _beside_affine(places[self._near]), moved[frame, self.tracks][self._near])
        if axes is not None:
            strayed = np.einsum("jax,jx->ja", axes[frame, self.tracks], strayed)
        self.by = strayed / stated[frame, self.tracks, None]

    def worst(self, allowed: Float[Array, " 3"]) -> Bool[Array, " tracks"]:
        """Which stray by more than is allowed, and more than their neighbours: one that has slipped draws these with it."""
        excess = np.abs(self.by / allowed).max(1, initial=0.0)
        return (excess > 1.0) & (excess >= excess[self._near].max(1, initial=0.0))


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
        return np.log(np.maximum(halves, FINEST**2)) - np.log1p(-(correlation**lags))

    best = minimize_scalar(lambda c: float(left(c).var()), bounds=(0.0, STRONGEST), method="bounded")
    return float(np.exp(0.5 * left(best.x).mean())), float(best.x)
