"""Answers of the search: fits of no effect, one or two, beside the baseline, and their records with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.answers.predictive_share import predictive_shares
from physreal_core.gap.answers.probabilities import temperature_of
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.report import Candidate, FittedEffect
from physreal_core.gap.settings import GapSettings

NINETY = 1.6449
"""Standard deviations on either side of the mean that cover 90 % of a Gaussian."""


@dataclass(frozen=True)
class Answer:
    """One answer that was fitted: no effect, one or two.

    Args:
        fit: to the training frames of all interactions.
        screened: gain in log evidence that the score test predicted [nat]; None where it did not rank the answer.
        gain: in log evidence over the baseline [nat].
        held_out: gain in half the squared residual of the held-out frames [nat].
        excess, telling: as of `Candidate`.
    """

    fit: Fit
    screened: float | None
    gain: float
    held_out: float
    excess: float
    telling: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.fit.unknowns.effects


def answer_of(fit: Fit, screened: float | None, held_out: float, baseline: Fit, measurements: Measurements) -> Answer:
    """An answer from its fit.

    Args:
        fit: of the answer.
        screened: as of `Answer`.
        held_out: gain on the held-out frames [nat], not a number where the rollout failed there.
        baseline: the fit without a missing effect.
        measurements: what both were fitted to.
    """
    held_out = held_out if np.isfinite(held_out) else -np.inf
    gain = fit.log_evidence - baseline.log_evidence
    shares = predictive_shares(fit, baseline, measurements.train)
    return Answer(fit, screened, gain, held_out, measurements.excess(fit), shares)


def fitted_effects(fit: Fit, best_gain: float, settings: GapSettings) -> tuple[FittedEffect, ...]:
    """Coefficients of a fit with 90 % intervals from the curvature of its posterior.

    The likelihood is tempered as the gains are, times `interval_temperature`.

    Args:
        fit: of an answer.
        best_gain: largest gain of any answer [nat]; it sets the temperature.
        settings: of the search.
    """
    J, temperature = fit.jacobian, settings.interval_temperature * temperature_of(best_gain, settings)
    covariance = np.linalg.inv(J.T @ J / temperature + fit.unknowns.block.precision)
    deviations = fit.unknowns.deviations(covariance)
    return tuple(
        _fitted(EFFECTS[name], values, deviations[name]) for name, values in fit.unknowns.values(fit.vector).items()
    )


def _fitted(effect: Effect, values: dict[str, float], deviations: dict[str, float]) -> FittedEffect:
    intervals = {}
    for c in effect.coefficients:
        value, reach = values[c.name], NINETY * deviations[c.name]
        intervals[c.name] = (max(c.lower, value - reach), min(c.upper, value + reach))
    return FittedEffect(effect.name, values, intervals, effect.units)


def candidates_of(
    answers: Sequence[Answer], probabilities: Float[Array, " answers"], settings: GapSettings
) -> tuple[Candidate, ...]:
    """Records of the answers, the most probable first."""
    best = max(answer.gain for answer in answers)
    found = [
        Candidate(
            fitted_effects(a.fit, best, settings),
            a.screened,
            a.gain,
            a.held_out,
            float(p),
            a.fit.unknowns.baseline_fields(a.fit.vector),
            a.excess,
            a.telling,
        )
        for a, p in zip(answers, probabilities, strict=True)
    ]
    return tuple(sorted(found, key=lambda c: -c.probability))
