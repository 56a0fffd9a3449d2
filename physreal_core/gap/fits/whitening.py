"""Fits and tangents beside another noise model than that in whose units they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.least_squares import Data, Fit, energy_of


def rewhitened(found: Fit, known: Data, data: Data) -> Fit:
    """A fit in units of another noise model.

    Args:
        found: the fit; one whose rollout failed has no residual, and stays failed.
        known: the measurements, with the noise models in whose units the fit is.
        data: the same with other noise models.
    """
    if not np.isfinite(found.energy):
        return found
    columns = rewhitened_columns(np.concatenate([found.residual[:, None], found.jacobian], axis=1), known, data)
    energy = energy_of(found.unknowns, found.vector, columns[:, 0])
    return replace(found, residual=columns[:, 0], jacobian=columns[:, 1:], energy=energy)


def rewhitened_columns(
    columns: Float[Array, "entries columns"], known: Data, data: Data
) -> Float[Array, "entries columns"]:
    """Whitened columns in units of another noise model; arguments as of `rewhitened`."""
    parts = zip(known.noises, data.noises, known.rows(), strict=True)
    return np.concatenate([new.from_weighted(old.weighted(columns[own])) for old, new, own in parts])
