"""What a lead is found from: departures of the interactions, and responses of their tracks to forces on the body."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Trial
from physreal_core.gap.lead.departure import Departure
from physreal_core.gap.lead.lead import Lead, find_lead
from physreal_core.gap.lead.responses import step_responses
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.noise.model import Noise
from physreal_core.geometry.patches import farthest_points, patch_weights


def lead_on(measurements: Measurements, baseline: Trial, predicted: Sequence[Float[Array, "frames tracks 3"]]) -> Lead:
    """A lead on the disagreement of all interactions that our simulator rolls out.

    Args:
        measurements: of the search.
        baseline: the rollout of the model.
        predicted: tracks under it over all frames of each interaction [m].

    Raises:
        InputError: scikit-learn is not installed, a rollout could not go on, or no interaction is an `Experiment`.
    """
    departures = [
        departure_of(
            experiment, baseline, predicted[number], measurements.train.noises[number], measurements.held_out(number)
        )
        for number, experiment in enumerate(measurements.experiments)
        if isinstance(experiment, Experiment)
    ]
    return find_lead(departures)


def departure_of(
    experiment: Experiment,
    baseline: Trial,
    predicted: Float[Array, "frames tracks 3"],
    train: Noise,
    held_out: Noise | None,
    *,
    regions: int = 8,
) -> Departure:
    """What `find_lead` takes, of one interaction. It costs a batch of 3 `regions` + 1 rollouts.

    Args:
        experiment: the interaction.
        baseline: the rollout of the model.
        predicted: tracks under it over all frames [m].
        train, held_out: noise models of the training and of the held-out frames; None where nothing is held out.
        regions: parts of the body that have a force of their own.
    """
    problem = experiment.problem
    x0 = problem.body.x0
    near, shares = patch_weights(x0, farthest_points(x0, regions), min(4, regions))
    weights = np.zeros((len(x0), int(near.max()) + 1))
    np.put_along_axis(weights, near, shares, axis=1)
    own = experiment.model
    model = dataclasses.replace(own, fields=baseline.fields, elastic_law=baseline.elastic_law or own.elastic_law)
    binding = problem.tracks.binding
    carriers, share = (np.asarray(a) for a in (binding.neighbours, binding.weights))
    return Departure(
        simulated=predicted,
        measured=experiment.measured,
        valid=experiment.valid,
        fps=experiment.setting.fps,
        responses=step_responses(problem, model, weights, device=experiment.device),
        weights=np.einsum("jk,jkr->jr", share, weights[carriers]),
        train=train.whiten,
        held_out=_no_entries if held_out is None else held_out.whiten,
    )


def _no_entries(fields: Float[Array, "C T J 3"]) -> Float[Array, "0 C"]:
    return np.zeros((0, len(fields)))
