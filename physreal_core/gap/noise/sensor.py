"""The sensor's noise: how large it is along each of its axes, and how far it hangs on from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float


@dataclass(frozen=True)
class Sensor:
    """What is known of a sensor's noise, which is independent from track to track and from axis to axis.

    Args:
        sigma: standard deviation along each axis [m], shape [T, J, 3].
        correlation: along each axis, from one frame to the next, 0 to below 1; shape [3].
        axes: the axes at each entry as the rows of a rotation, shape [T, J, 3, 3], as across and along a camera's line of sight;
            None: those of the world.
    """

    sigma: Float[Array, "frames tracks 3"]
    correlation: Float[Array, " 3"]
    axes: Float[Array, "frames tracks 3 3"] | None = None

    @classmethod
    def alike(cls, sigma: Float[Array, "frames tracks"], correlation: float = 0.0) -> Sensor:
        """One that is as good along all axes."""
        return cls(np.repeat(sigma[..., None], 3, axis=-1), np.full(3, correlation))

    @property
    def size(self) -> Float[Array, "frames tracks"]:
        """Root mean square over the axes [m]."""
        return np.sqrt((self.sigma**2).mean(-1))

    def until(self, frame: int) -> Sensor:
        """The same of the frames before one."""
        return replace(self, sigma=self.sigma[:frame], axes=None if self.axes is None else self.axes[:frame])

    def of(self, tracks: Array) -> Sensor:
        """The same of some tracks."""
        return replace(self, sigma=self.sigma[:, tracks], axes=None if self.axes is None else self.axes[:, tracks])


class SensorNoise:
    """A sensor's noise at the entries that count.

    Along a track it is an autoregressive process of first order whose size is given: c^d is its correlation over d frames.
    It is conditional on the error in frame 0, which the model starts with (`start_errors`).

    Args:
        sensor: over at least the frames of `valid`.
        valid: entries that count, shape [T, J]; none in frame 0.
    """

    def __init__(self, sensor: Sensor, valid: Bool[Array, "frames tracks"]) -> None:
        self.valid, self._correlation = valid, sensor.correlation
        frame, self._track = np.nonzero(valid)
        self._sigma, self._frame = sensor.sigma[: len(valid)][valid], frame
        self._axes = None if sensor.axes is None else sensor.axes[: len(valid)][valid]
        self._first = None if sensor.axes is None else sensor.axes[0]
        previous = _previous(valid)
        gap = (frame - np.where(previous < 0, 0, frame[previous]))[:, None]
        carried = np.where(gap > 0, self._correlation**gap, 0.0)
        self._previous, self._carried = previous, np.where(previous[:, None] < 0, 0.0, carried)
        self._fresh = np.sqrt(1.0 - carried**2)

    @property
    def log_size(self) -> float:
        """Half the logarithm of the determinant of the covariance, over all axes."""
        return float(np.log(self._sigma * self._fresh).sum())

    def rows(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """The valid entries of fields over at least these frames, one column per field."""
        count = 3 * len(self._frame)
        return fields[:, : len(self.valid)][:, self.valid].reshape(len(fields), count).T

    def weighted(self, rows: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """Columns [m] in units in which this noise is independent with variance one."""
        scaled = rows.reshape(len(self._frame), 3, -1)
        if self._axes is not None:
            scaled = self._axes.astype(rows.dtype) @ scaled
        scaled = scaled / self._sigma[:, :, None]
        if self._correlation.any():
            scaled = scaled - self._carried[:, :, None] * scaled[self._previous]
            scaled /= self._fresh[:, :, None]
        return scaled.reshape(rows.shape)

    def metres(self, weighted: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """The inverse of `weighted`."""
        found = weighted.reshape(len(self._frame), 3, -1) * self._fresh[:, :, None]
        if self._correlation.any():
            for rows in _by_frame(self._frame):
                found[rows] += self._carried[rows, :, None] * found[self._previous[rows]]
        found *= self._sigma[:, :, None]
        if self._axes is not None:
            found = np.swapaxes(self._axes, 1, 2) @ found
        return found.reshape(weighted.shape)

    def start_errors(self, sensitivity: Float[Array, "3 frames tracks 3"]) -> Float[Array, "entries columns"]:
        """Columns [m] of the error in frame 0, three a track, as large as the noise is in the track's median frame.

        The body carries it along, and the noise of the following frames hangs on it: S - c^t, S the sensitivity.

        Args:
            sensitivity: S, derivative of the tracks by the points' start along x, y, z.
        """
        own = self.rows(sensitivity).reshape(len(self._frame), 3, 3)  # entry, its x, y, z, those of the start
        hanging = np.eye(3) * self._correlation[:, None] ** self._frame[:, None, None]
        if self._axes is not None:
            own = own @ np.swapaxes(self._first[self._track], 1, 2)
            hanging = np.swapaxes(self._axes, 1, 2) @ hanging
        seen, place = np.unique(self._track, return_inverse=True)
        typical = np.array([np.median(self._sigma[self._track == track], axis=0) for track in seen])
        columns = np.zeros((len(self._frame), 3, len(seen), 3), dtype=np.float32)
        columns[np.arange(len(place)), :, place] = (own - hanging) * typical[place][:, None, :]
        return columns.reshape(3 * len(self._frame), -1)


def _previous(valid: Bool[Array, "frames tracks"]) -> Array:
    """Of each valid entry, the number of the same track's one before; -1 for its first."""
    numbers = np.where(valid, np.cumsum(valid).reshape(valid.shape) - 1, -1)
    last = np.maximum.accumulate(numbers, axis=0)  # numbers grow along a track
    before = np.concatenate([np.full((1, valid.shape[1]), -1), last[:-1]])
    return before[valid]


def _by_frame(frame: Array) -> list[slice]:
    """Slices of the entries of each frame, in order."""
    edges = np.flatnonzero(np.diff(frame)) + 1
    return [slice(a, b) for a, b in zip([0, *edges.tolist()], [*edges.tolist(), len(frame)], strict=True)]
