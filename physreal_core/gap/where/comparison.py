"""A simulation beside its measurement, in units of their expected difference: noise and numerical error.

The null hypothesis is simulated - measured = sum_m a_m mode_m + noise, with a_m of mean zero and variance one. So every
weighted sum of residuals has a known standard deviation, and with it every number that `where` reports.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import special, stats

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError

_FOURTH_DIFFERENCE = (1.0, -4.0, 6.0, -4.0, 1.0)


@dataclass(frozen=True)
class Comparison:
    """Simulated and measured positions of the tracked points.

    Args:
        simulated: positions [m], shape [T, J, 3], known everywhere.
        measured: positions [m], shape [T, J, 3]; anything where `valid` is false.
        sigma: standard deviation of each coordinate of a measurement [m], shape [T, J].
        valid: entries with a measurement, shape [T, J].
        fps: frames per second.
        modes: displacements by other things than independent noise (grid, time step, a wrong starting point), one
            standard deviation long [m], at the valid entries in the order of `valid`, shape [M, entries, 3]; None for
            none.

    Raises:
        InputError: shapes disagree, nothing is valid, a number in use is not finite, or a sigma is not positive.
    """

    simulated: Float[Array, "T J 3"]
    measured: Float[Array, "T J 3"]
    sigma: Float[Array, "T J"]
    valid: Bool[Array, "T J"]
    fps: float
    modes: Float[Array, "M entries 3"] | None = None

    def __post_init__(self) -> None:
        shape = self.simulated.shape
        found = {"measured": self.measured.shape, "sigma": self.sigma.shape + (3,), "valid": self.valid.shape + (3,)}
        wrong = [f"{name} {size}" for name, size in found.items() if size != shape]
        if wrong:
            raise InputError(f"{', '.join(wrong)} beside simulated {shape}", expected="the same frames and tracks")
        if self.modes is not None and self.modes.shape[1] != self.valid.sum():
            raise InputError(f"modes at {self.modes.shape[1]} entries", expected=f"the {self.valid.sum()} valid ones")
        if not self.valid.any():
            raise InputError("no valid entry in the tracks", expected="at least one measured position")
        used = np.isfinite(self.simulated).all(-1) & np.isfinite(self.measured).all(-1) & (self.sigma > 0)
        if not used[self.valid].all():
            frame, track = np.argwhere(self.valid & ~used)[0]
            raise InputError(
                "a position that is not finite, or a sigma that is not positive", where=f"frame {frame}, track {track}"
            )

    @cached_property
    def residual(self) -> Float[Array, "T J 3"]:
        """Simulated - measured [m], zero where nothing was measured."""
        return np.where(self.valid[..., None], self.simulated - self.measured, 0.0)

    @cached_property
    def whitened(self) -> Float[Array, "T J 3"]:
        """The residual in units of the noise, zero where nothing was measured."""
        return self.residual / self._noise[..., None]

    @cached_property
    def whitened_modes(self) -> Float[Array, "entries 3 M"]:
        """The modes in units of the noise, at the valid entries; modes last, so that an entry's numbers lie together."""
        count = int(self.valid.sum())
        modes = np.zeros((0, count, 3)) if self.modes is None else self.modes
        scale = self._noise[self.valid][:, None, None].astype(modes.dtype)
        return np.ascontiguousarray(modes.transpose(1, 2, 0)) / scale

    @cached_property
    def _mode_squares(self) -> Float[Array, " entries"]:
        return np.einsum("ecm,ecm->e", self.whitened_modes, self.whitened_modes)

    @cached_property
    def noise_scale(self) -> float:
        """Estimated noise over the stated `sigma`, at least one.

        The estimate is the median of fourth differences over time. They remove a smooth disagreement (of a swing of 3
        Hz at 30 frames a second a fiftieth is left) but not the noise, and the median ignores impacts. Noise that looks
        smaller than sigma may be smooth in time, so sigma is kept; it is kept too where the excess may be chance.
        """
        if len(self.valid) < 5:
            return 1.0
        starts = range(len(self.valid) - 4)
        complete = np.stack([self.valid[t : t + 5].all(0) for t in starts])
        plain = self.residual / np.where(self.valid, self.sigma, 1.0)[..., None]
        differences = np.stack([np.tensordot(_FOURTH_DIFFERENCE, plain[t : t + 5], 1) for t in starts])[complete]
        scale = (
            float(np.median(np.abs(differences)) / (stats.norm.ppf(0.75) * np.sqrt(70.0))) if len(differences) else 1.0
        )
        # a median of n independent numbers scatters by 1.17 / sqrt(n); overlapping differences are worth fewer than half
        chance = 3.0 * 1.9 / np.sqrt(max(1, differences.size))
        return scale if scale > 1.0 + chance else 1.0

    @cached_property
    def _noise(self) -> Float[Array, "T J"]:
        return np.where(self.valid, self.sigma * self.noise_scale, 1.0)

    def deviation(self, weights: Float[Array, "T J 3"]) -> float:
        """Standard deviation of sum(weights * residual) by noise and numerical error."""
        scaled = weights[self.valid] * self._noise[self.valid][:, None]
        used = scaled.any(1)  # of many modes only what is looked at
        modes = self.whitened_modes[used] if not used.all() else self.whitened_modes
        along = scaled[used].ravel().astype(modes.dtype) @ modes.reshape(3 * len(modes), modes.shape[2])
        return float(np.sqrt((scaled**2).sum() + (along**2).sum()))

    def rms(self, chosen: Bool[Array, "T J"] | None = None) -> Sizes:
        """Root mean square distances over the valid entries, or over those of them that are chosen."""
        entries = self.valid if chosen is None else self.valid & chosen
        count = max(1, int(entries.sum()))
        weights = np.where(entries[..., None], self.residual, 0.0)
        total = float((weights**2).sum())
        noise = 3.0 * float((self._noise[entries] ** 2).sum())
        used = entries[self.valid]
        numerics = float((self._mode_squares[used] * self._noise[entries] ** 2).sum())
        # the length of a vector changes by what is added along it
        deviation = self.deviation(weights / np.sqrt(total * count)) if total > 0 else 0.0
        gap = max(0.0, total - noise - numerics)
        return Sizes(*(float(np.sqrt(part / count)) for part in (total, noise, numerics, gap)), deviation)


