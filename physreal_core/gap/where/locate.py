"""Where a model disagrees with the measurement of one interaction, and what the disagreement looks like as a force, with the
search's own model of noise and error."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects import Setting
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.gap.lead.lead import Lead, Scene, find_lead
from physreal_core.gap.lead.responses import step_responses
from physreal_core.gap.noise.evidence import Evidence
from physreal_core.gap.noise.model import Noise
from physreal_core.gap.where.comparison import Comparison
from physreal_core.gap.where.phases import label_phases, on_ground
from physreal_core.gap.where.where import Where, find_where
from physreal_core.geometry.patches import farthest_points, patch_weights


def locate(
    experiment: Interaction, predicted: Float[Array, "frames tracks 3"], noise: Noise, *, overdispersion: float = 1.0
) -> Where:
    """Where a model disagrees with the tracks of an experiment, over the frames of its noise model.

    Args:
        experiment: the interaction.
        predicted: the tracks under the model [m], over at least the noise model's frames.
        noise: of the same experiment; its valid entries are those that are looked at.
        overdispersion: as of `agreement`.
    """
    frames, setting = noise.frames, experiment.setting
    simulated = predicted[:frames].astype(np.float64)
    comparison = Comparison(
        simulated=simulated,
        measured=experiment.measured[:frames],
        sigma=experiment.sigma[:frames],
        valid=noise.valid,
        fps=setting.fps,
        modes=noise.modes(),
    )
    phases = label_phases(
        simulated,
        setting.fps,
        controllers=setting.controllers[:frames].double().cpu().numpy(),
        held_distance=held_distance(experiment.points0, setting),
        touching=on_ground(simulated, setting.ground_height, setting.body.spacing),
    )
    return find_where(comparison, phases, overdispersion=overdispersion)


def force_scene(
    experiment: Experiment,
    fields: dict[str, Tensor],
    predicted: Float[Array, "frames tracks 3"],
    train: Noise,
    held_out: Noise | None,
    *,
    regions: int = 8,
) -> Scene:
    """What `find_lead` takes, from one experiment; costs a batch of 3 `regions` + 1 rollouts.

    Args:
        experiment: the interaction.
        fields: of the baseline, as of `Model.fields`.
        predicted: the tracks under it [m], shape [T, J, 3], over all frames.
        train, held_out: noise models of the training and of the held-out frames; None where nothing is held out.
        regions: parts of the body that have a force of their own.
    """
    problem = experiment.problem
    x0 = problem.body.x0
    near, shares = patch_weights(x0, farthest_points(x0, regions), min(4, regions))
    weights = np.zeros((len(x0), int(near.max()) + 1))
    np.put_along_axis(weights, near, shares, axis=1)
    model = dataclasses.replace(experiment.model, fields=fields)
    binding = problem.tracks.binding
    carriers, share = (np.asarray(a) for a in (binding.neighbours, binding.weights))
    return Scene(
        simulated=predicted,
        measured=experiment.measured,
        valid=experiment.valid,
        fps=experiment.setting.fps,
        responses=step_responses(problem, model, weights, device=experiment.device),
        weights=np.einsum("jk,jkr->jr", share, weights[carriers]),
        train=train.whiten,
        held_out=_nothing if held_out is None else held_out.whiten,
    )


def lead_on(
    evidence: Evidence, fields: dict[str, Tensor], predicted: Sequence[Float[Array, "frames tracks 3"]]
) -> Lead:
    """The disagreement of all interactions that our simulator rolls out, as a force field and a formula.

    Args:
        evidence: of the search.
        fields: of the baseline, as of `Model.fields`.
        predicted: the tracks under it, over all frames of each interaction [m].

    Raises:
        InputError: scikit-learn is not installed, a rollout could not go on, or no interaction is an `Experiment`.
    """
    scenes = [
        force_scene(experiment, fields, predicted[number], evidence.train.noises[number], evidence.held_out(number))
        for number, experiment in enumerate(evidence.experiments)
        if isinstance(experiment, Experiment)
    ]
    return find_lead(scenes)


def _nothing(fields: Float[Array, "C T J 3"]) -> Float[Array, "0 C"]:
    return np.zeros((0, len(fields)))


def held_distance(points0: Float[Array, "tracks 3"], setting: Setting) -> Float[Array, " tracks"] | None:
    """Distance [m] of each point at frame 0 from the nearest gripped particle or clamp; None where nothing holds the body."""
    boxes = [(np.asarray(clamp.lower, float), np.asarray(clamp.upper, float)) for clamp in setting.clamps]
    distances = [_distance_to_box(points0, *box) for box in boxes]
    if setting.grip is not None and len(setting.grip.particles):
        held = setting.body.x0[np.unique(setting.grip.particles)]
        distances.append(cKDTree(held).query(points0)[0])
    return np.min(distances, axis=0) if distances else None


def _distance_to_box(points: Array, lower: Array, upper: Array) -> Array:
    return np.linalg.norm(np.maximum(0.0, np.maximum(lower - points, points - upper)), axis=1)
