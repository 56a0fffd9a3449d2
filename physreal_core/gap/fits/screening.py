"""Ranking of candidate effects by a score test (Rao 1948) with the baseline's freedom projected out.

Every effect stands in the simulator with amplitude zero. One rollout per amplitude says how the tracks would move; what
refitting the baseline could imitate is projected out, and what is left is compared with the residual. With Gaussian priors the
comparison has a closed form: the gain in log evidence of the linearised model.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.fits.least_squares import Data, Fit, half_share
from physreal_core.gap.fits.unknowns import STEP, Priors, Unknowns
from physreal_core.gap.interactions.interaction import EffectValues, Interaction, Trial
from physreal_core.gap.interactions.starts import starts_of
from physreal_core.simulation import States

DRAWS = 200


@dataclass(frozen=True)
class Start:
    """One effect from one start, and how the tracks answer to it.

    Args:
        effect: name.
        values: coefficients with the amplitudes stepped, in SI units.
        tangents: whitened, per amplitude and in free coordinates, with the baseline's freedom projected out; [n, A].
        half: amplitudes whose sign physics fixes to `sign`, shape [A].
        sign: side of the step, shape [A].
    """

    effect: str
    values: dict[str, float]
    tangents: Float[Array, "entries amplitudes"]
    half: Bool[Array, " amplitudes"]
    sign: Float[Array, " amplitudes"]


@dataclass(frozen=True)
class Score:
    """Gain in log evidence [nat] that the linear model promises from one start beside a fit, and where its optimum lies.

    Args:
        start: of the effect.
        gain: in log evidence [nat].
        values: of the effect's coefficients, in SI units.
        beside: the fit.
        shift: by which the fit's own unknowns go along.
    """

    start: Start
    gain: float
    values: dict[str, float]
    beside: Fit
    shift: Float[Array, " unknowns"]


class Screen:
    """Tangents of all candidates at a fitted baseline.

    Args:
        baseline: the fit.
        data: of all experiments.
        names: the candidates.
        priors: of their coefficients.
        plans: where each of them may start, if that is known; otherwise along the baseline's motion.

    Attributes:
        plans: where each of them starts.
    """

    def __init__(
        self, baseline: Fit, data: Data, names: Sequence[str], priors: Priors, plans: Sequence[Plan] | None = None
    ) -> None:
        self.baseline, self._data, self._priors = baseline, data, priors
        trial = baseline.unknowns.trial(baseline.vector)
        if plans is None:
            motions = [experiment.motion(trial) for experiment in data.experiments]
            plans = [plan for name in names for plan in _plans(EFFECTS[name], data.experiments, motions)]
        self.plans = list(plans)
        trials = [Trial(trial.fields, {**trial.effects, plan.effect.name: v}) for plan in plans for v in plan.steps]
        answers = data.predict(trials)
        changes = data.changes(answers, baseline.predicted)
        changes = np.where(np.isfinite(changes).all(0), changes, 0.0)
        self.raw, self.starts, first = [], [], 0
        for plan in plans:
            own = changes[:, first : first + len(plan.steps)] / plan.sizes
            first += len(plan.steps)
            self.raw.append(own)
            self.starts.append(self._start(plan, own))

    def anew(self, fit: Fit, keep: int) -> Screen:
        """The same at another fit, with the `keep` starts of every effect that promise most beside it from here."""
        found = self._beside(fit)
        order = sorted(found, key=lambda number: -found[number].gain)
        kept, counts = [], Counter()
        for number in order:
            effect = found[number].start.effect
            counts[effect] += 1
            if counts[effect] <= keep:
                kept.append(number)
        names = list(dict.fromkeys(found[number].start.effect for number in sorted(kept)))
        return Screen(fit, self._data, names, self._priors, [self.plans[number] for number in sorted(kept)])

    def _start(self, plan: Plan, columns: Array) -> Start:
        return Start(plan.effect.name, plan.values, self.beside(self.baseline, columns), plan.half, np.sign(plan.sizes))

    @staticmethod
    def beside(fit: Fit, columns: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """What of the columns the unknowns of a fit cannot imitate, their priors allowing."""
        J = fit.jacobian
        return columns - J @ np.linalg.solve(fit.hessian, J.T @ columns)

    def scores(self, residual: Float[Array, " entries"]) -> list[Score]:
        """The best start of every effect for a whitened residual of the baseline, best effect first."""
        best: dict[str, Score] = {}
        for start, raw in zip(self.starts, self.raw, strict=True):
            score = self._score(start, raw, start.tangents, residual, self.baseline)
            if start.effect not in best or score.gain > best[start.effect].gain:
                best[start.effect] = score
        return sorted(best.values(), key=lambda score: -score.gain)

    def _beside(self, fit: Fit) -> dict[int, Score]:
        """Scores beside a fit, by the start's number, of the effects that go together with those in place."""
        found = {}
        for number, (start, raw) in enumerate(zip(self.starts, self.raw, strict=True)):
            if all(go_together(start.effect, name) for name in fit.unknowns.effects):
                found[number] = self._score(start, raw, self.beside(fit, raw), fit.residual, fit)
        return found

    def _score(self, start: Start, raw: Array, tangents: Array, residual: Array, beside: Fit) -> Score:
        """Of a start with these tangents, raw and with the freedom of a fit projected out, for a residual of that fit."""
        pull, prior = -tangents.T @ residual, self._priors.coefficient
        at, gain = _linear_gain(raw.T @ tangents, pull, start.half, start.sign, prior)
        shift = -np.linalg.solve(beside.hessian, beside.jacobian.T @ (raw @ at))
        coefficients = {c.name: c for c in EFFECTS[start.effect].coefficients}
        values, amplitudes = dict(start.values), [c for c in coefficients.values() if c.kind == "amplitude"]
        for c, z in zip(amplitudes, at, strict=True):
            values[c.name] = float(np.clip(c.dormant + z * c.scale, c.lower, c.upper))
        return Score(start, gain, values, beside, shift)

    def information(self) -> list[dict[str, float]]:
        """Per experiment: expected whitened change by each effect at its scale, baseline and numerics projected out."""
        found = []
        for rows in self._data.rows():
            sizes: dict[str, float] = {}
            for start in self.starts:
                size = float(np.sqrt((start.tangents[rows] ** 2).sum(0)).max())
                sizes[start.effect] = max(size, sizes.get(start.effect, 0.0))
            found.append(sizes)
        return found

    def null_gains(self, seed: int) -> Float[Array, " draws"]:
        """The best gain of any candidate on captures without a missing effect, by parametric bootstrap.

        Residuals are drawn from the noise model, which holds sensor and numerical error, and the baseline is refitted
        (linearly).
        """
        random = np.random.default_rng(seed)
        residuals = random.standard_normal((len(self.baseline.residual), DRAWS)).astype(np.float32)
        best = np.full(DRAWS, -np.inf)
        for start, raw in zip(self.starts, self.raw, strict=True):
            pulls = -start.tangents.T.astype(np.float32) @ residuals
            information = raw.T @ start.tangents
            gains = [
                _linear_gain(information, pull, start.half, start.sign, self._priors.coefficient)[1] for pull in pulls.T
            ]
            best = np.maximum(best, gains)
        return best


