"""Fits that go on beside a model's error as large as they leave, after they were made beside one as large as the baseline leaves."""

from __future__ import annotations

from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Fit, fit, together
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import Measurements


def finished(found: Fit, measurements: Measurements, evidences: Evidences, steps: int) -> Fit:
    """The fit after some more steps, or itself if they gain no evidence; in units of the noise beside which it was made.

    Args:
        found: the fit.
        measurements: that it was made to.
        evidences: of fits to them.
        steps: largest number of further ones.
    """
    data, own = measurements.train, measurements.beside_error(evidences.of(found).size).train
    begun = rewhitened(found, data, own)
    (converged,) = together([fit(found.unknowns, own, found.vector[None], steps, [begun.jacobian])], own)
    following = rewhitened(converged, own, data)
    return following if evidences.gain(following, found) > 0.0 else found
