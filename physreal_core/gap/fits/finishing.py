"""Fits that go on beside a model's error as large as they leave, after they were made beside one as large as the baseline leaves."""

from __future__ import annotations

from collections.abc import Sequence

from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Data, Fit, Request, fit, together
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import Measurements


def continued(found: Fit, known: Data, data: Data, steps: int) -> Request:
    """A fit that goes on from where it is, with its tangents, beside another noise model.

    Args:
        found: the fit.
        known: the measurements, with the noise models beside which it was made.
        data: the same with others.
        steps: largest number of further ones.
    """
    begun = rewhitened(found, known, data)
    return fit(begun.unknowns, data, begun.vector[None], steps, [begun.jacobian])


def finished(fits: Sequence[Fit], measurements: Measurements, evidences: Evidences, steps: int) -> list[Fit]:
    """Fits after some more steps, or themselves if they gain no evidence; in units of the noise beside which they were made.

    Args:
        fits: to the measurements.
        measurements: that they were made to.
        evidences: of fits to them.
        steps: largest number of further ones.
    """
    data = measurements.train
    own = [measurements.beside_error(evidences.of(found).size).train for found in fits]
    converged = together([continued(found, data, theirs, steps) for found, theirs in zip(fits, own, strict=True)])
    following = [rewhitened(found, theirs, data) for found, theirs in zip(converged, own, strict=True)]
    return [
        later if evidences.gain(later, found) > 0.0 else found for later, found in zip(following, fits, strict=True)
    ]
