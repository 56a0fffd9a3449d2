"""How far a body is from its forecast, as a smooth field over it, from points that are seen: Gaussian-process regression.

The forecast's error is a Gaussian field over the undeformed body, with one size s and a correlation that falls off with distance as
exp(-d^2 / 2 l^2); each axis has its own. Seen points have independent noise besides. Given the differences r at the points, the error at
other places has the mean s^2 k (s^2 K + R)^-1 r (Rasmussen and Williams 2006, eq. 2.25). In data assimilation this is optimal interpolation
(Daley 1991).
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from physreal_core.array_types import Array, Float


def correlation(a: Float[Array, "n 3"], b: Float[Array, "m 3"], length: float) -> Float[Array, "n m"]:
    """Of the error at two sets of places on the undeformed body [m]."""
    square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
    return np.exp(-0.5 * np.maximum(square, 0.0) / length**2)


@dataclass(frozen=True)
class Analysis:
    """The error, given what is seen.

    Attributes:
        at_points: mean at the tracked points [m].
        at_particles: mean at the particles [m].
        deviation: standard deviation at the tracked points along an axis [m].
    """

    at_points: Float[Array, "tracks 3"]
    at_particles: Float[Array, "particles 3"]
    deviation: Float[Array, " tracks"]


class SmoothError:
    """The regression for one body and its tracked points.

    Args:
        points0: tracked points on the undeformed body [m].
        x0: particles of it [m].
        length: l [m].
    """

    def __init__(self, points0: Float[Array, "tracks 3"], x0: Float[Array, "particles 3"], length: float) -> None:
        self._between = correlation(points0, points0, length)
        self._to_particles = correlation(x0, points0, length)

    def covariance(self, sigma: Float[Array, " tracks"], size: float) -> Float[Array, "tracks tracks"]:
        """Of the differences of seen places from the forecast, along an axis [m2]; arguments as of `analysis`."""
        return size**2 * self._between + np.diag(sigma**2)

    def analysis(
        self, difference: Float[Array, "tracks 3"], valid: Array, sigma: Float[Array, " tracks"], size: float
    ) -> Analysis:
        """The error where some points are seen.

        Args:
            difference: of seen places from the forecast [m]; anything where not valid.
            valid: which points are seen.
            sigma: standard deviations of their noise along an axis [m].
            size: s [m].
        """
        seen = np.flatnonzero(valid)
        K = size**2 * self._between[:, seen]
        if not len(seen):
            nothing = np.zeros_like(difference)
            return Analysis(nothing, np.zeros((len(self._to_particles), 3)), np.full(len(nothing), size))
        factor = cho_factor(self.covariance(sigma, size)[np.ix_(seen, seen)])
        weights = cho_solve(factor, difference[seen])
        left = size**2 - np.einsum("ij,ji->i", K, cho_solve(factor, K.T))
        at_particles = size**2 * self._to_particles[:, seen] @ weights
        return Analysis(K @ weights, at_particles, np.sqrt(np.maximum(left, 0.0)))
