"""Where a hand was, judged from a record of it that is not exact.

A hand moves smoothly; the error of its record hangs on for some time and jumps from frame to frame besides. Undamped, a soft body rings
with those jumps for seconds. So the path is taken as the sum of two Gaussian processes along time: the motion, with a Matern covariance
of order 7/2 (Rasmussen and Williams 2006, eq. 4.16; its jerk is continuous, as that of a person's strokes), and the error, an
Ornstein-Uhlenbeck process. A motion of order 5/2 takes part of the error for jumps of a hand that is shaken. The record itself says by its marginal likelihood how far and how fast the hand moves and how large the
error is (ibid., sec. 5.4). What follows is the path's mean, and its covariance: what the record leaves open.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from physreal_core.array_types import Array, Float

HAND_ERROR, UNSURE = 0.0005, 0.7
"""Standard deviation of a hand's recorded place along each axis [m] where nothing says how large it is, and of its logarithm."""

HAND_LASTS = 0.25
"""Time over which that error keeps its correlation [s]."""

KEPT, CLOSED = 0.97, 0.00005
"""Share of what is open that its leading modes must cover, and what may be left of it in the root mean square over frames [m]."""

LONGEST = 400
"""Frames that the sizes are learnt from; the most lively ones of a longer record."""

LEAST_MOTION, ROUNDING = 1e-5, 1e-5
"""A record that moves less tells nothing [m]; errors of storage in each number [m]."""


@dataclass(frozen=True)
class HandEstimate:
    """A hand's path and what is not known of it.

    Attributes:
        controllers: controller points [m]; those of frame 0 are as recorded, for the hold is against them.
        modes: leading modes of the covariance of the points' common displacement along each axis since frame 0 [m].
        error: standard deviation of the record's error along an axis, as learnt [m].
    """

    controllers: Float[Array, "frames points 3"]
    modes: Float[Array, "modes frames"]
    error: float


def estimate_hand(controllers: Float[Array, "frames points 3"], fps: float) -> HandEstimate:
    """The path with its jumps smoothed away, as far as the record itself says that they are none of the hand's.

    Args:
        controllers: controller points as recorded [m].
        fps: frames per second.
    """
    moved = (controllers - controllers[:1]).reshape(len(controllers), -1).astype(np.float64)
    if len(moved) < 4 or moved.shape[1] == 0 or np.abs(moved).max() < LEAST_MOTION:
        return HandEstimate(controllers, unknown_hand(len(controllers), fps), HAND_ERROR)
    time = np.arange(len(moved)) / fps
    sizes = _learnt_sizes(time, _principal_paths(moved))
    motion, error = _covariances(time, sizes)
    gain = cho_solve(cho_factor(motion + error), motion).T
    path = _since_start(gain @ moved).reshape(controllers.shape)
    covariance = _covariance_since_start(motion - gain @ motion)
    estimated = (controllers[:1] + path).astype(controllers.dtype)
    return HandEstimate(estimated, _leading_modes(covariance), float(np.exp(sizes[2])))


def unknown_hand(frames: int, fps: float) -> Float[Array, "modes frames"]:
    """Leading modes of the error along one axis since frame 0 [m] of a record that says nothing about it."""
    time = np.arange(frames) / fps
    return _leading_modes(_covariance_since_start(_error_covariance(time, HAND_ERROR)))


def _principal_paths(moved: Float[Array, "frames numbers"]) -> Float[Array, "frames paths"]:
    """The three main directions of all points' motion together, in which each point moves by so much in the mean [m]."""
    along, sizes, _ = np.linalg.svd(moved, full_matrices=False)
    return along[:, :3] * sizes[:3] / np.sqrt(moved.shape[1] / 3)


def _learnt_sizes(time: Float[Array, " frames"], paths: Float[Array, "frames paths"]) -> Float[Array, " sizes"]:
    """Logarithms of the motion's size [m] and time [s] and of the error's size [m], of largest posterior density."""
    from scipy.optimize import minimize

    chosen = _most_lively(paths)
    time, paths = time[chosen], paths[chosen] - paths[chosen][:1]
    size = np.sqrt((paths**2).mean())
    start = np.log([size, 0.3, HAND_ERROR])
    found = minimize(_surprise, start, (time, paths), method="Nelder-Mead", options={"xatol": 0.02, "fatol": 0.02})
    return found.x


def _most_lively(paths: Float[Array, "frames paths"]) -> slice:
    """The stretch of at most `LONGEST` frames with the longest way."""
    way = np.concatenate([[0.0], np.linalg.norm(np.diff(paths, axis=0), axis=1).cumsum()])
    first = int(np.argmax(way[LONGEST - 1 :] - way[: len(way) - LONGEST + 1])) if len(way) > LONGEST else 0
    return slice(first, first + LONGEST)


def _surprise(sizes: Float[Array, " sizes"], time: Array, paths: Array) -> float:
    """Negative logarithm of the paths' density and of the prior of the error's size."""
    try:
        factor = cho_factor(sum(_covariances(time, sizes)))
    except LinAlgError:
        return np.inf
    fit = 0.5 * np.einsum("tp,tp->", paths, cho_solve(factor, paths))
    volume = paths.shape[1] * np.log(np.diag(factor[0])).sum()
    return float(fit + volume + 0.5 * ((sizes[2] - np.log(HAND_ERROR)) / UNSURE) ** 2)


def _covariances(time: Float[Array, " frames"], sizes: Float[Array, " sizes"]) -> tuple[Array, Array]:
    """Of motion and of error, each [frames, frames] m2."""
    size, lasts, error = np.exp(sizes)
    r = np.sqrt(7.0) * np.abs(time[:, None] - time) / lasts
    return size**2 * (1 + r + 2 * r**2 / 5 + r**3 / 15) * np.exp(-r), _error_covariance(time, error)


def _error_covariance(time: Float[Array, " frames"], size: float) -> Float[Array, "frames frames"]:
    return size**2 * np.exp(-np.abs(time[:, None] - time) / HAND_LASTS) + ROUNDING**2 * np.eye(len(time))


def _since_start(values: Float[Array, "frames ..."]) -> Float[Array, "frames ..."]:
    return values - values[:1]


def _covariance_since_start(covariance: Float[Array, "frames frames"]) -> Float[Array, "frames frames"]:
    """The covariance of what has changed since frame 0."""
    return _since_start(_since_start(covariance).T)


def _leading_modes(covariance: Float[Array, "frames frames"]) -> Float[Array, "modes frames"]:
    values, vectors = np.linalg.eigh(covariance)
    values, vectors = np.maximum(values[::-1], 0.0), vectors[:, ::-1]
    left = values.sum() - np.cumsum(values)
    enough = max((1 - KEPT) * values.sum(), CLOSED**2 * len(values))
    count = int((left > enough).sum() + (values.sum() > enough))
    return (vectors[:, :count] * np.sqrt(values[:count])).T
