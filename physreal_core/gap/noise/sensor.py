"""The sensor's noise: of known size, and hanging on from frame to frame as far as the capture itself says."""

from __future__ import annotations

import numpy as np

from physreal_core.array_types import Array, Bool, Float


class SensorNoise:
    """Noise of tracked points, independent from track to track and from axis to axis.

    Along a track it is an autoregressive process of first order whose size is given: c^d is its correlation over d frames.
    It is conditional on the error in frame 0, which the model starts with (`start_errors`).

    Args:
        sigma: standard deviation [m], shape [T, J].
        valid: entries that count, shape [T, J]; none in frame 0.
        correlation: c, from one frame to the next, 0 to below 1.
    """

    def __init__(
        self, sigma: Float[Array, "frames tracks"], valid: Bool[Array, "frames tracks"], correlation: float = 0.0
    ) -> None:
        self.valid, self.correlation = valid, correlation
        frame, self._track = np.nonzero(valid)
        self._sigma, self._frame = sigma[valid], frame
        previous = _previous(valid)
        gap = frame - np.where(previous < 0, 0, frame[previous])
        carried = np.where(gap > 0, float(correlation) ** gap, 0.0)
        self._previous, self._carried = previous, np.where(previous < 0, 0.0, carried)
        self._fresh = np.sqrt(1.0 - carried**2)

    @property
    def log_size(self) -> float:
        """Half the logarithm of the determinant of the covariance, over all axes."""
        return 3.0 * float(np.log(self._sigma * self._fresh).sum())

    def rows(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """The valid entries of fields over at least these frames, one column per field."""
        count = 3 * len(self._frame)
        return fields[:, : len(self.valid)][:, self.valid].reshape(len(fields), count).T

    def weighted(self, rows: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """Columns [m] in units in which this noise is independent with variance one."""
        scaled = rows.reshape(len(self._frame), 3, -1) / self._sigma[:, None, None]
        if self.correlation:
            scaled = scaled - self._carried[:, None, None] * scaled[self._previous]
            scaled /= self._fresh[:, None, None]
        return scaled.reshape(rows.shape)

    def metres(self, weighted: Float[Array, "entries columns"]) -> Float[Array, "entries columns"]:
        """The inverse of `weighted`."""
        found = weighted.reshape(len(self._frame), 3, -1) * self._fresh[:, None, None]
        if self.correlation:
            for rows in _by_frame(self._frame):
                found[rows] += self._carried[rows, None, None] * found[self._previous[rows]]
        return (found * self._sigma[:, None, None]).reshape(weighted.shape)

    def start_errors(self, sensitivity: Float[Array, "3 frames tracks 3"]) -> Float[Array, "entries columns"]:
        """Columns [m] of the error in frame 0, three a track, as large as the noise is in the track's median frame.

        The body carries it along, and the noise of the following frames hangs on it: S - c^t, S the sensitivity.

        Args:
            sensitivity: S, derivative of the tracks by the points' start along x, y, z.
        """
        own = self.rows(sensitivity).reshape(len(self._frame), 3, 3)  # entry, its axis, axis of the start
        hanging = np.eye(3) * float(self.correlation) ** self._frame[:, None, None]
        seen, place = np.unique(self._track, return_inverse=True)
        typical = np.array([np.median(self._sigma[self._track == track]) for track in seen])
        columns = np.zeros((len(self._frame), 3, len(seen), 3), dtype=np.float32)
        columns[np.arange(len(place)), :, place] = (own - hanging) * typical[place][:, None, None]
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
