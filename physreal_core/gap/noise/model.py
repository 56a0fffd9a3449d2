"""The noise model: how far residuals may be from zero without a missing effect.

The covariance of the stacked residuals is N + U U^T. N is the sensor's noise (`sensor`). The columns of U are

- the sensor's error in frame 0, which each track carries along, because there it is tied to the object;
- the differences between the model and its reruns in other discretisations (`reruns`);
- what usual errors of the given records would change (`given`);
- a field that is smooth in space and time, for model error that the reruns do not reach (Kennedy and O'Hagan 2001,
  "Bayesian calibration of computer models").

Without U, thousands of entries would average the sensor noise away, and every capture would seem to have a missing
effect.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.gap.noise.sensor import SensorNoise


@dataclass(frozen=True)
class ModelError:
    """Size and smoothness of the simulator's own error, calibrated on captures without a missing effect.

    Args:
        rms: standard deviation of the smooth field where the body has moved far [m].
        moved: displacement from frame 0 over which the field grows to that size [m].
        relative: further part of the field, as a factor on the local size of the reruns' differences.
        reruns: factor on the reruns' differences, which are columns of U themselves.
        time: correlation time of the field [s].
        length: correlation length of the field, as a share of the body's extent.
    """

    rms: float = 0.0004
    moved: float = 0.01
    relative: float = 0.15
    reruns: float = 1.0
    time: float = 0.08
    length: float = 0.5

    def times(self, factor: float) -> ModelError:
        """The same field, as many times as large."""
        return replace(self, rms=factor * self.rms, relative=factor * self.relative)


KEPT = 0.995
"""Share of a kernel's trace that its leading eigenvectors must cover."""


