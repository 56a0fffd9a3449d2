"""Where a model disagrees with the measurement of one interaction, with the search's own noise model."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.effects import Setting
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.noise.model import Noise
from physreal_core.gap.where.comparison import Comparison
from physreal_core.gap.where.findings import Where
from physreal_core.gap.where.phases import label_phases, on_ground
from physreal_core.gap.where.where import find_where


def locate(
    experiment: Interaction, predicted: Float[Array, "frames tracks 3"], noise: Noise, *, overdispersion: float = 1.0
) -> Where:
    """Where a model disagrees with the tracks of an interaction, over the frames of its noise model.

    Args:
        experiment: the interaction.
        predicted: tracks under the model [m], over at least the noise model's frames; those from one on in which the model breaks off
            are left out.
        noise: of the same interaction; its valid entries are compared.
        overdispersion: as of `agreement`.
    """
    whole = np.isfinite(predicted[: noise.frames]).all((1, 2))
    frames, setting = len(whole) if whole.all() else int(np.argmin(whole)), experiment.setting
    simulated, valid = predicted[:frames].astype(np.float64), noise.valid[:frames]
    comparison = Comparison(
        simulated=simulated,
        measured=experiment.measured[:frames],
        sigma=experiment.sigma[:frames],
        valid=valid,
        fps=setting.fps,
        modes=noise.modes()[:, : int(valid.sum())],
    )
    phases = label_phases(
        simulated,
        setting.fps,
        controllers=setting.controllers[:frames].double().cpu().numpy(),
        held_distance=held_distance(experiment.points0, setting),
        touching=on_ground(simulated, setting.ground_height, setting.body.spacing),
    )
    return find_where(comparison, phases, overdispersion=overdispersion)


def held_distance(points0: Float[Array, "tracks 3"], setting: Setting) -> Float[Array, " tracks"] | None:
    """Distance of each point at frame 0 from the nearest gripped particle or clamp [m]; None without grip and clamp."""
    boxes = [(np.asarray(clamp.lower, float), np.asarray(clamp.upper, float)) for clamp in setting.clamps]
    distances = [_distance_to_box(points0, *box) for box in boxes]
    if setting.grip is not None and len(setting.grip.particles):
        gripped = setting.body.x0[np.unique(setting.grip.particles)]
        distances.append(cKDTree(gripped).query(points0)[0])
    return np.min(distances, axis=0) if distances else None


def _distance_to_box(points: Array, lower: Array, upper: Array) -> Array:
    return np.linalg.norm(np.maximum(0.0, np.maximum(lower - points, points - upper)), axis=1)
