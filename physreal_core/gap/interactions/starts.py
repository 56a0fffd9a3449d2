"""Values from which fits of an effect start, by an interaction, with places and directions of the first interaction."""

from __future__ import annotations

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import Effect
from physreal_core.gap.interactions.interaction import Interaction
from physreal_core.simulation import States

Starts = tuple[dict[str, float], ...]


def starts_of(interaction: Interaction, effect: Effect, motion: States | None = None) -> Starts:
    """`Effect.starts` for an interaction."""
    return _in_the_first(interaction, effect, effect.starts(interaction.setting, motion))


def replacement_starts_of(
    interaction: Interaction, effect: Effect, other: Effect, values: dict[str, float], motion: States | None
) -> Starts:
    """`Effect.replacement_starts` for an interaction; `values` are those of the other effect in the first interaction."""
    here = values if interaction.placement is None else other.carried(values, *interaction.placement)
    return _in_the_first(interaction, effect, effect.replacement_starts(interaction.setting, other, here, motion))


def blocking_starts_of(interaction: Interaction, effect: Effect, predicted: Float[Array, "frames tracks 3"]) -> Starts:
    """`Effect.blocking_starts` for an interaction, from the tracks that the baseline predicts in the training frames [m]."""
    frames = len(predicted)
    both = interaction.valid[:frames] & np.isfinite(predicted).all(-1)
    if not both.any():
        return ()
    found = effect.blocking_starts(interaction.setting, interaction.measured[:frames][both], predicted[both])
    return _in_the_first(interaction, effect, found)


def _in_the_first(interaction: Interaction, effect: Effect, starts: Starts) -> Starts:
    """Starts of an interaction, moved to where the object lies in the first one."""
    if interaction.placement is None:
        return starts
    rotation, translation = interaction.placement
    back = rotation.T, -rotation.T @ translation
    there = [(start, effect.carried({**effect.dormant, **start}, *back)) for start in starts]
    return tuple({name: values[name] for name in start} for start, values in there)