EXCLUSIVE = ("obstacle", "fibres")
"""Terms of which the simulator has one."""


def go_together(first: str, second: str) -> bool:
    """Whether two effects can act in one simulation: they are not the same and do not want the same law or the same place."""
    a, b = EFFECTS[first], EFFECTS[second]
    shared = {*a.laws} & {*b.laws} or {*a.terms} & {*b.terms} & {*EXCLUSIVE}
    return first != second and not shared


def akin(first: str, second: str) -> bool:
    """Whether two effects act through the same term of the simulation, so that one may pass for the other."""
    return first != second and bool({*EFFECTS[first].terms} & {*EFFECTS[second].terms})


@dataclass(frozen=True)
class Plan:
    """An effect's start as rollouts: values of shapes and stepped amplitudes, one dict a rollout, and the free steps."""

    effect: Effect
    values: dict[str, float]
    steps: list[dict[str, float]]
    sizes: Float[Array, " amplitudes"]
    half: Bool[Array, " amplitudes"]

    def plain(self) -> list[dict[str, float]]:
        """Values with one amplitude at its scale, on either side where it has two."""
        amplitudes = [c for c in self.effect.coefficients if c.kind == "amplitude"]
        return [
            {**self.values, c.name: float(np.clip(c.dormant + side * c.scale, c.lower, c.upper))}
            for c, size, half in zip(amplitudes, self.sizes, self.half, strict=True)
            for side in ((np.sign(size),) if half else (1.0, -1.0))
        ]


