"""The model's error of one interaction where its size is not known: the directions in which it lies, and its variance along each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import logsumexp
from scipy.stats import norm

from physreal_core.array_types import Array, Float
from physreal_core.gap.noise.model import Noise


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
        noise: of the interaction; its own size of the error does not matter.
    """

    def __init__(self, noise: Noise) -> None:
        self.noise = noise
        self._log_known = 0.5 * float(np.log1p(noise.known.variances).sum())

    def log_sizes(self, sizes: Float[Array, " sizes"]) -> Float[Array, " sizes"]:
        """Half the logarithm of the covariance's determinant for each size of the error, up to a constant of the sensor."""
        return self._log_known + 0.5 * np.log1p(sizes[:, None] ** 2 * self.noise.field.variances).sum(1)

    def products(
        self, whitened: Float[Array, "entries columns"], sizes: Float[Array, " sizes"]
    ) -> Float[Array, "sizes columns columns"]:
        """Products of columns under the inverse covariance for each size of the error (Woodbury's identity).

        Args:
            whitened: columns as the noise has whitened them.
            sizes: of the error.
        """
        columns, field = self.noise.beside_known(whitened), self.noise.field
        along, variances = field.along(columns), sizes[:, None] ** 2 * field.variances
        imitated = np.einsum("kc,sk,kd->scd", along, variances / (1.0 + variances), along, optimize=True)
        return columns.T @ columns - imitated
