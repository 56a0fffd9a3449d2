"""An interaction whose rollouts have fewer particles: near one model its predictions are those of the full one."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from functools import partial

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.simulation import States

STIFFNESSES = tuple(np.exp(np.linspace(-0.3, 0.5, 9)).tolist())
"""Factors on Young's modulus among which the one is sought that makes a coarse body move as the full one does."""


class QuickInteraction:
    """An `Interaction` for many rollouts of which only differences matter.

    What fewer particles change at one model, the anchor, is subtracted from every prediction. A coarse body is a little
    softer or stiffer by its discretisation alone; a factor on Young's modulus, chosen at the anchor, makes up for it.

    Args:
        full: gives measurement, setting and motions.
        coarse: gives rollouts.
        scales: factors on fields of the model.
        anchor: the full interaction's prediction under the anchor [m], shape [T, J, 3].
        trial: the anchor.

    Attributes:
        measured, valid, sensor, sigma, correlation, model, config, setting, device, placement, hand_modes: as of `Interaction`, those of
            `full`.
    """

    def __init__(
        self,
        full: Interaction,
        coarse: Interaction,
        scales: dict[str, float],
        anchor: Float[Array, "frames tracks 3"],
        trial: Trial,
    ) -> None:
        self.full, self._coarse, self._scales = full, coarse, scales
        self.measured, self.valid = full.measured, full.valid
        self.sensor, self.sigma, self.correlation = full.sensor, full.sigma, full.correlation
        self.model, self.config, self.setting = full.model, full.config, full.setting
        self.device, self.placement, self.hand_modes = full.device, full.placement, full.hand_modes
        here = coarse.predict([scaled(trial, scales)], len(anchor))[0]
        self._correction = np.where(np.isfinite(here), anchor - here, 0.0)

    @property
    def points0(self) -> Float[Array, "tracks 3"]:
        return self.full.points0

    @property
    def frames(self) -> int:
        return self.full.frames

    @property
    def train(self) -> int:
        return self.full.train

    def predict(
        self, trials: Sequence[Trial], frames: int | None = None, discretisation: Discretisation | None = None
    ) -> Float[Array, "trials frames tracks 3"]:
        """As of `Interaction`, over at most the frames of the anchor."""
        frames = len(self._correction) if frames is None else frames
        found = self._coarse.predict([scaled(trial, self._scales) for trial in trials], frames, discretisation)
        return found + self._correction[:frames]

    def predict_with_start_sensitivity(
        self, trials: Sequence[Trial], frames: int | None = None
    ) -> list[tuple[Float[Array, "frames tracks 3"], Float[Array, "3 frames tracks 3"]]]:
        return self.full.predict_with_start_sensitivity(trials, frames)

    def motion(self, trial: Trial) -> States | None:
        return self.full.motion(trial)

    def coarsened(self, factor: float) -> None:
        """It is coarse already."""


def scaled(trial: Trial, scales: dict[str, float]) -> Trial:
    """The trial with some fields of the model multiplied."""
    changed = {name: trial.fields[name] * factor for name, factor in scales.items() if name in trial.fields}
    return dataclasses.replace(trial, fields={**trial.fields, **changed})


def quick_around(interactions: Sequence[Interaction], anchor: Trial, factor: float) -> list[QuickInteraction] | None:
    """Quick forms over all frames, for differences; None where there is none, or the anchor's rollout fails in the training frames.
    Arguments as of `quick_interactions`."""
    if factor <= 1.0:
        return None
    calls = [partial(own.predict, [anchor]) for own in interactions]
    predicted = [found[0] for found in side_by_side(calls, interactions[0].device)]
    if not all(np.isfinite(found[: own.train]).all() for own, found in zip(interactions, predicted, strict=True)):
        return None
    return quick_interactions(interactions, anchor, predicted, factor)


def quick_interactions(
    interactions: Sequence[Interaction], anchor: Trial, predicted: Sequence[Array], factor: float
) -> list[QuickInteraction] | None:
    """Quick forms of interactions with one object; None where one of them has none.

    Args:
        interactions: the full ones.
        anchor: the trial at which both forms agree.
        predicted: its tracks [m], shape [T, J, 3], one per interaction.
        factor: on the particles' spacing.
    """
    found = [interaction.coarsened(factor) for interaction in interactions]
    if not all(found):
        return None
    coarse, scales = zip(*found, strict=True)
    stiffness = _stiffness(interactions, coarse, scales, anchor, predicted)
    parts = zip(interactions, coarse, scales, predicted, strict=True)
    return [
        QuickInteraction(own, other, {**scale, "youngs_modulus": stiffness}, known, anchor)
        for own, other, scale, known in parts
    ]


def _stiffness(interactions, coarse, scales, anchor: Trial, predicted: Sequence[Array]) -> float:
    """The factor on Young's modulus at which the coarse bodies' tracks are nearest to the full ones' in the training frames."""
    squares, calls = np.zeros(len(STIFFNESSES)), []
    predicted = [known[: own.train] for own, known in zip(interactions, predicted, strict=True)]
    for other, scale, known in zip(coarse, scales, predicted, strict=True):
        trials = [scaled(anchor, {**scale, "youngs_modulus": factor}) for factor in STIFFNESSES]
        calls.append(partial(other.predict, trials, len(known)))
    found = side_by_side(calls, interactions[0].device)
    for own, tracks, known in zip(interactions, found, predicted, strict=True):
        apart = ((tracks - known) ** 2).sum(-1)
        squares += np.nan_to_num(apart[:, own.valid[: len(known)]].sum(1), nan=np.inf)
    lowest = int(np.argmin(squares))
    if not 0 < lowest < len(squares) - 1 or not np.isfinite(squares[lowest - 1 : lowest + 2]).all():
        return STIFFNESSES[lowest]
    before, here, after = squares[lowest - 1 : lowest + 2]
    shift = 0.5 * (before - after) / (before - 2.0 * here + after)
    return float(STIFFNESSES[lowest] * (STIFFNESSES[1] / STIFFNESSES[0]) ** shift)
