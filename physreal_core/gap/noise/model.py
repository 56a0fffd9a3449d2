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

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.noise.axes import Axes
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
        known: axes of what has a known size beside it, in units of the sensor's noise.
        field: those of the model's error at size one, in units of all that has a known size.
        size: of the model's error, as a factor on `error`.
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
        self.size = 1.0
        # Of hundreds of megabytes, and sooner made again than read: no checkpoint.
        self.known = Axes(self.known_columns(), device)
        self.field = Axes(self.known.stretched(self.field_columns(), 1.0 / self._known_spread), device)

    def beside(self, size: float) -> Noise:
        """The same beside a model's error of another size; axes do not depend on it."""
        other = copy(self)
        other.size = size
        return other

    @property
    def variances(self) -> Float[Array, " axes"]:
        """Along the axes of what has a known size, and of the model's error."""
        return np.concatenate([self.known.variances, self.size**2 * self.field.variances])

    @property
    def _known_spread(self) -> Float[Array, " axes"]:
        return np.sqrt(1.0 + self.known.variances)

    @property
    def _field_spread(self) -> Float[Array, " axes"]:
        return np.sqrt(1.0 + self.size**2 * self.field.variances)

    def known_columns(self) -> Float[Array, "entries columns"]:
        """Weighted columns of what has a known size: the start's error, the reruns, errors of given records."""
        _, _, reruns, start_sensitivity, given, _, error = self._parts
        parts = [error.reruns * self.rows(reruns), self.rows(given), self.sensor.start_errors(start_sensitivity)]
        return self.sensor.weighted(np.concatenate(parts, axis=1)).astype(np.float32)

    def field_columns(self) -> Float[Array, "entries columns"]:
        """Weighted columns of the smooth field of the model's error, at size one."""
        points0, motion, reruns, _, _, fps, error = self._parts
        return self.sensor.weighted(_smooth_field(self.valid, points0, motion, reruns, fps, error)).astype(np.float32)

    def rows(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """The valid entries of fields over at least these frames, one column per field."""
        return self.sensor.rows(fields)

    def whiten(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """Fields [m] as columns, in units in which residuals of a correct model are independent with variance one."""
        return self.from_weighted(self.sensor.weighted(self.rows(fields)))

    def from_weighted(self, weighted: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """The inverse of `weighted`."""
        return self.field.stretched(self.known.stretched(weighted, 1.0 / self._known_spread), 1.0 / self._field_spread)

    def weighted(self, whitened: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """Whitened columns in units of the sensor's noise alone."""
        return self.known.stretched(self.beside_known(whitened), self._known_spread)

    def beside_known(self, whitened: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """Whitened columns in units of all that has a known size."""
        return self.field.stretched(whitened, self._field_spread)

    def log_density(self, residual: Float[Array, "frames tracks 3"]) -> float:
        """Log density of a residual [m] [nat], up to a constant of the number of entries."""
        left = self.whiten(residual[None])[:, 0]
        return -0.5 * float(left @ left) - 0.5 * float(np.log1p(self.variances).sum()) - self.sensor.log_size

    def modes(self) -> Float[Array, "modes entries 3"]:
        """Columns of U along its axes [m], one standard deviation long each, at the valid entries."""
        field = self.size * self.known.stretched(self.field.deviations, self._known_spread)
        columns = self.sensor.metres(np.concatenate([self.known.deviations, field], axis=1))
        return columns.T.reshape(columns.shape[1], -1, 3)


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
