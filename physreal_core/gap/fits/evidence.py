"""Log evidence of fits where the size of the model's error is not known (Kennedy and O'Hagan 2001).

Every fit leaves an error of its own. Its size is integrated out under a prior, so a fit that leaves little is not judged by
the error of one that leaves much. In K directions that the data resolve, a rival that leaves twice as much loses K log 2:
the more is measured, the smaller a class.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import logsumexp

from physreal_core.array_types import Array, Float
from physreal_core.gap.fits.least_squares import Fit, laplace, newton_step
from physreal_core.gap.noise.discrepancy import Discrepancy
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.settings import GapSettings


@dataclass(frozen=True)
class Evidence:
    """Of one fit.

    Args:
        log_evidence: [nat], up to a constant that all fits to the same data share.
        shares: posterior probabilities of the sizes of the model's error that the fit leaves.
        size: of that error, as a factor on `ModelError`; the geometric mean.
        covariance: of the unknowns' posterior, shape [P, P].
    """

    log_evidence: float
    shares: Float[Array, " sizes"]
    size: float
    covariance: Float[Array, "unknowns unknowns"]


class Evidences:
    """The evidence of fits to the same measurements; each is computed once.

    Args:
        measurements: that the fits were made to.
        settings: of the search; they say what is known of the model's error.
    """

    def __init__(self, measurements: Measurements, settings: GapSettings) -> None:
        self._measurements, self._settings = measurements, settings
        self._prior = settings.error_prior
        self._rows, self._sizes = measurements.train.rows(), np.array(self._prior.sizes)
        self._found: dict[int, tuple[Fit, Evidence]] = {}

    def of(self, fit: Fit) -> Evidence:
        """The evidence of a fit; minus infinity where its rollout failed."""
        if id(fit) not in self._found:
            self._found[id(fit)] = fit, self._evidence(fit)  # the fit is kept, so that no other gets its number
        return self._found[id(fit)][1]

    def gain(self, fit: Fit, baseline: Fit) -> float:
        """Of a fit in log evidence over another one [nat]."""
        return self.of(fit).log_evidence - self.of(baseline).log_evidence

    def best(self, fits: Iterable[Fit]) -> Fit:
        """The fit of the most evidence; of equally good ones the first."""
        return max(fits, key=lambda fit: self.of(fit).log_evidence)

    def held_out(self, fit: Fit, predictions: Sequence[Float[Array, "frames tracks 3"]]) -> float:
        """Log density of the held-out frames of all interactions under a fit [nat], up to a constant; zero without any.

        Args:
            fit: to the training frames.
            predictions: tracks over all frames of each interaction [m].
        """
        logs, seen = np.zeros(len(self._sizes)), self._measurements.experiments
        for number, part in enumerate(self._held_out_parts):
            if part is not None:
                residual = part.noise.whiten((predictions[number] - seen[number].measured)[None])
                logs -= 0.5 * part.products(residual, self._sizes)[:, 0, 0] + part.log_sizes(self._sizes)
        with np.errstate(divide="ignore"):
            return float(logsumexp(logs + np.log(self.of(fit).shares)))

    @cached_property
    def _parts(self) -> list[Discrepancy]:
        return [Discrepancy(noise) for noise in self._measurements.train.noises]

    @cached_property
    def _held_out_parts(self) -> list[Discrepancy | None]:
        noises = [self._measurements.held_out(number) for number in range(len(self._rows))]
        return [None if noise is None else Discrepancy(noise) for noise in noises]

    def _evidence(self, fit: Fit) -> Evidence:
        if not np.isfinite(fit.energy):
            nothing = np.eye(len(self._sizes))[-1]
            return Evidence(-np.inf, nothing, float(self._sizes[-1]), np.linalg.inv(fit.unknowns.block.precision))
        columns = np.concatenate([fit.residual[:, None], fit.jacobian], axis=1)
        products = sum(p.products(columns[own], self._sizes) for p, own in zip(self._parts, self._rows, strict=True))
        spreads = sum(part.log_sizes(self._sizes) for part in self._parts)
        parts = zip(products, spreads, strict=True)
        logs, covariances = zip(*(_laplace(fit, own, float(spread)) for own, spread in parts), strict=True)
        weighted = np.array(logs) + self._prior.log_weights
        total = float(logsumexp(weighted))
        shares = np.exp(weighted - total)
        covariance = np.tensordot(shares, np.array(covariances), axes=1)
        return Evidence(total, shares, float(np.exp(shares @ np.log(self._sizes))), covariance)


def _laplace(fit: Fit, products: Float[Array, "columns columns"], spread: float) -> tuple[float, Array]:
    """Log evidence [nat] and covariance by Laplace's approximation where a fit is, for one size of the model's error.

    The fit was made beside one size. For another, the material follows as the tangents say.

    Args:
        fit: whose residual is the first of the columns, and whose tangents are the others.
        products: of the columns under the inverse covariance.
        spread: half the logarithm of that covariance's determinant.
    """
    unknowns, vector = fit.unknowns, fit.vector
    energy = 0.5 * float(products[0, 0]) + unknowns.prior_energy(vector) + spread
    gradient = products[1:, 0] + unknowns.block.precision @ (vector - unknowns.block.mean)
    hessian = products[1:, 1:] + unknowns.block.precision
    _, decrease = newton_step(unknowns, vector, gradient, hessian, unknowns.baseline)
    return laplace(unknowns, vector, energy - max(decrease, 0.0), hessian)
