"""Where a model disagrees with the measurement of one interaction: `where` with the search's own model of noise and error."""

from __future__ import annotations

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.fitting.problem import Problem
from physreal_core.gap.comparison import Comparison
from physreal_core.gap.experiment import Experiment
from physreal_core.gap.noise import Noise
from physreal_core.gap.phases import label_phases, on_ground
from physreal_core.gap.where import Where, find_where


def locate(
    experiment: Experiment, predicted: Float[Array, "frames tracks 3"], noise: Noise, *, overdispersion: float = 1.0
) -> Where:
    """Where a model disagrees with the tracks of an experiment, over the frames of its noise model.

    Args:
        experiment: the interaction.
        predicted: the tracks under the model [m], over at least the noise model's frames.
        noise: of the same experiment; its valid entries are those that are looked at.
        overdispersion: as of `agreement`.
    """
    frames = noise.frames
    simulated = predicted[:frames].astype(np.float64)
    comparison = Comparison(
        simulated=simulated,
        measured=experiment.measured[:frames],
        sigma=experiment.sigma[:frames],
        valid=noise.valid,
        fps=experiment.setting.fps,
        modes=noise.modes(),
    )
    phases = label_phases(
        simulated,
        experiment.setting.fps,
        controllers=experiment.problem.controllers[:frames].double().numpy(),
        held_distance=held_distance(experiment.problem),
        touching=on_ground(simulated, experiment.setting.ground_height, experiment.problem.body.spacing),
    )
    return find_where(comparison, phases, overdispersion=overdispersion)


def held_distance(problem: Problem) -> Float[Array, " tracks"] | None:
    """Distance [m] of each track at frame 0 from the nearest gripped particle or clamp; None where nothing holds the body."""
    points = problem.tracks.points0.double().numpy()
    distances = [_distance_to_box(points, *(np.asarray(c, float) for c in (k.lower, k.upper))) for k in problem.clamps]
    if problem.grip is not None and len(problem.grip.particles):
        held = problem.body.x0[np.unique(problem.grip.particles)]
        distances.append(np.linalg.norm(points[:, None] - held[None], axis=2).min(1))
    return np.min(distances, axis=0) if distances else None


def _distance_to_box(points: Array, lower: Array, upper: Array) -> Array:
    return np.linalg.norm(np.maximum(0.0, np.maximum(lower - points, points - upper)), axis=1)
