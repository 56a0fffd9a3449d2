"""Probabilities of answers from their gains in evidence (`fits.evidence`).

Gains are divided by a temperature before they become probabilities: the simulator's own error is not quite the Gaussian field
that stands for it, so plain ratios would be too sure.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.settings import GapSettings


def probabilities(
    names: Sequence[tuple[str, ...]],
    gains: Sequence[float],
    held_out: Sequence[float],
    settings: GapSettings,
    library: int,
) -> Float[Array, " answers"]:
    """Probabilities of answers, from their gains at the calibrated temperature and their priors.

    Args:
        names: effects of each answer.
        gains: in log evidence over the baseline [nat].
        held_out: gains on the held-out frames [nat].
        settings: of the search.
        library: number of candidate effects.
    """
    counted = confirmed(names, np.asarray(gains, dtype=np.float64), held_out)
    return tempered(counted, [*map(len, names)], settings, library)


def confirmed(
    names: Sequence[tuple[str, ...]],
    gains: Float[Array, " answers"],
    held_out: Sequence[float],
) -> Float[Array, " answers"]:
    """The gains [nat], where those of two effects count as far as held-out frames confirm them: up to what they gain there.

    A superfluous second effect fits what the first one leaves in the training frames, and does nothing beyond them.
    """
    if not any(held_out):  # there are no such frames
        return gains
    found, alone = gains.copy(), {own[0]: number for number, own in enumerate(names) if len(own) == 1}
    for number, own in enumerate(names):
        if len(own) == 2 and (parts := [alone[name] for name in own if name in alone]):
            better = max(parts, key=gains.__getitem__)
            more = held_out[number] - held_out[better] if held_out[number] > held_out[better] else 0.0
            found[number] = min(gains[number], gains[better] + more)
    return found


def tempered(
    gains: Float[Array, " answers"], sizes: Sequence[int], settings: GapSettings, library: int
) -> Float[Array, " answers"]:
    """Probabilities of answers with these gains.

    Args:
        gains: that count [nat].
        sizes: number of effects of each answer.
        settings: of the search.
        library: number of candidate effects.
    """
    weights = np.log(_priors(settings, library))[np.asarray(sizes)] + gains / settings.temperature
    weights = np.exp(weights - weights.max())
    return weights / weights.sum()


def _priors(settings: GapSettings, library: int) -> tuple[float, float, float]:
    """Prior probabilities of no effect, of each effect of a library, of each pair."""
    something, pairs = 1.0 - settings.prior_none, max(library * (library - 1) // 2, 1)
    single, pair = something * (1.0 - settings.prior_pair) / library, something * settings.prior_pair / pairs
    return settings.prior_none, single, pair


def worth_of_a_second(settings: GapSettings, library: int) -> float:
    """Gain that a second effect needs beyond the best one, for the two to be in one class with it [nat]."""
    _, single, pair = _priors(settings, library)
    return settings.temperature * max(0.0, float(np.log(settings.class_ratio * single / pair)))
