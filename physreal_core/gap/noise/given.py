"""Errors that the records given to a search usually have, and what they change of the tracks.

They are no missing effect: whoever films knows the moment of a frame to some milliseconds only.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS
from physreal_core.gap.interactions.interaction import Interaction, Trial

USUAL: Mapping[str, Mapping[str, float]] = MappingProxyType({"grip_lag": MappingProxyType({"lag": 0.003})})
"""Effects of the library that every recording has to a small degree, with one standard deviation of it."""


def changed_by_records(
    experiment: Interaction, trial: Trial, predicted: Float[Array, "frames tracks 3"]
) -> Float[Array, "records frames tracks 3"]:
    """Changes of a trial's tracks by one standard deviation of each usual error of the records [m].

    Left out is what the model or the trial knows already, what has nothing to act on, and what cannot be simulated. A hand that
    the camera itself has seen has the camera's clock.

    Args:
        experiment: the interaction.
        trial: the model.
        predicted: its tracks [m].
    """
    if experiment.setting.hand_seen:
        return np.zeros((0, *predicted.shape))
    known = {record["name"] for record in experiment.model.effects} | set(trial.effects)
    acting = [name for name in USUAL if name not in known and EFFECTS[name].starts(experiment.setting)]
    trials = [Trial(trial.fields, {**trial.effects, name: dict(USUAL[name])}) for name in acting]
    changes = experiment.predict(trials, len(predicted)) - predicted if trials else np.zeros((0, *predicted.shape))
    return changes[np.isfinite(changes).all((1, 2, 3))]
