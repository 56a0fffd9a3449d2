"""The simulator's numerical error, from reruns of the same model in other discretisations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side

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
    trials: Sequence[Trial],
    predicted: Sequence[Float[Array, "frames tracks 3"]],
    reruns: Sequence[Discretisation] = RERUNS,
) -> list[Float[Array, "modes frames tracks 3"]]:
    """For each trial, estimates of the numerical error of its tracks [m], one per rerun.

    A rerun has the modulus with which its tracks are nearest to the model's. Another grid is a little stiffer or softer, and a body
    that swings for seconds comes out of phase with it; but whatever a modulus takes up, any fit takes up, and it hides no effect.

    A rerun that fails is left out, and so is the model's own law. Known effects with a direction of their own do not turn
    with the body, and clamps stay in place; with either, the turned grid is left out.

    Args:
        experiment: the interaction.
        trials: the models.
        predicted: their tracks in their own discretisation [m], all over the same frames.
        reruns: the discretisations that are tried.
    """
    frames = len(predicted[0])
    beside = experiment.predict([_stiffer(trial, STEP) for trial in trials], frames)
    slopes = [np.nan_to_num(moved - tracks) / STEP for moved, tracks in zip(beside, predicted, strict=True)]
    known = [*zip(trials, predicted, slopes, strict=True)]
    found: list[list[Array]] = [[] for _ in trials]
    usable = [[number for number, trial in enumerate(trials) if _tells(rerun, experiment, trial)] for rerun in reruns]
    calls = [
        partial(_nearest, experiment, [known[n] for n in own], rerun) for own, rerun in zip(usable, reruns, strict=True)
    ]
    for rerun, own, nearest in zip(reruns, usable, side_by_side(calls, experiment.device), strict=True):
        for number, tracks in zip(own, nearest, strict=True):
            found[number].append(rerun.error * (tracks - predicted[number]))
    finite = [[difference for difference in own if np.isfinite(difference).all()] for own in found]
    return [
        np.stack(own) if own else np.zeros((0, *tracks.shape)) for own, tracks in zip(finite, predicted, strict=True)
    ]


def _tells(rerun: Discretisation, experiment: Interaction, trial: Trial) -> bool:
    """Whether a rerun of a trial differs from it by a numerical error alone, and at all. A thin body has no grid and a law of its own."""
    if experiment.setting.body.elements is not None and (rerun.cell, rerun.turn, rerun.elastic_law) != (1.0, 0.0, None):
        return False
    stays = bool(experiment.model.effects or trial.effects or experiment.setting.clamps)
    own_law = trial.elastic_law or experiment.model.elastic_law
    return not (stays and rerun.turn != 0.0) and rerun.elastic_law != own_law


def _nearest(
    experiment: Interaction, known: Sequence[tuple[Trial, Array, Array]], rerun: Discretisation
) -> list[Float[Array, "frames tracks 3"]]:
    """Tracks of reruns [m], each with the modulus that brings them nearest to the predicted ones.

    Args:
        experiment, rerun: as for `rerun_differences`.
        known: trials with their predicted tracks [m], and the derivative of these by the logarithm of the modulus [m].
    """
    moduli, least = np.zeros(len(known)), np.full(len(known), np.inf)
    nearest, left = [predicted * np.nan for _, predicted, _ in known], list(range(len(known)))
    for _ in range(ROUNDS + 1):
        if not left:
            break
        trials = [_stiffer(known[number][0], moduli[number]) for number in left]
        going = []
        for number, tracks in zip(left, experiment.predict(trials, len(nearest[0]), rerun), strict=True):
            _, predicted, slope = known[number]
            valid = experiment.valid[: len(predicted)]
            off, along = (tracks - predicted)[valid], slope[valid]
            if not (off**2).sum() < least[number]:
                continue
            nearest[number], least[number] = tracks, (off**2).sum()
            if along.any():
                step = (along * off).sum() / (along**2).sum()
                moduli[number] = np.clip(moduli[number] - step, -FARTHEST, FARTHEST)
                going.append(number)
        left = going
    return nearest


def _stiffer(trial: Trial, by: float) -> Trial:
    """The trial with a modulus of so much larger logarithm."""
    modulus = trial.fields["youngs_modulus"]
    return replace(trial, fields={**trial.fields, "youngs_modulus": modulus * float(np.exp(by))})
