"""Fits that go on beside a model's error as large as they leave, after they were made beside one as large as the baseline leaves."""

from __future__ import annotations

from collections.abc import Sequence

from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Fit, fit, together
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import Measurements


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
    begun = [rewhitened(found, data, theirs) for found, theirs in zip(fits, own, strict=True)]
    requests = [
        fit(found.unknowns, theirs, found.vector[None], steps, [found.jacobian])
        for found, theirs in zip(begun, own, strict=True)
    ]
    converged = together(requests) if requests else []
    following = [rewhitened(found, theirs, data) for found, theirs in zip(converged, own, strict=True)]
    return [
        later if evidences.gain(later, found) > 0.0 else found for later, found in zip(following, fits, strict=True)
    ]
