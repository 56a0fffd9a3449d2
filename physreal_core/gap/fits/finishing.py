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

OUT_OF_REACH = 300.0
"""Loss in log evidence against the best answer [nat] from which on an answer stays as it is: what the end of a fit gains would not save it."""


def continued(
    found: Fit, known: Data, data: Data, steps: int, elastic_law: str | None = None, thorough: bool = False
) -> Request:
    """A fit that goes on from where it is, with its tangents, beside another noise model.

    Args:
        found: the fit.
        known: the measurements, with the noise models beside which it was made.
        data: the same with others.
        steps: largest number of further ones.
        elastic_law: under which it goes on; None for its own.
        thorough: as of `fit`.
    """
    begun = rewhitened(found, known, data)
    unknowns = begun.unknowns if elastic_law is None else begun.unknowns.under(elastic_law)
    return fit(unknowns, data, begun.vector[None], steps, [begun.jacobian], thorough)


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

    def converged(self, baseline: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
        """The baseline and other fits gone on until they converge, each under its best elastic law."""
        begun, *settled = self.settled([baseline, *fits])
        return self.under_the_best_law(begun, settled)

    def settled(self, fits: Sequence[Fit]) -> list[Fit]:
        """Each fit after some more steps, or as it was if they gain no evidence."""
        pairs = zip(fits, self._gone_on([(found, None) for found in fits]), strict=True)
        return [self.evidences.best(pair) for pair in pairs]

    def under_the_best_law(self, baseline: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
        """The baseline and other fits, each under that elastic law which gives it the most evidence.

        A law that the best of them rules out is not tried beside other effects. The baseline does not rule it out for them: where
        an effect is missing, it may like a wrong law far better.
        """
        laws, leader = self.measurements.elastic_laws, self.evidences.best([baseline, *fits])
        (of_leader,) = self._under([(leader, laws)])
        best = self.evidences.best(of_leader.values())
        left = [law for law, found in of_leader.items() if self.evidences.gain(best, found) < RULED_OUT]
        asked = [(found, left) for found in fits if found is not leader]
        if leader is not baseline:
            asked.insert(0, (baseline, laws))
        others = iter(self._under(asked))
        own = [of_leader if found is leader else next(others) for found in (baseline, *fits)]
        settled, *ends = (self.evidences.best(of_laws.values()) for of_laws in own)
        return settled, ends

    def _under(self, asked: Sequence[tuple[Fit, Sequence[str]]]) -> list[dict[str, Fit]]:
        """Each fit under its own elastic law, and gone on under others, by the laws."""
        further = [(found, law) for found, laws in asked for law in laws if law != self._law_of(found)]
        gone_on = iter(self._gone_on(further))
        return [
            {self._law_of(found): found} | {law: next(gone_on) for law in laws if law != self._law_of(found)}
            for found, laws in asked
        ]

    def _law_of(self, found: Fit) -> str:
        return found.unknowns.elastic_law or self.measurements.elastic_laws[0]

    def _gone_on(self, asked: Sequence[tuple[Fit, str | None]]) -> list[Fit]:
        """Fits gone on until they converge, each under an elastic law and beside an error of the size that it leaves."""
        data = self.measurements.train
        own = [self.measurements.beside_error(self.evidences.of(found).size).train for found, _ in asked]
        requests = [
            continued(found, data, theirs, self.steps, law, thorough=True)
            for (found, law), theirs in zip(asked, own, strict=True)
        ]
        return [rewhitened(found, theirs, data) for found, theirs in zip(together(requests), own, strict=True)]
