"""Maps, phases and the sentence for one experiment's training frames, under the search's own noise model."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.gap.comparison import Comparison
from physreal_core.gap.experiment import Experiment
from physreal_core.gap.noise import Noise
from physreal_core.gap.phases import label_phases, on_ground
from physreal_core.gap.where import Where, find_where


def localise(experiment: Experiment, noise: Noise, predicted: Float[Array, "frames tracks 3"]) -> Where:
    """Where a prediction [m] over the training frames disagrees with the measurement."""
    frames, problem, setting = experiment.train, experiment.problem, experiment.setting
    comparison = Comparison(
        simulated=predicted,
        measured=experiment.measured[:frames],
        sigma=experiment.sigma[:frames],
        valid=experiment.valid[:frames],
        fps=setting.fps,
        modes=noise.modes(),
    )
    controllers = setting.controllers[:frames].double().cpu().numpy()
    phases = label_phases(
        predicted,
        setting.fps,
        controllers=controllers,
        held_distance=_held_distance(experiment),
        touching=on_ground(predicted, setting.ground_height, reach=problem.body.spacing),
    )
    return find_where(comparison, phases)


def _held_distance(experiment: Experiment) -> Float[Array, " tracks"] | None:
    """Distance of each track at frame 0 from what holds the body [m], None where nothing does."""
    body, grip, clamps = experiment.problem.body, experiment.problem.grip, experiment.problem.clamps
    held = np.zeros(len(body.x0), bool)
    if grip is not None:
        held[grip.particles] = True
    for clamp in clamps:
        held |= ((body.x0 >= np.asarray(clamp.lower)) & (body.x0 <= np.asarray(clamp.upper))).all(1)
    return cKDTree(body.x0[held]).query(experiment.points0)[0] if held.any() else None
