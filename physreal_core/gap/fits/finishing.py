"""Fits that go on beside a model's error as large as they leave, after they were made beside one as large as the baseline leaves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Data, Fit, Request, fit, together
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import Measurements

RULED_OUT = 100.0
"""Loss in log evidence against another elastic law [nat] from which on a law is not tried beside effects."""


def continued(found: Fit, known: Data, data: Data, steps: int, elastic_law: str | None = None) -> Request:
    """A fit that goes on from where it is, with its tangents, beside another noise model.

    Args:
        found: the fit.
        known: the measurements, with the noise models beside which it was made.
        data: the same with others.
        steps: largest number of further ones.
        elastic_law: under which it goes on; None for its own.
    """
    begun = rewhitened(found, known, data)
    unknowns = begun.unknowns if elastic_law is None else begun.unknowns.under(elastic_law)
    return fit(unknowns, data, begun.vector[None], steps, [begun.jacobian])


@dataclass(frozen=True)
class Finish:
    """How fits to the same measurements end; they stay in units of the noise beside which they were made.

    Args:
        measurements: that the fits were made to.
        evidences: of fits to them.
        steps: largest number of further ones.
    """

    measurements: Measurements
    evidences: Evidences
    steps: int

    def settled(self, fits: Sequence[Fit]) -> list[Fit]:
        """Each fit after some more steps, or as it was if they gain no evidence."""
        pairs = zip(fits, self._gone_on([(found, None) for found in fits]), strict=True)
        return [self.evidences.best(pair) for pair in pairs]

    def under_the_best_law(self, baseline: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
        """The baseline and other fits, each under that elastic law which gives it the most evidence.

        A law that the baseline rules out is not tried beside effects, nor any beside effects that gain nothing.
        """
        known = {self._law_of(baseline): baseline}
        others = [law for law in self.measurements.elastic_laws if law not in known]
        known |= zip(others, self._gone_on([(baseline, law) for law in others]), strict=True)
        best = self.evidences.best(known.values())
        left = [law for law, found in known.items() if self.evidences.gain(best, found) < RULED_OUT]
        gaining = [found for found in fits if self.evidences.gain(found, baseline) >= 0.0]
        asked = [(found, law) for found in gaining for law in left if law != self._law_of(found)]
        answers = list(zip((found for found, _ in asked), self._gone_on(asked), strict=True))
        return best, [
            self.evidences.best([found, *(end for begun, end in answers if begun is found)]) for found in fits
        ]

    def _law_of(self, found: Fit) -> str:
        return found.unknowns.elastic_law or self.measurements.elastic_laws[0]

    def _gone_on(self, asked: Sequence[tuple[Fit, str | None]]) -> list[Fit]:
        """Fits after some more steps, each under an elastic law and beside an error of the size that it leaves."""
        data = self.measurements.train
        own = [self.measurements.beside_error(self.evidences.of(found).size).train for found, _ in asked]
        requests = [
            continued(found, data, theirs, self.steps, law) for (found, law), theirs in zip(asked, own, strict=True)
        ]
        return [rewhitened(found, theirs, data) for found, theirs in zip(together(requests), own, strict=True)]
