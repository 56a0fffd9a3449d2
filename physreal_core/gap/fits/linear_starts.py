"""Starts of a fit with one more effect, from the optima of the linear model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS
from physreal_core.gap.fits.screening import Score
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.interactions.interaction import EffectValues

SHARES = (1.0, 0.5, 0.1)
"""Shares of the linear model's amplitudes from which a fit may start. The smallest hardly changes the fit beside."""

LONGEST_SHIFT = 0.7
"""Largest change of an unknown of the material, in its coordinate: as far as the linear model is good."""

WAYS = (*((share, True) for share in SHARES), (1.0, False))
"""Shares, and whether the material changes as the linear model says."""


def linear_starts(
    scores: Sequence[Score],
) -> tuple[Unknowns, Float[Array, "starts unknowns"], list[Float[Array, "entries known"]]]:
    """Unknowns, starts, and tangents of the baseline's unknowns at each start, for the fit of one more effect.

    Args:
        scores: of the effect, the best first.
    """
    best = scores[0]
    present = best.beside.unknowns
    at: EffectValues = {**present.values(best.beside.vector), best.start.effect: best.values}
    names = sorted((*present.effects, best.start.effect), key=list(EFFECTS).index)
    unknowns = present.beside(names, at)
    starts = [_start(unknowns, score, *way) for score in scores for way in WAYS]
    known = [score.beside.jacobian[:, : unknowns.baseline] for score in scores for _ in WAYS]
    return unknowns, np.stack(starts), known


def _start(unknowns: Unknowns, score: Score, share: float, along: bool) -> Float[Array, " unknowns"]:
    """The fit beside which an effect was scored, with the effect at a share of the linear model's amplitudes."""
    beside, vector = score.beside, unknowns.start()
    moved = beside.vector + (share * np.clip(score.shift, -LONGEST_SHIFT, LONGEST_SHIFT) if along else 0.0)
    vector[: unknowns.baseline] = moved[: unknowns.baseline]
    effects = {**beside.unknowns.values(moved), score.start.effect: _at_share(score, share)}
    vector = unknowns.with_effects(vector, effects)
    return np.clip(vector, unknowns.block.lower, unknowns.block.upper)


def _at_share(score: Score, share: float) -> dict[str, float]:
    """The coefficients with the amplitudes at a share of their way from dormant."""
    values = dict(score.values)
    for c in EFFECTS[score.start.effect].coefficients:
        if c.kind == "amplitude":
            values[c.name] = c.dormant + share * (score.values[c.name] - c.dormant)
    return values
