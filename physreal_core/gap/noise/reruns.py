"""The simulator's numerical error, from reruns of the same model in other discretisations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction, Trial

RERUNS = (
    Discretisation("half the time step", courant=0.5, error=2.0),
    Discretisation("a coarser grid", cell=1.2, error=1.0 / (1.2**2 - 1.0)),
    Discretisation("a finer grid", cell=0.85, error=1.0 / (1.0 - 0.85**2)),
    Discretisation("a turned grid", turn=0.5),
    Discretisation("another law of the same stiffness", elastic_law="hencky"),
)
"""Each changes one thing that a converged solution does not depend on (the law: at small strain).

The scheme is of second order in space and of first order in time, so the difference between two grids or steps gives the
distance to the limit (Richardson's extrapolation).
"""

STEP, FARTHEST, ROUNDS = 0.01, 0.2, 2
"""Of the logarithm of the modulus: the step of its derivative, and how far it may go from the model's; how often it is improved."""


def rerun_differences(
    experiment: Interaction,
    trial: Trial,
    predicted: Float[Array, "frames tracks 3"],
    reruns: Sequence[Discretisation] = RERUNS,
) -> Float[Array, "modes frames tracks 3"]:
    """Estimates of the numerical error of a trial's tracks [m], one per rerun.

    A rerun has the modulus with which its tracks are nearest to the model's. Another grid is a little stiffer or softer, and a body
    that swings for seconds comes out of phase with it; but whatever a modulus takes up, any fit takes up, and it hides no effect.

    A rerun that fails is left out, and so is the model's own law. Known effects with a direction of their own do not turn
    with the body, and clamps stay in place; with either, the turned grid is left out.

    Args:
        experiment: the interaction.
        trial: the model.
        predicted: its tracks in its own discretisation [m], over the frames that count.
        reruns: the discretisations that are tried.
    """
    stays = bool(experiment.model.effects or trial.effects or experiment.setting.clamps)
    usable = [rerun for rerun in reruns if not stays or rerun.turn == 0.0]
    own_law = trial.elastic_law or experiment.model.elastic_law
    usable = [rerun for rerun in usable if rerun.elastic_law != own_law]
    frames = len(predicted)
    beside = experiment.predict([_stiffer(trial, STEP)], frames)[0]
    slope = np.nan_to_num((beside - predicted)[experiment.valid[:frames]]) / STEP
    found = [rerun.error * (_nearest(experiment, trial, predicted, slope, rerun) - predicted) for rerun in usable]
    finite = [difference for difference in found if np.isfinite(difference).all()]
    return np.stack(finite) if finite else np.zeros((0, *predicted.shape))


def _nearest(
    experiment: Interaction, trial: Trial, predicted: Array, slope: Array, rerun: Discretisation
) -> Float[Array, "frames tracks 3"]:
    """Tracks of a rerun [m] with the modulus that brings them nearest to the predicted ones.

    Args:
        experiment, trial, predicted, rerun: as for `rerun_differences`.
        slope: derivative of the predicted tracks by the logarithm of the modulus [m], at the valid entries.
    """
    modulus, nearest, least, frames = 0.0, predicted * np.nan, np.inf, len(predicted)
    for _ in range(ROUNDS + 1):
        tracks = experiment.predict([_stiffer(trial, modulus)], frames, rerun)[0]
        off = (tracks - predicted)[experiment.valid[:frames]]
        if not (off**2).sum() < least:
            break
        nearest, least = tracks, (off**2).sum()
        if not slope.any():
            break
        modulus = float(np.clip(modulus - (slope * off).sum() / (slope**2).sum(), -FARTHEST, FARTHEST))
    return nearest


def _stiffer(trial: Trial, by: float) -> Trial:
    """The trial with a modulus of so much larger logarithm."""
    modulus = trial.fields["youngs_modulus"]
    return replace(trial, fields={**trial.fields, "youngs_modulus": modulus * float(np.exp(by))})
