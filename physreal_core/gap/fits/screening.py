"""Ranking of candidate effects by a score test (Rao 1948), with the baseline's freedom projected out.

Every effect is in the simulator with amplitude zero. One rollout per amplitude gives its tangent: how the tracks would
move. What a refit of the baseline could imitate is projected out of the tangent, and the rest is compared with the
residual. With Gaussian priors the comparison has a closed form, the gain in log evidence of the linearised model.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.checkpoints import remembered
from physreal_core.effects import EFFECTS
from physreal_core.gap.fits.least_squares import Data, Fit, one_sided_evidence
from physreal_core.gap.fits.plans import Plan, compatible, plans_of
from physreal_core.gap.fits.unknowns import Priors
from physreal_core.gap.fits.whitening import rewhitened, rewhitened_columns
from physreal_core.gap.interactions.interaction import Trial

DRAWS = 200
"""Captures without a missing effect that the bootstrap draws."""


@dataclass(frozen=True)
class Start:
    """One start of an effect with its tangents.

    Args:
        plan: values and steps.
        tangents: whitened changes of the tracks per amplitude, in units of its scale, shape [n, A].
        projected: the same with the baseline's freedom projected out.
    """

    plan: Plan
    tangents: Float[Array, "entries amplitudes"]
    projected: Float[Array, "entries amplitudes"]

    @property
    def effect(self) -> str:
        """Name of the effect."""
        return self.plan.effect.name

    @property
    def values(self) -> dict[str, float]:
        """Coefficients with dormant amplitudes, in SI units."""
        return self.plan.values


@dataclass(frozen=True)
class Score:
    """The optimum of the linear model from one start beside a fit.

    Args:
        start: of the effect.
        gain: in log evidence [nat].
        values: coefficients of the effect, in SI units.
        beside: the fit.
        shift: change of the fit's own unknowns.
    """

    start: Start
    gain: float
    values: dict[str, float]
    beside: Fit
    shift: Float[Array, " unknowns"]


@dataclass(frozen=True)
class Screen:
    """Tangents of candidate effects at a fit; `of` and `at` take them.

    Args:
        baseline: the fit.
        data: what it was fitted to.
        priors: of the effects' coefficients.
        starts: of all candidates, with their tangents.
    """

    baseline: Fit
    data: Data
    priors: Priors
    starts: tuple[Start, ...]

    @classmethod
    def of(cls, baseline: Fit, data: Data, names: Sequence[str], priors: Priors) -> Screen:
        """Take the tangents of these candidates, from all starts that the body and the baseline's motion give."""
        plans = plans_of(names, data.experiments, baseline.unknowns.trial(baseline.vector))
        return cls.at(baseline, data, priors, plans)

    @classmethod
    def at(cls, baseline: Fit, data: Data, priors: Priors, plans: Sequence[Plan]) -> Screen:
        """Take the tangents of these plans."""
        trial = baseline.unknowns.trial(baseline.vector)
        trials = [replace(trial, effects={**trial.effects, plan.effect.name: v}) for plan in plans for v in plan.steps]
        found = remembered(
            "screen",
            lambda: [value for one in (trial, *trials) for value in one.told()],
            {"changes": (len(baseline.residual), len(trials))},
            lambda: {"changes": _changes(data, trial, trials)},
        )
        changes = np.where(np.isfinite(found["changes"]).all(0), found["changes"], 0.0)
        starts, first = [], 0
        for plan in plans:
            tangents = changes[:, first : first + len(plan.steps)] / plan.sizes
            first += len(plan.steps)
            starts.append(Start(plan, tangents, project_out(baseline, tangents)))
        return cls(baseline, data, priors, tuple(starts))

    @property
    def plans(self) -> list[Plan]:
        """Of all starts."""
        return [start.plan for start in self.starts]

    def anew(self, fit: Fit, keep: int) -> Screen:
        """A screen at another fit.

        Args:
            fit: tangents are taken there, of the effects that are compatible with its own.
            keep: number of starts of every effect: those of the largest gain beside the fit, by the tangents from here.
        """
        found = self._scores_beside(fit)
        order = sorted(found, key=lambda number: -found[number].gain)
        kept, counts = [], Counter()
        for number in order:
            effect = found[number].start.effect
            counts[effect] += 1
            if counts[effect] <= keep:
                kept.append(number)
        return Screen.at(fit, self.data, self.priors, [self.starts[number].plan for number in sorted(kept)])

    def beside(self, data: Data) -> Screen:
        """The same screen beside other noise models."""
        starts = []
        baseline = rewhitened(self.baseline, self.data, data)
        for start in self.starts:
            tangents = rewhitened_columns(start.tangents, self.data, data)
            starts.append(Start(start.plan, tangents, project_out(baseline, tangents)))
        return Screen(baseline, data, self.priors, tuple(starts))

    def scores(self, residual: Float[Array, " entries"]) -> list[Score]:
        """The best start of every effect for a whitened residual of the baseline, the best effect first."""
        best: dict[str, Score] = {}
        for start in self.starts:
            score = self._score(start, start.projected, residual, self.baseline)
            if start.effect not in best or score.gain > best[start.effect].gain:
                best[start.effect] = score
        return sorted(best.values(), key=lambda score: -score.gain)

    def _scores_beside(self, fit: Fit) -> dict[int, Score]:
        """Scores beside another fit, by the start's number, of the effects that are compatible with its own."""
        found = {}
        for number, start in enumerate(self.starts):
            if all(compatible(start.effect, name) for name in fit.unknowns.effects):
                found[number] = self._score(start, project_out(fit, start.tangents), fit.residual, fit)
        return found

    def _score(self, start: Start, projected: Array, residual: Array, beside: Fit) -> Score:
        """Of a start with these projected tangents, for a residual of the fit beside which the effect is put."""
        plan, prior = start.plan, self.priors.coefficient
        pull = -projected.T @ residual
        at, gain = _linear_gain(start.tangents.T @ projected, pull, plan.one_sided, plan.sign, prior)
        shift = -np.linalg.solve(beside.hessian, beside.jacobian.T @ (start.tangents @ at))
        coefficients = {c.name: c for c in EFFECTS[start.effect].coefficients}
        values, amplitudes = dict(start.values), [c for c in coefficients.values() if c.kind == "amplitude"]
        for c, z in zip(amplitudes, at, strict=True):
            values[c.name] = float(np.clip(c.dormant + z * c.scale, c.lower, c.upper))
        return Score(start, gain, values, beside, shift)

    def information(self) -> list[dict[str, float]]:
        """Per interaction, the whitened change by each effect at its scale that the baseline cannot imitate."""
        found = []
        for rows in self.data.rows():
            sizes: dict[str, float] = {}
            for start in self.starts:
                size = float(np.sqrt((start.projected[rows] ** 2).sum(0)).max())
                sizes[start.effect] = max(size, sizes.get(start.effect, 0.0))
            found.append(sizes)
        return found

    def null_gains(self, seed: int) -> Float[Array, " draws"]:
        """The largest gain of any candidate on captures without a missing effect [nat], by parametric bootstrap.

        Residuals are drawn from the noise model, which covers sensor noise and numerical error, and the baseline is
        refitted linearly.
        """
        random = np.random.default_rng(seed)
        residuals = random.standard_normal((len(self.baseline.residual), DRAWS)).astype(np.float32)
        best, prior = np.full(DRAWS, -np.inf), self.priors.coefficient
        for start in self.starts:
            pulls = -start.projected.T.astype(np.float32) @ residuals
            information, plan = start.tangents.T @ start.projected, start.plan
            gains = [_linear_gain(information, pull, plan.one_sided, plan.sign, prior)[1] for pull in pulls.T]
            best = np.maximum(best, gains)
        return best


