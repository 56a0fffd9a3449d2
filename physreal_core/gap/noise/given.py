"""Errors that the records given to a search usually have, and what they change of the tracks.

They are no missing effect. Whoever films knows the moment of a frame to some milliseconds only, a hand's place to some tenths of a
millimetre (`fitting.hand_record`), and where the table lies to a millimetre; a body that swings answers to each by more than that.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS
from physreal_core.gap.interactions.interaction import Interaction, Trial

USUAL: tuple[tuple[str, str, float], ...] = (
    ("grip_lag", "lag", 0.003),
    ("ground_plane", "height", 0.001),
    ("ground_plane", "slope_x", 0.003),
    ("ground_plane", "slope_y", 0.003),
)
"""Effects of the library that every recording has to a small degree: name, coefficient, one standard deviation of it. A hand that the
camera itself has seen has the camera's clock. The table's also stand for what the simulator does not know of it: where a rounded body
touches it, the grid knows a surface to a tenth of its spacing."""

UNDERSIDE = 3.0
"""Factor on the table's, where the body's far side was guessed: what it rests on is then off by 3 to 4 mm in places."""


def changed_by_records(
    experiment: Interaction,
    trials: Sequence[Trial],
    predicted: Sequence[Float[Array, "frames tracks 3"]],
    quick: Interaction | None = None,
) -> list[Float[Array, "records frames tracks 3"]]:
    """For each trial, changes of its tracks by one standard deviation of each usual error of the records [m].

    Left out is what the model or the trial knows already, what has nothing to act on, and what cannot be simulated.

    Args:
        experiment: the interaction.
        trials: the models.
        predicted: their tracks [m], all over the same frames.
        quick: a cheaper form of the interaction, which tells what a displaced hand does; None for the interaction itself.
    """
    frames, of_hand = len(predicted[0]), quick or experiment
    undisplaced = predicted if quick is None else [*quick.predict(trials, frames)]
    by_effects = _changes(experiment, [_by_effects(experiment, trial) for trial in trials], predicted)
    by_hand = _changes(of_hand, [_by_the_hand(experiment, trial) for trial in trials], undisplaced)
    found = [np.concatenate(both) for both in zip(by_effects, by_hand, strict=True)]
    return [changes[np.isfinite(changes).all((1, 2, 3))] for changes in found]


def _changes(
    interaction: Interaction, asked: Sequence[list[Trial]], predicted: Sequence[Float[Array, "frames tracks 3"]]
) -> list[Float[Array, "changes frames tracks 3"]]:
    """What each trial asked for changes of some predicted tracks [m]; all are run together."""
    together = [changed for own in asked for changed in own]
    answers = iter(interaction.predict(together, len(predicted[0])) if together else ())
    return [
        np.stack([next(answers) for _ in own]) - tracks if own else np.zeros((0, *tracks.shape))
        for own, tracks in zip(asked, predicted, strict=True)
    ]


def _by_effects(experiment: Interaction, trial: Trial) -> list[Trial]:
    known = {record["name"] for record in experiment.model.effects} | set(trial.effects)
    setting = experiment.setting
    acts = {
        "grip_lag": setting.hand_acts and not setting.hand_seen,
        "ground_plane": setting.ground_height is not None,
    }
    acting = [usual for usual in USUAL if acts[usual[0]] and usual[0] not in known]
    larger = {"ground_plane": UNDERSIDE} if setting.far_side_guessed else {}
    return [
        replace(trial, effects={**trial.effects, name: EFFECTS[name].dormant | {key: size * larger.get(name, 1.0)}})
        for name, key, size in acting
    ]


def _by_the_hand(experiment: Interaction, trial: Trial) -> list[Trial]:
    """By what is not known of the hand's place: dozens of small and smooth displacements, most of a noise model's rollouts. A coarse body
    answers to them as the full one does (but not to where the table lies, or how far a hand holds)."""
    modes = experiment.hand_modes if experiment.setting.hand_acts else ()
    return [replace(trial, hand=mode[:, None] * axis) for mode in modes for axis in np.eye(3)]
