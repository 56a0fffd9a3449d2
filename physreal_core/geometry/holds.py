"""When a hand holds an object: from how points of the object near it move with it."""

import warnings
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float, Int

WINDOW = 0.12
"""Time over which motions are compared [s]: a hand has gone farther than the noise by then."""

NOISE = 0.003
"""What points move by noise within a window [m]; motions of that size say little."""

PRICE = 1.5
"""Of saying that the hand takes or lets go, in windows of clear evidence."""

FEWEST = 4
"""Points of the object near the hand from which its motion there can be told."""


@dataclass(frozen=True)
class Hold:
    """An interval in which a hand holds.

    Args:
        taken: frame from which.
        released: frame from which no more; None where it still holds at the end.
    """

    taken: int
    released: int | None = None


def holds_of(
    controllers: Float[Array, "frames controllers 3"],
    points: Float[Array, "frames points 3"],
    valid: Bool[Array, "frames points"],
    *,
    reach: float,
    fps: float,
) -> list[Hold]:
    """When the hand holds.

    In each frame the points near the hand are asked whether they go where the hand goes within a `WINDOW` around it. With d their
    mean displacement and h the hand's there, the evidence for a hold is 2 d.h / (d.d + h.h + 2 NOISE^2) - 1/2: a half if they go together, minus
    a half if one of them goes without the other, and nothing if neither does. A hand that is not near does not hold. The intervals
    are those of most evidence, with a price on every change (dynamic programming, as a two-state hidden Markov model is decoded). Their
    ends are then moved to where the points begin, or cease, to stand still against the hand.

    Args:
        controllers: points on the hand [m]; NaN where unknown.
        points: tracked points of the object [m].
        valid: where those are measured.
        reach: how near to a controller point a point of the object is near the hand [m].
        fps: frames per second.
    """
    frames, half = len(controllers), max(1, round(WINDOW * fps / 2.0))
    around = [(max(f - half, 0), min(f + half, frames - 1)) for f in range(frames)]
    evidence = np.array([_evidence(controllers, points, valid, *ends, reach) for ends in around]) / (2 * half)
    held = _decoded(evidence, PRICE * 0.5)
    edges = np.flatnonzero(np.diff(held.astype(int), prepend=0, append=0)).reshape(-1, 2)
    found = []
    for first, end in edges.tolist():
        apart = _apart(controllers, points, valid, (first + end) // 2, reach)
        takes = 0 if first == 0 else _departure(apart[::-1], frames - 1 - min(first + half, end - 1), half)
        leaves = None if end == frames else _departure(apart, max(end - 1 - half, first), half)
        found.append(Hold(takes if first == 0 else frames - 1 - takes, leaves))
    return found


def _evidence(controllers: Array, points: Array, valid: Array, now: int, later: int, reach: float) -> float:
    """For a hold between two frames, between minus and plus a half."""
    near, hand = _near(controllers, points, valid, now, later, reach)
    if near is None:
        return 0.0
    if len(near) < FEWEST:
        return -0.5
    d = (points[later, near] - points[now, near]).mean(0)
    h = (controllers[later, hand] - controllers[now, hand]).mean(0)
    size = d @ d + h @ h
    return float((2.0 * (d @ h) - 0.5 * size) / (size + 2.0 * NOISE**2))


def _near(
    controllers: Array, points: Array, valid: Array, now: int, later: int, reach: float
) -> tuple[Int[Array, " near"] | None, Int[Array, " near"]]:
    """Points of the object that are near the hand in one frame and measured in both, and the controller point nearest to each; None where
    hand or object are not measured."""
    known = np.flatnonzero(np.isfinite(controllers[[now, later]]).all((0, 2)))
    seen = np.flatnonzero(valid[[now, later]].all(0))
    if not len(known) or len(seen) < FEWEST:
        return None, known
    distance, nearest = cKDTree(controllers[now, known]).query(points[now, seen])
    return seen[distance < reach], known[nearest[distance < reach]]


def _apart(controllers: Array, points: Array, valid: Array, middle: int, reach: float) -> Float[Array, "frames 3"]:
    """Where the points that are near the hand in one frame are in the others, as the hand sees it: their mean way since [m]; NaN where
    none of them is measured."""
    near, hand = _near(controllers, points, valid, middle, middle, reach)
    way = (points[:, near] - points[middle, near]) - (controllers[:, hand] - controllers[middle, hand])
    way = np.where(valid[:, near, None] & np.isfinite(way), way, np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of frames in which no point is measured
        return np.nanmean(way, axis=1)


def _departure(apart: Float[Array, "frames 3"], start: int, half: int) -> int:
    """The last frame from `start` on in which the points have not gone by more than the noise from where they were just before."""
    before = apart[max(start - half, 0) : start + 1]
    place = np.nanmean(before, axis=0) if np.isfinite(before).any() else apart[start]
    gone = np.flatnonzero(np.linalg.norm(apart[start:] - place, axis=1) > NOISE)
    return start + max(int(gone[0]) - 1, 0) if len(gone) else len(apart) - 1


def _decoded(evidence: Float[Array, " frames"], price: float) -> Bool[Array, " frames"]:
    """The sequence of states, free or held, of the largest sum of evidence (minus it where free) less the price of changes."""
    score, came = np.zeros(2), np.zeros((len(evidence), 2), np.int64)
    for frame, e in enumerate(evidence):
        stay, change = score, score[::-1] - price
        came[frame] = np.where(change > stay, [1, 0], [0, 1])
        score = np.maximum(stay, change) + np.array([-e, e])
    state, states = int(score[1] >= score[0]), np.zeros(len(evidence), bool)
    for frame in range(len(evidence) - 1, -1, -1):
        states[frame] = state
        state = came[frame, state]
    return states


def carried(
    x0: Float[Array, "particles 3"],
    points: Float[Array, "frames points 3"],
    valid: Bool[Array, "frames points"],
    frame: int,
    neighbours: int = 8,
) -> Float[Array, "particles 3"]:
    """About where particles are in a frame [m]: moved as the tracked points are in the mean that are nearest to them in frame 0.

    Args:
        x0: particles in frame 0 [m].
        points, valid: tracked points of the object [m], and where they are measured.
        frame: its number.
        neighbours: how many points are averaged.
    """
    seen = np.flatnonzero(valid[0] & valid[frame])
    if not len(seen):
        return x0
    moved = points[frame, seen] - points[0, seen]
    count = min(neighbours, len(seen))
    _, nearest = cKDTree(points[0, seen]).query(x0, k=count)
    return x0 + moved[nearest.reshape(len(x0), count)].mean(1)
