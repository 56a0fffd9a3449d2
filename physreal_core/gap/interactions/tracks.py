"""The tracks of an interaction that the search compares with, and the noise of their sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.fitting.problem import Problem
from physreal_core.gap.noise.neighbours import learnt_sensor, trusted
from physreal_core.gap.noise.sensor import Sensor
from physreal_core.geometry import farthest_points

LARGEST = 150
"""Tracks that stand for all. The model's error is smooth over the body, so that more of them tell little more and cost as much again."""

WELL_SEEN = 0.5
"""Share of the best seen track's frames from which on a track may stand for others."""


def spread_tracks(points0: Float[Array, "tracks 3"], valid: Bool[Array, "frames tracks"]) -> Int[Array, " kept"]:
    """Numbers of at most `LARGEST` tracks: all, or well seen ones that lie far from each other.

    Args:
        points0: where they are in frame 0 [m].
        valid: entries that a fit may see.
    """
    seen = valid.sum(0)
    if len(seen) <= LARGEST:
        return np.arange(len(seen))
    good = np.flatnonzero(seen >= WELL_SEEN * seen.max())
    return np.sort(good[farthest_points(points0[good], LARGEST)])


@dataclass(frozen=True)
class SeenTracks:
    """The tracks of a problem that the search compares with; `of` chooses them.

    Args:
        kept: their numbers.
        points: measured positions [m], those of frame 0 where nothing was measured.
        valid: entries with a measured position that has not slipped off the body.
        sensor: its noise, learnt from the observed frames; of tracks that a camera saw across and along its line of sight.
    """

    kept: Int[Array, " tracks"]
    points: Float[Array, "frames tracks 3"]
    valid: Bool[Array, "frames tracks"]
    sensor: Sensor

    @classmethod
    def of(cls, problem: Problem, sensor: Sensor | None = None) -> SeenTracks:
        """Those of a problem that has tracks.

        Args:
            problem: gives the tracks and, where there is one, the camera.
            sensor: of all tracks, if its noise is known.
        """
        tracks, known = problem.tracks, slice(1, problem.observed)
        points0, points = tracks.points0.double().numpy(), tracks.points3d.double().numpy()
        valid = tracks.valid3d.numpy() & np.isfinite(points).all(-1)
        points = np.where(valid[..., None], points, points0)
        stated = np.where(valid, tracks.sigma3d.double().numpy(), 1.0)
        by_camera = problem.camera is not None and tracks.points2d is not None
        axes = sight_axes(points, problem.camera.T_world_camera.detach().cpu().numpy()) if by_camera else None
        valid = trusted(points0, points, valid, stated, axes)
        kept = spread_tracks(points0, valid[known])
        points, valid, stated = points[:, kept], valid[:, kept], stated[:, kept]
        if sensor is None:
            axes = None if axes is None else axes[:, kept]
            found = learnt_sensor(points0[kept], points, valid, stated, axes, problem.observed)
        else:
            found = sensor.of(kept)
        return cls(kept, points, valid, found)


def sight_axes(points: Float[Array, "*entries 3"], T_world_camera: Float[Array, "4 4"]) -> Float[Array, "*entries 3 3"]:
    """Axes at each point as rows: two across the camera's line of sight, the first near the image's rows, and the line itself."""
    along = points - T_world_camera[:3, 3]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    row = T_world_camera[:3, 0]
    across = row - (along @ row)[..., None] * along
    across = across / np.linalg.norm(across, axis=-1, keepdims=True)
    return np.stack([across, np.cross(along, across), along], axis=-2)
