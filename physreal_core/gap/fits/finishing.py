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

FAR_BEHIND = 150.0
"""Loss in log evidence against the best answer [nat] from which on no noise model is built around an answer: it would not save it."""

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

    def ended(self, baseline: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
        """The baseline and other fits after some more steps, each under its best elastic law, and judged beside noise of its own."""
        begun, *settled = self.settled([baseline, *fits])
        begun, settled = self.under_the_best_law(begun, settled)
        end, *ends = self.beside_own_motion([begun, *settled])
        return end, ends

    def settled(self, fits: Sequence[Fit]) -> list[Fit]:
        """Each fit after some more steps, or as it was if they gain no evidence."""
        pairs = zip(fits, self._gone_on([(found, None) for found in fits], thorough=True), strict=True)
        return [self.evidences.best(pair) for pair in pairs]

    def under_the_best_law(self, baseline: Fit, fits: Sequence[Fit]) -> tuple[Fit, list[Fit]]:
        """The baseline and other fits, each under that elastic law which gives it the most evidence.

        A law that the best of them rules out is not tried beside other effects, nor any beside effects that gain nothing. The
        baseline does not rule it out for them: where an effect is missing, it may like a wrong law far better.
        """
        laws, leader = self.measurements.elastic_laws, self.evidences.best([baseline, *fits])
        (of_leader,) = self._under([(leader, laws)])
        best = self.evidences.best(of_leader.values())
        left = [law for law, found in of_leader.items() if self.evidences.gain(best, found) < RULED_OUT]
        asked = [(f, left if self.evidences.gain(f, baseline) >= 0.0 else ()) for f in fits if f is not leader]
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

    def beside_own_motion(self, fits: Sequence[Fit]) -> list[Fit]:
        """Those that are not far behind the best, gone on beside noise models around their own motions, and judged beside these.

        Beside those around the baseline, a wrong answer whose motion is like the baseline's would be forgiven more than a right one
        whose motion is not.
        """
        best, data = self.evidences.best(fits), self.measurements.train
        near = [found for found in fits if self.evidences.gain(best, found) < FAR_BEHIND]
        around = self.measurements.around_others([found.unknowns.trial(found.vector) for found in near])
        own = [m.beside_error(self.evidences.of(found).size) for m, found in zip(around, near, strict=True)]
        requests = [continued(f, data, theirs.train, self.steps) for f, theirs in zip(near, own, strict=True)]
        ends = {}
        for found, theirs, end in zip(near, own, together(requests), strict=True):
            pair = found, rewhitened(end, theirs.train, data)
            ends[id(found)] = max(pair, key=lambda fit: self.evidences.judge_beside(fit, theirs).log_evidence)
        return [ends.get(id(found), found) for found in fits]

    def _law_of(self, found: Fit) -> str:
        return found.unknowns.elastic_law or self.measurements.elastic_laws[0]

    def _gone_on(self, asked: Sequence[tuple[Fit, str | None]], thorough: bool = False) -> list[Fit]:
        """Fits after some more steps, each under an elastic law and beside an error of the size that it leaves."""
        data = self.measurements.train
        own = [self.measurements.beside_error(self.evidences.of(found).size).train for found, _ in asked]
        requests = [
            continued(found, data, theirs, self.steps, law, thorough)
            for (found, law), theirs in zip(asked, own, strict=True)
        ]
        return [rewhitened(found, theirs, data) for found, theirs in zip(together(requests), own, strict=True)]
