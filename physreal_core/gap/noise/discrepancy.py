"""The model's error of one interaction where its size is not known: the directions in which it lies, and its variance along each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.special import logsumexp
from scipy.stats import norm

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.gap.noise.model import ModelError, Noise, principal_axes


@dataclass(frozen=True)
class ErrorPrior:
    """What is known of the model's error before a capture is seen, from controls on many bodies (docs/gap_benchmark.md).

    Args:
        sizes: of the error, as factors on `ModelError`, that are tried.
        median: of the size.
        spread: standard deviation of its logarithm.
    """

    sizes: tuple[float, ...] = tuple(2.0 ** (step / 8) for step in range(-24, 41))
    median: float = 0.5
    spread: float = 0.8

    @property
    def log_weights(self) -> Float[Array, " sizes"]:
        """Log prior probabilities of the sizes."""
        logs = -0.5 * (np.log(np.array(self.sizes) / self.median) / self.spread) ** 2
        return logs - logsumexp(logs)

    def exceeded_by(self, share: float) -> float:
        """The size that this share of the controls exceeds."""
        return float(self.median * np.exp(norm.isf(share) * self.spread))

    def p_value(self, size: float) -> float:
        """Share of controls whose error is larger than a size."""
        return float(norm.sf(np.log(size / self.median) / self.spread))


class Discrepancy:
    """The model's error of one interaction.

    Args:
        noise: of the interaction.
        error: of the model, at size one.
        device: where products run.

    Attributes:
        noise: as given.
        variances: along each axis, at size one, in units of all that has a known size, shape [K].
    """

    def __init__(self, noise: Noise, error: ModelError, device: str = "cpu") -> None:
        self.noise, self._device = noise, device
        self._known, variances = principal_axes(self._tensor(noise.known_columns()))
        self._log_known = 0.5 * float(variances.log1p().sum())
        self._less = (1.0 - 1.0 / (1.0 + variances).sqrt()).float()
        self._axes, variances = principal_axes(self._without_known(self._tensor(noise.field_columns(error))))
        self.variances: Float[Array, " axes"] = variances.cpu().numpy()

    def log_sizes(self, sizes: Float[Array, " sizes"]) -> Float[Array, " sizes"]:
        """Half the logarithm of the covariance's determinant for each size of the error, up to a constant of the sensor."""
        return self._log_known + 0.5 * np.log1p(sizes[:, None] ** 2 * self.variances).sum(1)

    def products(
        self, whitened: Float[Array, "entries columns"], sizes: Float[Array, " sizes"]
    ) -> Float[Array, "sizes columns columns"]:
        """Products of columns under the inverse covariance for each size of the error (Woodbury's identity).

        Args:
            whitened: columns as the noise has whitened them.
            sizes: of the error.
        """
        columns = self._without_known(self._tensor(self.noise.weighted(whitened)))
        without = (columns.double().T @ columns.double()).cpu().numpy()
        along = (self._axes.T @ columns).double().cpu().numpy()
        variances = sizes[:, None] ** 2 * self.variances
        return without - np.einsum("kc,sk,kd->scd", along, variances / (1.0 + variances), along, optimize=True)

    def _tensor(self, columns: Array) -> Float[Tensor, "entries columns"]:
        return torch.from_numpy(np.ascontiguousarray(columns, dtype=np.float32)).to(self._device)

    def _without_known(self, weighted: Float[Tensor, "entries columns"]) -> Float[Tensor, "entries columns"]:
        """Columns in units of all that has a known size."""
        return weighted - self._known @ (self._less[:, None] * (self._known.T @ weighted))
