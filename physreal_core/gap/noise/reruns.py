"""What reruns of the same model change: other discretisations, which show its numerical error, and other guesses of what was not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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

GUESSES = (
    Discretisation("a smaller hold", hold=0.8),
    Discretisation("a larger hold", hold=1.25),
    Discretisation("less of what was not seen", matter=0.7),
    Discretisation("more of what was not seen", matter=1.4),
)
"""Each changes one thing that was guessed from what a camera saw, by one standard deviation: how far around its points a hand holds, and
the far side of a body without a given shape.

The tracks change in proportion to these steps, about. A hand that reaches 0.6 times as far holds a fifth of what it held, and a body
slips out of it.
"""

STEP, FARTHEST, ROUNDS = 0.01, 0.2, 2
"""Of the logarithm of the modulus: the step of its derivative, and how far it may go from the model's; how often it is improved."""


def rerun_differences(
    experiment: Interaction,
    trials: Sequence[Trial],
    predicted: Sequence[Float[Array, "frames tracks 3"]],
    moduli: Mapping[str, float],
    reruns: Sequence[Discretisation] = RERUNS,
) -> list[Float[Array, "modes frames tracks 3"]]:
    """For each trial, what each rerun changes of its tracks [m]; of another discretisation, an estimate of the numerical error.

    A rerun that fails is left out, and so is the model's own law. Known effects with a direction of their own do not turn
    with the body, and clamps stay in place; with either, the turned grid is left out.

    Args:
        experiment: the interaction.
        trials: the models.
        predicted: their tracks in their own discretisation [m], all over the same frames.
        moduli: as of `nearest_moduli`.
        reruns: the discretisations that are tried.
    """
    frames, found = len(predicted[0]), [[] for _ in trials]
    acting = [(rerun, [n for n, trial in enumerate(trials) if _tells(rerun, experiment, trial)]) for rerun in reruns]
    asked = [(rerun, own) for rerun, own in acting if own]
    calls = []
    for rerun, own in asked:
        stiffer = [_stiffer(trials[number], moduli.get(rerun.name, 0.0)) for number in own]
        calls.append(partial(experiment.predict, stiffer, frames, rerun))
    for (rerun, own), answers in zip(asked, side_by_side(calls, experiment.device), strict=True):
        for number, tracks in zip(own, answers, strict=True):
            found[number].append(rerun.error * (tracks - predicted[number]))
    finite = [[difference for difference in own if np.isfinite(difference).all()] for own in found]
    return [
        np.stack(own) if own else np.zeros((0, *tracks.shape)) for own, tracks in zip(finite, predicted, strict=True)
    ]


def nearest_moduli(
    experiment: Interaction,
    trial: Trial,
    predicted: Float[Array, "frames tracks 3"],
    reruns: Sequence[Discretisation] = RERUNS,
) -> dict[str, float]:
    """By the name of a rerun, the logarithm of the factor on Young's modulus that brings its tracks nearest to a model's.

    Another grid is a little stiffer or softer, and a body that swings for seconds comes out of phase with it; but whatever a modulus
    takes up, any fit takes up, and it hides no effect.

    Args:
        experiment, reruns: as of `rerun_differences`.
        trial: the model.
        predicted: its tracks in its own discretisation [m].
    """
    (beside,) = experiment.predict([_stiffer(trial, STEP)], len(predicted))
    slope = np.nan_to_num(beside - predicted) / STEP
    usable = [rerun for rerun in reruns if _tells(rerun, experiment, trial)]
    calls = [partial(_nearest, experiment, trial, predicted, slope, rerun) for rerun in usable]
    return dict(zip((rerun.name for rerun in usable), side_by_side(calls, experiment.device), strict=True))


def _tells(rerun: Discretisation, experiment: Interaction, trial: Trial) -> bool:
    """Whether a rerun of a trial differs from it by what it stands for alone, and at all. A thin body has no grid and a law of its own,
    and is held between a hand's points and not around them."""
    changed = (rerun.cell, rerun.turn, rerun.elastic_law, rerun.hold)
    if experiment.setting.body.elements is not None and changed != (1.0, 0.0, None, 1.0):
        return False
    grip = experiment.setting.grip
    if rerun.hold != 1.0 and not (experiment.setting.all_seen and grip is not None and grip.steady):
        return False
    if rerun.matter != 1.0 and not experiment.setting.far_side_guessed:
        return False
    stays = bool(experiment.model.effects or trial.effects or experiment.setting.clamps)
    own_law = trial.elastic_law or experiment.model.elastic_law
    return not (stays and rerun.turn != 0.0) and rerun.elastic_law != own_law


def _nearest(experiment: Interaction, trial: Trial, predicted: Array, slope: Array, rerun: Discretisation) -> float:
    """The logarithm of the factor on the modulus for one rerun, by Gauss-Newton's steps with the slope of the model's own tracks [m]."""
    modulus, best, least = 0.0, 0.0, np.inf
    valid = experiment.valid[: len(predicted)]
    for _ in range(ROUNDS):
        (tracks,) = experiment.predict([_stiffer(trial, modulus)], len(predicted), rerun)
        off, along = (tracks - predicted)[valid], slope[valid]
        if not (off**2).sum() < least or not along.any():
            return best
        best, least = modulus, float((off**2).sum())
        modulus = float(np.clip(best - (along * off).sum() / (along**2).sum(), -FARTHEST, FARTHEST))
    return modulus


def _stiffer(trial: Trial, by: float) -> Trial:
    """The trial with a modulus of so much larger logarithm."""
    modulus = trial.fields["youngs_modulus"]
    return replace(trial, fields={**trial.fields, "youngs_modulus": modulus * float(np.exp(by))})
