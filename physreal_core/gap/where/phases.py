"""Phases of an interaction: what hand and body do in each frame, points on the ground, and parts of the body."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy import ndimage

from physreal_core.array_types import Array, Bool, Float, Int

MOTIONS = ("still", "driven", "swinging", "settled")
"""Nothing has moved yet; the hand moves; the hand rests and the body moves; both have come to rest."""

PARTS_BY_DISTANCE = ("held end", "middle", "far end")
PARTS_BY_HEIGHT = ("underside", "middle", "top")


@dataclass(frozen=True)
class Phases:
    """Labels of frames and points.

    Args:
        motion: index into `MOTIONS`, shape [T].
        touching: points on the ground, shape [T, J].
        part: index into `parts`, shape [J].
        parts: names of the parts of the body.
    """

    motion: Int[Array, " T"]
    touching: Bool[Array, "T J"]
    part: Int[Array, " J"]
    parts: tuple[str, ...]

    def spans(self) -> list[tuple[str, int, int]]:
        """Stretches of one motion: (motion, first frame, frame after the last)."""
        edges = [0, *(np.flatnonzero(np.diff(self.motion)) + 1).tolist(), len(self.motion)]
        return [(MOTIONS[self.motion[a]], a, b) for a, b in pairwise(edges)]


def label_phases(
    simulated: Float[Array, "T J 3"],
    fps: float,
    *,
    controllers: Float[Array, "T C 3"] | None = None,
    held_distance: Float[Array, " J"] | None = None,
    touching: Bool[Array, "T J"] | None = None,
) -> Phases:
    """Label the phases of one interaction.

    Args:
        simulated: tracked points as simulated, because these have no holes [m], shape [T, J, 3].
        fps: frames per second.
        controllers: points of the hand [m], shape [T, C, 3]; None or C = 0 where no hand moves the body (a released
            beam).
        held_distance: distance of each point from hand or clamp at frame 0 [m], shape [J]. Without it, the parts of the
            body are thirds of its height.
        touching: points on the ground, shape [T, J]; None for no ground.
    """
    frames, points, _ = simulated.shape
    body_moves = moving(simulated, fps)
    if controllers is None or controllers.shape[1] == 0:
        hand_moves, begun = np.zeros(frames, bool), np.ones(frames, bool)
    else:
        hand_moves = moving(controllers.mean(1, keepdims=True), fps)
        begun = np.logical_or.accumulate(hand_moves)
    motion = np.select(
        [hand_moves, begun & body_moves, begun & np.logical_or.accumulate(body_moves)],
        [MOTIONS.index(name) for name in ("driven", "swinging", "settled")],
        MOTIONS.index("still"),
    )
    part, parts = _parts(simulated[0], held_distance)
    return Phases(motion, np.zeros((frames, points), bool) if touching is None else touching, part, parts)


def moving(path: Float[Array, "T J 3"], fps: float, *, share: float = 0.1, gap: float = 0.1) -> Bool[Array, " T"]:
    """Frames in which points move faster than a share of their highest speed, and faster than their jitter.

    Args:
        path: of the points [m], shape [T, J, 3].
        fps: frames per second.
        share: of the highest root mean square speed.
        gap: shorter rests within a motion count as motion, and shorter motions within a rest as rest [s].
    """
    if len(path) < 3:
        return np.zeros(len(path), bool)
    steps = np.sqrt((np.gradient(path, axis=0) ** 2).sum(-1).mean(1))
    # jitter of a gradient (x[t+1] - x[t-1]) / 2 of white noise, whose second difference has six times its variance
    jitter = np.median(np.sqrt((np.diff(path, 2, axis=0) ** 2).sum(-1).mean(1))) / np.sqrt(12.0)
    fast = steps > max(share * steps.max(), min(2.0 * jitter, 0.5 * steps.max()), 1e-9)
    structure = np.ones(2 * max(1, round(gap * fps / 2)) + 1, bool)
    padded = np.pad(fast, len(structure), mode="edge")
    cleaned = ndimage.binary_opening(ndimage.binary_closing(padded, structure), structure)
    return cleaned[len(structure) : -len(structure)]


def on_ground(simulated: Float[Array, "T J 3"], ground_height: float | None, reach: float) -> Bool[Array, "T J"]:
    """Points within `reach` [m] of the support plane, where contact acts on them; no points without a plane."""
    if ground_height is None:
        return np.zeros(simulated.shape[:2], bool)
    return simulated[..., 2] < ground_height + reach


def _parts(points0: Array, held_distance: Array | None) -> tuple[Array, tuple[str, ...]]:
    """Thirds of the way from hand or clamp to the far end, or of the height."""
    measure = points0[:, 2] if held_distance is None else held_distance
    names = PARTS_BY_HEIGHT if held_distance is None else PARTS_BY_DISTANCE
    low, high = measure.min(), measure.max()
    thirds = np.floor(3.0 * (measure - low) / max(high - low, 1e-12)).astype(int)
    return thirds.clip(0, 2), names
