"""Errors that the records given to a search usually have, and what they change of the tracks.

They are no missing effect. Whoever films knows the moment of a frame to some milliseconds only, and a hand's place to some tenths of a
millimetre (`fitting.hand_record`); a body that swings answers to either by more than that.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.interaction import Interaction, Trial

USUAL: Mapping[str, Mapping[str, float]] = MappingProxyType({"grip_lag": MappingProxyType({"lag": 0.003})})
"""Effects of the library that every recording has to a small degree, with one standard deviation of it. A hand that the camera itself has
seen has the camera's clock."""


def changed_by_records(
    experiment: Interaction, trial: Trial, predicted: Float[Array, "frames tracks 3"]
) -> Float[Array, "records frames tracks 3"]:
    """Changes of a trial's tracks by one standard deviation of each usual error of the records [m].

    Left out is what the model or the trial knows already, what has nothing to act on, and what cannot be simulated.

    Args:
        experiment: the interaction.
        trial: the model.
        predicted: its tracks [m].
    """
    if experiment.setting.grip is None:
        return np.zeros((0, *predicted.shape))
    changes = np.concatenate([_by_effects(experiment, trial, predicted), _by_the_hand(experiment, trial, predicted)])
    return changes[np.isfinite(changes).all((1, 2, 3))]


def _by_effects(experiment: Interaction, trial: Trial, predicted: Array) -> Float[Array, "effects frames tracks 3"]:
    known = {record["name"] for record in experiment.model.effects} | set(trial.effects)
    acting = [] if experiment.setting.hand_seen else [name for name in USUAL if name not in known]
    trials = [Trial(trial.fields, {**trial.effects, name: dict(USUAL[name])}) for name in acting]
    return experiment.predict(trials, len(predicted)) - predicted if trials else np.zeros((0, *predicted.shape))


def _by_the_hand(experiment: Interaction, trial: Trial, predicted: Array) -> Float[Array, "modes frames tracks 3"]:
    """By what is not known of the hand's place. Not in quick rollouts: a body that swings for seconds comes out of phase with a
    coarser one."""
    modes = experiment.hand_open
    displaced = [Trial(trial.fields, trial.effects, mode[:, None] * axis) for mode in modes for axis in np.eye(3)]
    return experiment.predict(displaced, len(predicted)) - predicted if displaced else np.zeros((0, *predicted.shape))
