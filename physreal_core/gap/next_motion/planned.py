"""A recording that has not been made: the object of an interaction, held alike, along another path of the hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.fitting.problem import TrackObservations
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.noise.neighbours import SeenNoise
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
    moved = problem.controllers[:1] + torch.from_numpy(path).to(problem.controllers)[:, None]
    tracks = _tracks(experiment, len(path))
    changed = dataclasses.replace(
        problem, controllers=moved, hand_modes=None, observed=len(path), tracks=tracks, masks=None
    )
    noise = SeenNoise.known(tracks.sigma3d.double().numpy(), experiment.correlation)
    return Experiment(changed, experiment.model, experiment.device, experiment.placement, noise)


def _tracks(experiment: Experiment, frames: int) -> TrackObservations:
    own = experiment.problem.tracks
    seen = np.flatnonzero(experiment.valid.any(0))
    kept = seen[farthest_points(experiment.points0[seen], min(TRACKS, len(seen)))]
    share = experiment.valid[1:, seen].mean()
    typical = np.array([np.median(experiment.sigma[experiment.valid[:, track], track]) for track in kept])
    sigma = typical * np.sqrt(len(kept) / (len(seen) * share))
    tracks = own.only(kept)
    return dataclasses.replace(
        tracks,
        points3d=tracks.points0.expand(frames, -1, -1),
        valid3d=torch.ones(frames, len(kept), dtype=torch.bool),
        sigma3d=torch.from_numpy(sigma).to(own.sigma3d).expand(frames, -1),
        points2d=None,
        visible=None,
    )