def _plans(effect: Effect, experiments: Sequence[Interaction], motions: Sequence[States | None]) -> list[Plan]:
    """From the starts that the body gives in the first interaction that has any, and those that each motion gives."""
    still = [starts_of(experiment, effect) for experiment in experiments]
    starts = list(next((own for own in still if own), ()))
    for experiment, motion, own in zip(experiments, motions, still, strict=True):
        starts += [start for start in starts_of(experiment, effect, motion) if start not in (*own, *starts)]
    return [_plan(effect, start) for start in starts]


def _plan(effect: Effect, start: dict[str, float]) -> Plan:
    shapes = {c.name: start[c.name] for c in effect.coefficients if c.kind == "shape" and c.name in start}
    there = {**effect.dormant, **shapes}
    steps, sizes, half = [], [], []
    for c in effect.coefficients:
        if c.kind == "shape":
            continue
        to = start.get(c.name, c.dormant + (STEP if c.upper > c.dormant else -STEP) * c.scale)
        steps.append({**there, c.name: to})
        sizes.append((to - c.dormant) / c.scale)
        half.append(c.lower >= c.dormant or c.upper <= c.dormant)
    return Plan(effect, there, steps, np.array(sizes), np.array(half))


def _linear_gain(
    information: Array, pull: Array, half: Array, sign: Array, prior: float
) -> tuple[Float[Array, " amplitudes"], float]:
    """Optimum and gain in log evidence of a linear model with Gaussian priors; amplitudes of fixed sign stay at zero or
    beyond it."""
    A = information + np.eye(len(pull)) / prior**2
    free = np.ones(len(pull), dtype=bool)
    z = np.zeros(len(pull))
    for _ in range(len(pull) + 1):
        z[:] = 0.0
        z[free] = np.linalg.solve(A[np.ix_(free, free)], pull[free])
        wrong = free & half & (z * sign < 0)
        if not wrong.any():
            break
        free &= ~wrong
    reach = np.abs(z) / np.sqrt(np.diag(np.linalg.inv(A)))
    return z, float(0.5 * z @ pull - 0.5 * np.linalg.slogdet(A * prior**2)[1] + half_share(reach[half]))


SHARES = (1.0, 0.5, 0.1)
"""Of the linear model's amplitudes, from which a fit may start: the least is hardly worse than the fit beside."""

LONGEST_SHIFT = 0.7
"""Of any unknown of the material, in free coordinates: as far as the linear model is good for."""

WAYS = (*((share, True) for share in SHARES), (1.0, False))
"""Shares, and whether the material goes along as the linear model says."""


def started(
    scores: Sequence[Score], priors: Priors
) -> tuple[Unknowns, Float[Array, "starts unknowns"], list[Float[Array, "entries known"]]]:
    """Of the fit of one more effect: unknowns, starts from the linear optima of its scores (the best score first), and the
    tangents of the baseline's unknowns at each."""
    best = scores[0]
    present = best.beside.unknowns
    at: EffectValues = {**present.values(best.beside.vector), best.start.effect: best.values}
    names = sorted((*present.effects, best.start.effect), key=list(EFFECTS).index)
    unknowns = Unknowns(present.fields, names, priors, at, present.scalars)
    starts = [_start(unknowns, score, *way) for score in scores for way in WAYS]
    known = [score.beside.jacobian[:, : unknowns.baseline] for score in scores for _ in WAYS]
    return unknowns, np.stack(starts), known


def _start(unknowns: Unknowns, score: Score, share: float, along: bool) -> Float[Array, " unknowns"]:
    """The fit beside which an effect was scored, with the effect at a share of the linear model's amplitudes."""
    beside, vector = score.beside, unknowns.start()
    moved = beside.vector + (share * np.clip(score.shift, -LONGEST_SHIFT, LONGEST_SHIFT) if along else 0.0)
    vector[: unknowns.baseline] = moved[: unknowns.baseline]
    effects = {**beside.unknowns.values(moved), score.start.effect: _shrunk(score, share)}
    vector = unknowns.with_effects(vector, effects)
    return np.clip(vector, unknowns.block.lower, unknowns.block.upper)


def _shrunk(score: Score, share: float) -> dict[str, float]:
    """The coefficients with the amplitudes at a share of their way from dormant."""
    shrunk = dict(score.values)
    for c in EFFECTS[score.start.effect].coefficients:
        if c.kind == "amplitude":
            shrunk[c.name] = c.dormant + share * (score.values[c.name] - c.dormant)
    return shrunk