@dataclass(frozen=True)
class Sizes:
    """Root mean square distances [m].

    Args:
        residual: between simulation and measurement.
        noise, numerics: what noise alone and numerical error alone would give.
        gap: the residual without these two; zero where they explain it.
        deviation: standard deviation of `residual` by noise and numerical error.
    """

    residual: float
    noise: float
    numerics: float
    gap: float
    deviation: float


@dataclass(frozen=True)
class Agreement:
    """A test of the null hypothesis that simulation and measurement differ by noise and numerical error alone.

    Args:
        statistic: generalised chi-square over the smooth part of the residual.
        degrees: of freedom.
        p_value: probability of so large a statistic under the null hypothesis.
        log10_p: decimal logarithm of `p_value`, which does not underflow.
    """

    statistic: float
    degrees: int
    p_value: float
    log10_p: float


def agreement(comparison: Comparison, *, window: float = 0.1, overdispersion: float = 1.0) -> Agreement:
    """Test for a disagreement beyond noise and numerical error.

    A systematic residual is smooth over the body and over a short time. So in each window of time the residual is
    reduced to a linear field over the points. The noise of thousands of entries averages out in these few numbers, and
    a wrong sigma, which adds to all entries alike, matters little.

    Args:
        comparison: of simulation and measurement.
        window: half the period of the fastest motion that is to be seen [s].
        overdispersion: the statistic over its degrees of freedom on captures of known truth where nothing is missing;
            one for a perfect noise model.
    """
    length = max(1, round(window * comparison.fps))
    starts = range(0, len(comparison.valid), length)
    scores = [local_scores(comparison, slice(start, start + length)) for start in starts]
    values, modes = (np.concatenate([part[i] for part in scores]) for i in range(2))
    return _chi_square(values, modes, overdispersion)


def frame_agreement(comparison: Comparison, overdispersion: float = 1.0) -> list[Agreement]:
    """The same test for every frame alone, shape [T]."""
    slices = [slice(frame, frame + 1) for frame in range(len(comparison.valid))]
    return [_chi_square(*local_scores(comparison, part), overdispersion) for part in slices]


def local_scores(comparison: Comparison, frames: slice) -> tuple[Float[Array, " n"], Float[Array, "n M"]]:
    """Coefficients of the residual and of each mode in a linear field over the points. Each has noise of variance one.

    Args:
        comparison: of simulation and measurement.
        frames: over which the field is constant.
    """
    valid = comparison.valid[frames]
    tracks = np.nonzero(valid)[1]
    basis = _linear_field(comparison.simulated[0])[tracks] / comparison._noise[frames][valid][:, None]
    left, sizes, _ = np.linalg.svd(basis, full_matrices=False)
    left = left[:, sizes > 1e-6 * sizes.max(initial=0.0)]
    values = left.T @ comparison.whitened[frames][valid]
    among = np.zeros(comparison.valid.shape, bool)
    among[frames] = valid
    modes = np.tensordot(left.T, comparison.whitened_modes[among[comparison.valid]].astype(np.float64), 1)
    return values.reshape(-1), modes.reshape(values.size, modes.shape[-1])


def _linear_field(points: Float[Array, "J 3"]) -> Float[Array, "J 4"]:
    """A constant and the coordinates, in units of the points' extent."""
    centred = points - points.mean(0)
    return np.hstack([np.ones((len(points), 1)), centred / max(np.abs(centred).max(), 1e-12)])


def _chi_square(values: Float[Array, " n"], modes: Float[Array, "n M"], overdispersion: float) -> Agreement:
    """Test of the null hypothesis values ~ N(0, 1 + modes modesᵀ)."""
    covariance = np.eye(len(values)) + modes @ modes.T
    statistic = float(values @ np.linalg.solve(covariance, values)) / overdispersion
    log_p = _log_tail(statistic, len(values)) if len(values) else 0.0
    return Agreement(statistic, len(values), float(np.exp(log_p)), log_p / np.log(10.0))


def _log_tail(statistic: float, degrees: int) -> float:
    """Natural logarithm of the chi-square tail; where that underflows, its leading asymptotic term (DLMF 8.11.7)."""
    log_p = float(stats.chi2.logsf(statistic, degrees))
    if np.isfinite(log_p):
        return log_p
    a, x = 0.5 * degrees, 0.5 * statistic
    return float((a - 1.0) * np.log(x) - x - special.gammaln(a) - np.log1p(-(a - 1.0) / x))
