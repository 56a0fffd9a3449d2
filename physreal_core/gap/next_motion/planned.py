"""A recording that has not been made: the object of an interaction, held alike, along another path of the hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int
from physreal_core.fitting.problem import TrackObservations
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.noise.sensor import Sensor
from physreal_core.geometry import farthest_points

TRACKS = 30
"""Tracks that stand for all. What is predicted is smooth over the body; their noise is smaller by as many as they stand for."""


def planned_experiment(experiment: Experiment, path: Float[Array, "frames 3"]) -> Experiment:
    """The interaction with the hand on another path, and a measurement as good as its own.

    Every kept track counts in every frame. Its noise is the track's median one, made smaller by the number of tracks
    that it stands for and larger by the share of entries that the recording lacks. So the planned frames hold as much
    information as such a recording would.

    Args:
        experiment: gives the body, its hold, its tracks and what is known of its material.
        path: displacement of the hand since frame 0 [m].
    """
    problem = experiment.problem
    kept = _standing_for_all(experiment)
    moved = problem.controllers[:1] + torch.from_numpy(path).to(problem.controllers)[:, None]
    changed = dataclasses.replace(
        problem,
        controllers=moved,
        hand_modes=None,
        observed=len(path),
        tracks=_as_in_frame_0(problem.tracks.of(kept), len(path)),
        masks=None,
    )
    sensor = _sensor(experiment, kept, len(path))
    return Experiment(changed, experiment.model, experiment.device, experiment.placement, sensor)


def _standing_for_all(experiment: Experiment) -> Int[Array, " kept"]:
    seen = np.flatnonzero(experiment.valid.any(0))
    return seen[farthest_points(experiment.points0[seen], min(TRACKS, len(seen)))]


def _as_in_frame_0(tracks: TrackObservations, frames: int) -> TrackObservations:
    """Tracks that are measured in every frame, where they were in frame 0."""
    known = torch.ones(frames, len(tracks.points0), dtype=torch.bool)
    own = {"points3d": tracks.points0.expand(frames, -1, -1), "valid3d": known, "sigma3d": known.to(tracks.sigma3d)}
    return dataclasses.replace(tracks, **own, points2d=None, visible=None)


def _sensor(experiment: Experiment, kept: Int[Array, " kept"], frames: int) -> Sensor:
    """The noise of kept tracks as if they were all; its axes stay as in frame 0."""
    own, seen = experiment.sensor, experiment.valid.any(0)
    share = experiment.valid[1:, seen].mean()
    typical = np.array([np.median(own.sigma[experiment.valid[:, track], track], axis=0) for track in kept])
    sigma = typical * np.sqrt(len(kept) / (seen.sum() * share))
    axes = None if own.axes is None else np.repeat(own.axes[:1, kept], frames, axis=0)
    return Sensor(np.repeat(sigma[None], frames, axis=0), own.correlation, axes)
