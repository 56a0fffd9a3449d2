"""Where fits of an effect may start, and which effects can act together or be mistaken for one another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.fits.unknowns import STEP
from physreal_core.gap.interactions.interaction import Interaction, Trial
from physreal_core.gap.interactions.side_by_side import side_by_side
from physreal_core.gap.interactions.starts import starts_of
from physreal_core.simulation import States

EXCLUSIVE = ("obstacle", "fibres")
"""Terms that the simulator has only once."""


def compatible(first: str, second: str) -> bool:
    """Whether two different effects can act together: they need neither the same law nor the same exclusive term."""
    a, b = EFFECTS[first], EFFECTS[second]
    shared = {*a.laws} & {*b.laws} or {*a.terms} & {*b.terms} & {*EXCLUSIVE}
    return first != second and not shared


def share_a_term(first: str, second: str) -> bool:
    """Whether two different effects act through the same term of the simulation, so that one may pass for the other."""
    return first != second and bool({*EFFECTS[first].terms} & {*EFFECTS[second].terms})


@dataclass(frozen=True)
class Plan:
    """One start of an effect, and the rollouts that take its tangents there: one per amplitude.

    Args:
        effect: the effect.
        values: of all coefficients, in SI units; amplitudes are dormant.
        steps: the same with one amplitude stepped, one dict per rollout.
        sizes: of the steps, in units of the coefficients' scales, shape [A].
        one_sided: amplitudes whose sign physics fixes, shape [A].
    """

    effect: Effect
    values: dict[str, float]
    steps: list[dict[str, float]]
    sizes: Float[Array, " amplitudes"]
    one_sided: Bool[Array, " amplitudes"]

    @property
    def sign(self) -> Float[Array, " amplitudes"]:
        """Side of each step."""
        return np.sign(self.sizes)

    def at_scale(self) -> list[dict[str, float]]:
        """Values with one amplitude at its scale, on either side where it has two."""
        amplitudes = [c for c in self.effect.coefficients if c.kind == "amplitude"]
        return [
            {**self.values, c.name: float(np.clip(c.dormant + side * c.scale, c.lower, c.upper))}
            for c, sign, one_sided in zip(amplitudes, self.sign, self.one_sided, strict=True)
            for side in ((sign,) if one_sided else (1.0, -1.0))
        ]


def plans_of(names: Sequence[str], experiments: Sequence[Interaction], trial: Trial) -> list[Plan]:
    """All plans of some effects.

    A start may depend on the body, or on where the body goes under a trial. Of the first kind the first interaction
    that has any gives all; of the second kind every interaction gives its own.

    Args:
        names: of the effects.
        experiments: the interactions.
        trial: the baseline.
    """
    motions = motions_of(experiments, trial)
    return [plan for name in names for plan in plans_along(EFFECTS[name], experiments, motions)]


def motions_of(experiments: Sequence[Interaction], trial: Trial) -> list[States | None]:
    """The whole rollout of one trial in each interaction."""
    return side_by_side([partial(experiment.motion, trial) for experiment in experiments], experiments[0].device)


def plans_along(effect: Effect, experiments: Sequence[Interaction], motions: Sequence[States | None]) -> list[Plan]:
    """The plans of one effect, where the motions of the body are known."""
    still = [starts_of(experiment, effect) for experiment in experiments]
    starts = list(next((own for own in still if own), ()))
    for experiment, motion, own in zip(experiments, motions, still, strict=True):
        starts += [start for start in starts_of(experiment, effect, motion) if start not in (*own, *starts)]
    return [_plan(effect, start) for start in starts]


def _plan(effect: Effect, start: dict[str, float]) -> Plan:
    shapes = {c.name: start[c.name] for c in effect.coefficients if c.kind == "shape" and c.name in start}
    there = {**effect.dormant, **shapes}
    steps, sizes, one_sided = [], [], []
    for c in effect.coefficients:
        if c.kind == "shape":
            continue
        to = start.get(c.name, c.dormant + (STEP if c.upper > c.dormant else -STEP) * c.scale)
        steps.append({**there, c.name: to})
        sizes.append((to - c.dormant) / c.scale)
        one_sided.append(c.lower >= c.dormant or c.upper <= c.dormant)
    return Plan(effect, there, steps, np.array(sizes), np.array(one_sided))
