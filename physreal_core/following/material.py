"""A material that is learnt from a stream: an ensemble of models that differ in it, and the ensemble transform Kalman filter.

Members m have material m_m, as logarithms of factors, and forecast the points y_m. With their anomalies M and Y (differences from the mean,
Y in units of the noise) and the whitened difference d of what is seen from the mean forecast, the update is (Hunt, Kostelich and
Szunyogh 2007, eqs. 21 to 24)

    P = ((n - 1) I + Y Y^T)^-1,   w = P Y d,   W = ((n - 1) P)^(1/2),   m_m = mean + (w + W_m) M.

The forecast's error, which is no noise, belongs to the covariance of d. It hangs on from frame to frame, so that several frames count as one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.stats import norm, qmc

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.rollouts import Fields

FARTHEST = 1.5
"""Of the logarithm of a factor, how far it may go from the fit's."""


@dataclass(frozen=True)
class Update:
    """What a frame says about the members.

    Attributes:
        weights: w, of the members' anomalies in the mean.
        transform: W.
    """

    weights: Float[Array, " members"]
    transform: Float[Array, "members members"]

    def of_mean(self, values: Float[Array, "members ..."]) -> Float[Array, "..."]:
        """By how much the mean of the members' values changes."""
        return np.tensordot(self.weights, values - values.mean(0), 1)

    def spread(self, values: Float[Array, "members ..."]) -> Float[Array, "..."]:
        """Standard deviation of the members' values afterwards; nothing of a single one."""
        after = np.tensordot(self.transform, values - values.mean(0), 1)
        return np.sqrt((after**2).sum(0) / max(len(after) - 1, 1))


class LearntMaterial:
    """Factors on numbers of a model, of which every member has its own.

    Args:
        model: fitted.
        spreads: standard deviation of the logarithm of each factor at first, by the name of a field of the model.
        members: how many.
        frames: that count as one.

    Raises:
        InputError: the model has no such field, or there are fewer members than two for each factor.
    """

    def __init__(self, model: Model, spreads: Mapping[str, float], members: int, frames: float) -> None:
        if strange := sorted(set(spreads) - set(model.fields)):
            raise InputError(
                f"no {strange[0]!r} to learn", where="FollowConfig.learns", expected=f"one of {sorted(model.fields)}"
            )
        if members < 2 * len(spreads):
            raise InputError(f"{members} members", where="FollowConfig.members", expected=f"{2 * len(spreads)} or more")
        self._model, self.names, self._frames = model, tuple(spreads), frames
        drawn = norm.ppf(qmc.LatinHypercube(len(self.names), seed=0).random(members))
        drawn = (drawn - drawn.mean(0)) / drawn.std(0, ddof=1)
        self.logarithms: Float[Array, "members factors"] = drawn * np.array([*spreads.values()])

    def fields(self, member: int) -> Fields:
        """The model's fields with the factors of a member."""
        factors = np.exp(np.clip(self.logarithms[member], -FARTHEST, FARTHEST))
        own = {name: self._model.fields[name] * float(f) for name, f in zip(self.names, factors, strict=True)}
        return {**self._model.fields, **own}

    def told(self) -> dict[str, dict[str, float]]:
        """Of each factor its mean, and the deviation of its logarithm."""
        mean, deviation = self.logarithms.mean(0), self.logarithms.std(0, ddof=1)
        return {
            name: {"factor": float(np.exp(m)), "log_deviation": float(d)}
            for name, m, d in zip(self.names, mean, deviation, strict=True)
        }

    def update(
        self,
        forecasts: Float[Array, "members tracks 3"],
        difference: Float[Array, "tracks 3"],
        valid: Bool[Array, " tracks"],
        covariance: Float[Array, "tracks tracks"],
    ) -> Update:
        """Learn from a frame.

        Args:
            forecasts: of the tracked points [m].
            difference: of the seen places from their mean [m]; anything where not valid.
            valid: which points are seen.
            covariance: of `difference` along an axis beside the members' spread, forecast's error and noise [m2].
        """
        count = len(forecasts)
        if not valid.any():
            return Update(np.zeros(count), np.eye(count))
        factor = cholesky(self._frames * covariance[np.ix_(valid, valid)], lower=True)
        whiten = lambda columns: solve_triangular(factor, columns, lower=True)
        anomalies = (forecasts - forecasts.mean(0))[:, valid]
        Y = whiten(anomalies.transpose(1, 0, 2).reshape(valid.sum(), -1)).reshape(-1, count, 3)
        Y = Y.transpose(1, 0, 2).reshape(count, -1)
        values, vectors = np.linalg.eigh((count - 1) * np.eye(count) + Y @ Y.T)
        weights = vectors @ ((vectors.T @ (Y @ whiten(difference[valid]).ravel())) / values)
        update = Update(weights, vectors * np.sqrt((count - 1) / values) @ vectors.T)
        own = self.logarithms - self.logarithms.mean(0)
        self.logarithms = self.logarithms.mean(0) + (update.weights + update.transform) @ own
        return update