def _changes(data: Data, reference: Trial, trials: Sequence[Trial]) -> Float[Array, "entries trials"]:
    """Whitened differences of trials from a reference, in rollouts of one kind."""
    predictions = data.predict([reference, *trials])
    return data.changes([p[1:] for p in predictions], [p[0] for p in predictions])


def project_out(fit: Fit, columns: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
    """The part of whitened columns that the unknowns of a fit cannot imitate under their priors."""
    J = fit.jacobian
    return columns - J @ np.linalg.solve(fit.hessian, J.T @ columns)


def _linear_gain(
    information: Float[Array, "amplitudes amplitudes"],
    pull: Float[Array, " amplitudes"],
    one_sided: Bool[Array, " amplitudes"],
    sign: Float[Array, " amplitudes"],
    prior: float,
) -> tuple[Float[Array, " amplitudes"], float]:
    """Optimum of a linear model with Gaussian priors, and its gain in log evidence [nat].

    Amplitudes of fixed sign stay at zero or on their side of it.
    """
    A = information + np.eye(len(pull)) / prior**2
    free = np.ones(len(pull), dtype=bool)
    z = np.zeros(len(pull))
    for _ in range(len(pull) + 1):
        z[:] = 0.0
        z[free] = np.linalg.solve(A[np.ix_(free, free)], pull[free])
        wrong = free & one_sided & (z * sign < 0)
        if not wrong.any():
            break
        free &= ~wrong
    deviations = np.abs(z) / np.sqrt(np.diag(np.linalg.inv(A)))
    occam = 0.5 * np.linalg.slogdet(A * prior**2)[1]
    return z, float(0.5 * z @ pull - occam + one_sided_evidence(deviations[one_sided]))
