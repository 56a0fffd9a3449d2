"""How good masks and tracks are: overlap with true masks, survival, there-and-back misses, error, calibration.

Arrays of one sequence: T frames of H x W pixels, J points that were chosen in frame 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int

LOST_PX = 6.0
"""A track that misses its start by more after going there and back is on something else [px]."""
RIGHT_PX = 2.0
"""A point this near to its true place counts as right where confidence is judged [px]."""
BINS = 10
"""Of the confidence, from 0 to 1."""


@dataclass(frozen=True)
class Interval:
    """A mean over sequences and its 95 % bootstrap interval; the bounds are NaN for fewer than two sequences."""

    mean: float
    low: float
    high: float


def overlaps(true: Bool[Array, "T H W"], found: Bool[Array, "T H W"]) -> Float[Array, " T"]:
    """Intersection over union of every frame; 1 where both are empty."""
    union = (true | found).sum((1, 2))
    return np.where(union > 0, (true & found).sum((1, 2)) / np.maximum(union, 1), 1.0)


def share_of(found: Bool[Array, "T H W"], other: Bool[Array, "T H W"]) -> Float[Array, " T"]:
    """Share of `found` that lies on `other`, by frame; 0 where nothing is found."""
    return (found & other).sum((1, 2)) / np.maximum(found.sum((1, 2)), 1)


def inside(points: Float[Array, "J 2"], mask: Bool[Array, "H W"]) -> Bool[Array, " J"]:
    """Whether the pixels nearest to points (u, v) [px] belong to a mask; points off the image do not."""
    pixels = np.nan_to_num(np.rint(points), nan=-1).astype(int)
    height, width = mask.shape
    on = (pixels >= 0).all(1) & (pixels < [width, height]).all(1)
    u, v = np.where(on[:, None], pixels, 0).T
    return on & mask[v, u]


def alive(truly_visible: Bool[Array, " J"], claimed: Bool[Array, " J"]) -> float:
    """Share of the truly visible points that the tracker says are visible; NaN where none is."""
    return float(claimed[truly_visible].mean()) if truly_visible.any() else float("nan")


def missed(starts: Float[Array, "J 2"], back: Float[Array, "J 2"], limit: float = LOST_PX) -> float:
    """Share of survivors that come back farther than `limit` [px] from where they started; NaN where none survives."""
    return float((np.linalg.norm(back - starts, axis=1) > limit).mean()) if len(starts) else float("nan")


def track_errors(
    points: Float[Array, "T J 2"],
    true: Float[Array, "T J 2"],
    claimed: Bool[Array, "T J"],
    truly_visible: Bool[Array, "T J"],
) -> Float[Array, " N"]:
    """Distances [px] from the truth after frame 0, where a point is visible and the tracker says so."""
    counted = (claimed & truly_visible)[1:]
    return np.linalg.norm(points - true, axis=-1)[1:][counted]


def calibration(
    confidence: Float[Array, "T J"],
    points: Float[Array, "T J 2"],
    true: Float[Array, "T J 2"],
    claimed: Bool[Array, "T J"],
    limit: float = RIGHT_PX,
) -> tuple[Int[Array, " B"], Int[Array, " B"]]:
    """How many claims after frame 0 have a confidence in each bin, and how many of them lie within `limit` [px]."""
    counted = claimed[1:]
    right = (np.linalg.norm(points - true, axis=-1) <= limit)[1:][counted]
    which = np.clip((confidence[1:][counted] * BINS).astype(int), 0, BINS - 1)
    return np.bincount(which, minlength=BINS), np.bincount(which[right], minlength=BINS)


def pooled(values: Sequence[float], seed: int = 0) -> Interval:
    """Mean over sequences and its bootstrap interval (percentiles of 9999 samples of the sequences); NaN is left out."""
    from scipy.stats import bootstrap

    known = np.array([value for value in values if value is not None and np.isfinite(value)])
    nan = float("nan")
    if len(known) == 0:
        return Interval(nan, nan, nan)
    if len(known) == 1:
        return Interval(float(known[0]), nan, nan)
    interval = bootstrap((known,), np.mean, method="percentile", rng=np.random.default_rng(seed)).confidence_interval
    return Interval(float(known.mean()), float(interval.low), float(interval.high))
