"""Directions in which thousands of entries vary together, and products with them."""

from __future__ import annotations

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor

LEAST = 1e-6
"""Share of the largest variance below which a direction is left out."""


class Axes:
    """Principal axes of a sum of outer products of columns.

    Args:
        columns: shape [n, M], hundreds of them for thousands of entries.
        device: where products run.

    Attributes:
        variances: along each axis, shape [K].
    """

    def __init__(self, columns: Float[Array, "entries columns"], device: str) -> None:
        self._device = device
        given = self._moved(columns)
        values, vectors = _principal((given.T @ given).double())
        kept = values > LEAST * values[-1].clamp_min(1e-30)
        self._directions = given @ (vectors[:, kept] / values[kept].sqrt()).float()
        self.variances: Float[Array, " axes"] = values[kept].cpu().numpy()

    @property
    def deviations(self) -> Float[Array, "entries axes"]:
        """One standard deviation along each axis."""
        return self._directions.cpu().numpy() * np.sqrt(self.variances)

    def along(self, columns: Float[Array, "entries columns"]) -> Float[Array, "axes columns"]:
        """The parts of columns along each axis."""
        return self._product(self._directions.T, columns)

    def stretched(self, columns: Float[Array, "entries columns"], factors: Array) -> Float[Array, "entries columns"]:
        """Columns with what lies along each axis multiplied by a factor."""
        return columns + self._product(self._directions, (factors - 1.0)[:, None] * self.along(columns))

    def _product(self, matrix: Tensor, columns: Array) -> Float[Array, "rows columns"]:
        if matrix.is_cpu:  # NumPy's product with a few columns takes a third of the time of torch's
            return (matrix.numpy() @ columns.astype(np.float32)).astype(np.float64)
        return (matrix @ self._moved(columns)).double().cpu().numpy()

    def _moved(self, columns: Array) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(columns, dtype=np.float32)).to(self._device)


def _principal(
    covariance: Float[Tensor, "columns columns"],
) -> tuple[Float[Tensor, " columns"], Float[Tensor, "columns columns"]]:
    """Its eigenvalues, and its eigenvectors as columns."""
    try:
        return torch.linalg.eigh(covariance)
    except torch.linalg.LinAlgError:  # a card's solver gives up on some that LAPACK solves
        values, vectors = torch.linalg.eigh(covariance.cpu())
        return values.to(covariance.device), vectors.to(covariance.device)