class Noise:
    """The noise model of one interaction over its first frames; it whitens residuals.

    Args:
        sigma: standard deviation of the sensor [m], shape [T, J].
        valid: entries that count, shape [T, J].
        points0: tracked points at frame 0 [m], shape [J, 3].
        motion: where the model takes them [m], shape [T, J, 3].
        reruns: differences of the reruns [m], shape [M, T, J, 3].
        start_sensitivity: derivative of the tracks by the points' start along x, y, z, shape [3, T, J, 3].
        fps: frames per second.
        error: of the model.
        device: where products with the modes run: thousands of entries by hundreds of modes.
        correlation: of the sensor's noise from one frame to the next.
        given: what errors of the given records change [m], one standard deviation each, shape [G, T, J, 3]; None: nothing.

    Attributes:
        sensor: the sensor's part.
        variances: along each axis, in units of the sensor's noise, shape [K].
    """

    def __init__(
        self,
        sigma: Float[Array, "frames tracks"],
        valid: Bool[Array, "frames tracks"],
        points0: Float[Array, "tracks 3"],
        motion: Float[Array, "frames tracks 3"],
        reruns: Float[Array, "modes frames tracks 3"],
        start_sensitivity: Float[Array, "3 frames tracks 3"],
        fps: float,
        error: ModelError,
        device: str = "cpu",
        correlation: float = 0.0,
        given: Float[Array, "records frames tracks 3"] | None = None,
    ) -> None:
        self.valid, self.frames = valid, len(valid)
        self.sensor = SensorNoise(sigma, valid, correlation)
        given = np.zeros((0, *motion.shape)) if given is None else given
        self._parts = points0, motion, reruns, start_sensitivity, given, fps, error
        # Of hundreds of megabytes, and sooner made again than read: no checkpoint.
        columns = np.concatenate([self.known_columns(), self.field_columns(error)], axis=1)
        self._basis, variances = principal_axes(torch.from_numpy(columns).to(device))
        self.variances: Float[Array, " axes"] = variances.cpu().numpy()

    def known_columns(self) -> Float[Array, "entries columns"]:
        """Weighted columns of what has a known size: the start's error, the reruns, errors of given records."""
        _, _, reruns, start_sensitivity, given, _, error = self._parts
        parts = [error.reruns * self.rows(reruns), self.rows(given), self.sensor.start_errors(start_sensitivity)]
        return self.sensor.weighted(np.concatenate(parts, axis=1)).astype(np.float32)

    def field_columns(self, error: ModelError) -> Float[Array, "entries columns"]:
        """Weighted columns of the smooth field of the model's error."""
        points0, motion, reruns, _, _, fps, _ = self._parts
        return self.sensor.weighted(_smooth_field(self.valid, points0, motion, reruns, fps, error)).astype(np.float32)

    def rows(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """The valid entries of fields over at least these frames, one column per field."""
        return self.sensor.rows(fields)

    def whiten(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """Fields [m] as columns, in units in which residuals of a correct model are independent with variance one."""
        return self.from_weighted(self.sensor.weighted(self.rows(fields)))

    def from_weighted(self, weighted: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """The inverse of `weighted`."""
        return self._scaled(weighted, 1.0 / np.sqrt(1.0 + self.variances))

    def weighted(self, whitened: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """Whitened columns in units of the sensor's noise alone."""
        return self._scaled(whitened, np.sqrt(1.0 + self.variances))

    def _scaled(self, columns: Float[Array, "entries columns"], factors: Array) -> Float[Array, "entries columns"]:
        """Columns with what lies along each principal axis multiplied by a factor."""
        more, axes = (factors - 1.0).astype(np.float32)[:, None], self._basis
        if axes.is_cpu:  # a few columns take NumPy's product a third of the time that they take torch's
            axes = axes.numpy()
            return columns + axes @ (more * (axes.T @ columns.astype(np.float32)))
        along = axes @ (torch.from_numpy(more).to(axes) * (axes.T @ torch.from_numpy(columns).to(axes)))
        return columns + along.double().cpu().numpy()

    def log_density(self, residual: Float[Array, "frames tracks 3"]) -> float:
        """Log density of a residual [m] [nat], up to a constant of the number of entries."""
        left = self.whiten(residual[None])[:, 0]
        return -0.5 * float(left @ left) - 0.5 * float(np.log1p(self.variances).sum()) - self.sensor.log_size

    def modes(self) -> Float[Array, "modes entries 3"]:
        """The columns of U in their principal axes [m], one standard deviation long each, at the valid entries."""
        columns = self.sensor.metres(self._basis.cpu().numpy() * np.sqrt(self.variances))
        return columns.T.reshape(len(self.variances), -1, 3)


def _smooth_field(valid, points0, motion, reruns, fps: float, error: ModelError) -> Float[Array, "entries columns"]:
    """Columns of a field that is smooth in space and time, of the size of the model's error at each entry [m]."""
    frames, tracks = valid.shape
    extent = float(np.linalg.norm(np.ptp(points0, axis=0)))
    space = _leading(points0, error.length * extent)
    time = _leading(np.arange(frames)[:, None] / fps, error.time)
    travelled = np.linalg.norm(motion[:frames] - motion[0], axis=-1)
    local = np.sqrt((reruns[:, :frames] ** 2).sum((0, -1)) / 3.0) if len(reruns) else np.zeros((frames, tracks))
    size = np.hypot(error.rms * (0.05 + np.tanh(travelled / error.moved)), error.relative * local)[valid]
    frame, track = np.nonzero(valid)
    field = (size[:, None, None] * time[frame][:, :, None] * space[track][:, None, :]).reshape(len(frame), -1)
    rows = np.zeros((len(frame), 3, 3, field.shape[1]), dtype=np.float32)
    for axis in range(3):
        rows[:, axis, axis] = field
    return rows.reshape(3 * len(frame), -1)


def principal_axes(
    columns: Float[Tensor, "entries columns"],
) -> tuple[Float[Tensor, "entries axes"], Float[Tensor, " axes"]]:
    """Axes of a sum of outer products of columns, and the variances along them."""
    values, vectors = torch.linalg.eigh((columns.T @ columns).double())
    kept = values > 1e-6 * values[-1].clamp_min(1e-30)
    return columns @ (vectors[:, kept] / values[kept].sqrt()).float(), values[kept]


def _leading(places: Float[Array, "places axes"], length: float) -> Float[Array, "places modes"]:
    """Leading eigenvectors of a squared-exponential kernel of unit size, times the roots of their eigenvalues."""
    squared = ((places[:, None] - places[None]) ** 2).sum(-1)
    # a single place has no extent, and so no length to divide by
    apart = np.divide(squared, length**2, out=squared, where=squared > 0)
    values, vectors = np.linalg.eigh(np.exp(-0.5 * apart))
    order = np.argsort(values)[::-1]
    share = np.cumsum(values[order]) / values.sum()
    count = int(np.searchsorted(share, KEPT)) + 1
    chosen = order[:count]
    return vectors[:, chosen] * np.sqrt(np.maximum(values[chosen], 0.0))
