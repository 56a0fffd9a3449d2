"""Expected information about which of some answers is right, from a measurement that each predicts as a Gaussian.

Each member i predicts N(mu_i, S) with probability p_i. The information is the mutual information between the member and
the measurement: the entropy of the members' probabilities, less its expected value after the measurement (Lindley 1956,
"On a measure of the information provided by an experiment"). It is never negative, and never more than that entropy.

Only differences of the means count, so the integral over the measurement has one dimension less than there are members.
Scrambled Sobol points of a fixed seed take it.
"""

from __future__ import annotations

import numpy as np
from scipy.special import logsumexp
from scipy.stats import qmc

from physreal_core.array_types import Array, Float

POINTS = 2**12
"""Sobol points per member: the error is below 1e-3 nat (tests/gap/test_next_motion_information.py)."""


def entropy(probabilities: Float[Array, " members"]) -> float:
    """Of some probabilities [nat]."""
    kept = probabilities[probabilities > 0]
    return float(max(0.0, -(kept * np.log(kept)).sum()))


def expected_information(probabilities: Float[Array, " members"], gram: Float[Array, "members members"]) -> float:
    """Mutual information between the member and the measurement [nat].

    Args:
        probabilities: of the members; they add up to one.
        gram: products mu_i^T S^-1 mu_j of the means about any common origin.
    """
    means = _coordinates(gram)
    if not means.shape[1]:
        return 0.0
    normal = qmc.MultivariateNormalQMC(np.zeros(means.shape[1]), seed=0).random(POINTS)
    left = sum(p * _entropy_after(mean + normal, means, probabilities) for p, mean in zip(probabilities, means))
    before = entropy(probabilities)
    return float(np.clip(before - left, 0.0, before))


def _entropy_after(
    measured: Float[Array, "points axes"], means: Float[Array, "members axes"], probabilities: Float[Array, " members"]
) -> float:
    """Mean entropy of the members' probabilities after these measurements [nat]."""
    with np.errstate(divide="ignore"):
        weights = np.log(probabilities) - 0.5 * ((measured[:, None] - means) ** 2).sum(-1)
    posterior = np.exp(weights - logsumexp(weights, axis=1, keepdims=True))
    return float(-(posterior * np.log(np.where(posterior > 0, posterior, 1.0))).sum(1).mean())


def _coordinates(gram: Float[Array, "members members"]) -> Float[Array, "members axes"]:
    """The means in an orthonormal basis of what they differ by, one axis less than members at most."""
    centring = np.eye(len(gram)) - 1.0 / len(gram)
    values, vectors = np.linalg.eigh(centring @ gram @ centring)
    kept = values > 1e-9 * max(1.0, float(np.abs(values).max()))
    return vectors[:, kept] * np.sqrt(values[kept])


def separations(gram: Float[Array, "members members"]) -> Float[Array, "members members"]:
    """Expected gain in log evidence of the right member over each other one [nat]: |mu_i - mu_j|^2 / 2 under S^-1."""
    own = np.diag(gram)
    return np.maximum(0.0, 0.5 * (own[:, None] + own[None] - 2.0 * gram))
