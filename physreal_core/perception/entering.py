"""Points on what comes into sight later: chosen where a thing has no track, followed forwards and backwards."""

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.flow import pixel_grid
from physreal_core.perception.flow_tracker import FlowTracker
from physreal_core.perception.neighbourhood import nearest_others
from physreal_core.perception.queries import spread_over
from physreal_core.perception.settings import QuerySettings
from physreal_core.perception.templates import Templates
from physreal_core.perception.tracker import Tracks


def with_entering(
    tracks: Tracks,
    tracker: FlowTracker,
    frames: Sequence[UInt8[Array, "H W 3"]],
    masks: Bool[Array, "T H W"],
    occluders: Bool[Array, "T H W"],
    queries: QuerySettings,
) -> Tracks:
    """The tracks, and those of points that come into sight on the thing after frame 0, at the end.

    Args:
        tracks: from frame 0.
        tracker: follows the new points.
        frames: T images.
        masks: the thing.
        occluders: pixels where its points are not visible.
        queries: how near to a mask's edge points are chosen.
    """
    settings = tracker.settings
    if tracks.points.shape[1] < settings.least_entering:
        return tracks
    first = tracks.points[0]
    spacing = float(np.median(np.linalg.norm(first[nearest_others(first, 1)[:, 0]] - first, axis=1)))
    for t in range(settings.entering_every, len(frames), settings.entering_every):
        new = _untracked(
            masks[t], tracks.points[t, tracks.visible[t]], spacing * settings.entering_gap, spacing, queries
        )
        new = new[_contrast(frames[t], new, tracker) > settings.min_contrast]
        if len(new) >= settings.least_entering:
            tracks = _joined(tracks, tracker.track_from(t, frames, new, occluders))
    return tracks


def _untracked(
    mask: Bool[Array, "H W"], points: Float[Array, "N 2"], gap: float, spacing: float, settings: QuerySettings
) -> Float[Array, "M 2"]:
    """Pixels of a mask farther than `gap` [px] from all points, about `spacing` [px] apart."""
    from scipy.spatial import cKDTree

    away = mask.copy()
    if len(points):
        pixels = pixel_grid(*mask.shape)[mask]
        away[mask] = cKDTree(points).query(pixels)[0] > gap
    if not away.any():
        return np.zeros((0, 2), np.float32)
    return spread_over(away, max(round(float(away.sum()) / spacing**2), 1), settings)


def _contrast(frame: Array, points: Float[Array, "N 2"], tracker: FlowTracker) -> Float[Array, " N"]:
    """Of the patches around points [grey levels]."""
    import cv2

    templates = Templates(len(points), tracker.settings.patch, tracker.settings.grey_noise)
    grey = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
    templates.take(grey, points, np.arange(len(points)))
    return templates.contrast


def _joined(first: Tracks, second: Tracks) -> Tracks:
    """Tracks of both, the first ones first."""
    return Tracks(
        np.concatenate([first.points, second.points], 1),
        np.concatenate([first.visible, second.visible], 1),
        np.concatenate([first.confidence, second.confidence], 1),
        np.concatenate([first.starts, second.starts]),
    )
