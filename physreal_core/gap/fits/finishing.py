"""Fits that go on beside a model's error as large as they leave, after they were made beside one as large as the baseline leaves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Data, Fit, energy_of, fit, together
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
    begun = _rewhitened(found, data, own)
    (converged,) = together([fit(found.unknowns, own, found.vector[None], steps, [begun.jacobian])], own)
    following = _rewhitened(converged, own, data)
    return following if evidences.gain(following, found) > 0.0 else found


def _rewhitened(found: Fit, known: Data, data: Data) -> Fit:
    """A fit to the same measurements beside another noise model."""
    columns = np.concatenate([found.residual[:, None], found.jacobian], axis=1)
    parts = zip(known.noises, data.noises, known.rows(), strict=True)
    changed = np.concatenate([new.from_weighted(old.weighted(columns[own])) for old, new, own in parts])
    energy = energy_of(found.unknowns, found.vector, changed[:, 0])
    return replace(found, residual=changed[:, 0], jacobian=changed[:, 1:], energy=energy)
