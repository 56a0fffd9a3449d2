"""The tracks of an interaction that the search compares with, and their noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.fitting.problem import Problem, TrackObservations
from physreal_core.gap.noise.neighbours import SeenNoise, learnt_noise, trusted
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
        noise: of these positions, learnt from the observed frames; anything where not valid.
    """

    kept: Int[Array, " tracks"]
    points: Float[Array, "frames tracks 3"]
    valid: Bool[Array, "frames tracks"]
    noise: SeenNoise

    @classmethod
    def of(cls, problem: Problem) -> SeenTracks:
        """Those of a problem that has tracks."""
        points0, points, valid = _measured(problem.tracks)
        stated = np.where(valid, problem.tracks.sigma3d.double().numpy(), 1.0)
        valid = trusted(points0, points, valid, stated)
        may_see = valid & (np.arange(len(valid)) < problem.observed)[:, None]
        kept = spread_tracks(points0, may_see)
        noise = learnt_noise(points0[kept], points[:, kept], may_see[:, kept], stated[:, kept])
        return cls(kept, points[:, kept], valid[:, kept], noise)

    @classmethod
    def all(cls, problem: Problem, noise: SeenNoise) -> SeenTracks:
        """All of a problem's tracks, as they are, with noise that is known."""
        points0, points, valid = _measured(problem.tracks)
        return cls(np.arange(len(points0)), points, valid, noise)


def _measured(
    tracks: TrackObservations,
) -> tuple[Float[Array, "tracks 3"], Float[Array, "frames tracks 3"], Bool[Array, "frames tracks"]]:
    """Where tracks are at frame 0 and in every frame [m], and the entries that were measured."""
    points0, points = tracks.points0.double().numpy(), tracks.points3d.double().numpy()
    valid = tracks.valid3d.numpy() & np.isfinite(points).all(-1)
    return points0, np.where(valid[..., None], points, points0), valid
