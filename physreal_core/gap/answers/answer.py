"""Answers of the search: fits of no effect, one or two, beside the baseline, and their records with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.fitting.spread import NINETY
from physreal_core.gap.answers.predictive_share import predictive_shares
from physreal_core.gap.fits.evidence import Evidence, Evidences
from physreal_core.gap.fits.least_squares import Data, Fit
from physreal_core.gap.report import Candidate, FittedEffect
from physreal_core.gap.settings import GapSettings


@dataclass(frozen=True)
class Answer:
    """One answer that was fitted: no effect, one or two.

    Args:
        fit: to the training frames of all interactions.
        screened: gain in log evidence that the score test predicted [nat]; None where it did not rank the answer.
        gain: in log evidence over the baseline [nat].
        held_out: gain in half the squared residual of the held-out frames [nat].
        evidence: of the fit.
        telling: as of `Candidate`.
    """

    fit: Fit
    screened: float | None
    gain: float
    held_out: float
    evidence: Evidence
    telling: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return self.fit.unknowns.effects


def answer_of(
    fit: Fit, screened: float | None, held_out: float, baseline: Fit, evidences: Evidences, data: Data
) -> Answer:
    """An answer from its fit.

    Args:
        fit: of the answer.
        screened: as of `Answer`.
        held_out: gain on the held-out frames [nat], not a number where the rollout failed there.
        baseline: the fit without a missing effect.
        evidences: of both.
        data: what both were fitted to.
    """
    held_out = held_out if np.isfinite(held_out) else -np.inf
    shares = predictive_shares(fit, baseline, data)
    return Answer(fit, screened, evidences.gain(fit, baseline), held_out, evidences.of(fit), shares)


def fitted_effects(fit: Fit, evidence: Evidence, settings: GapSettings) -> tuple[FittedEffect, ...]:
    """Coefficients of a fit with 90 % intervals from the curvature of its posterior.

    The curvature knows nothing of what the model does otherwise than the truth: a law of another form, a contact that is met
    a little later. The intervals are therefore wider than it says, by a factor from captures whose truth is known (split
    conformal prediction: Vovk, Gammerman and Shafer 2005, section 4.2; docs/missing_effect.md).

    Args:
        fit: of an answer.
        evidence: of the fit.
        settings: temperature of the likelihood, and that factor.
    """
    prior = fit.unknowns.block.precision
    information = np.linalg.inv(evidence.covariance) - prior
    deviations = fit.unknowns.deviations(np.linalg.inv(information / settings.temperature + prior))
    return tuple(
        _fitted(EFFECTS[name], values, deviations[name], settings.interval_scale)
        for name, values in fit.unknowns.values(fit.vector).items()
    )


def _fitted(effect: Effect, values: dict[str, float], deviations: dict[str, float], scale: float) -> FittedEffect:
    intervals = {}
    for c in effect.coefficients:
        value, reach = values[c.name], scale * NINETY * deviations[c.name]
        intervals[c.name] = (max(c.lower, value - reach), min(c.upper, value + reach))
    return FittedEffect(effect.name, values, intervals, effect.units)


def candidates_of(
    answers: Sequence[Answer], probabilities: Float[Array, " answers"], settings: GapSettings
) -> tuple[Candidate, ...]:
    """Records of the answers, the most probable first."""
    found = [
        Candidate(
            fitted_effects(a.fit, a.evidence, settings),
            a.screened,
            a.gain,
            a.held_out,
            float(p),
            a.fit.unknowns.baseline_fields(a.fit.vector),
            a.evidence.size * settings.model_error.rms,
            a.telling,
            a.fit.unknowns.elastic_law,
        )
        for a, p in zip(answers, probabilities, strict=True)
    ]
    return tuple(sorted(found, key=lambda c: -c.probability))
