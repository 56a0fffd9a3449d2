"""The noise model: how far residuals may be from zero without a missing effect.

The covariance of the stacked residuals is N + U U^T. N is the sensor's noise, independent from entry to entry. The
columns of U are

- the sensor's error in frame 0, which each track carries along, because there it is tied to the object;
- the differences between the model and its reruns in other discretisations;
- a field that is smooth in space and time, for model error that the reruns do not reach (Kennedy and O'Hagan 2001,
  "Bayesian calibration of computer models").

Without U, thousands of entries would average the sensor noise away, and every capture would seem to have a missing
effect.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.stats import chi2

from physreal_core.array_types import Array, Bool, Float
from physreal_core.checkpoints import remembered


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


KEPT = 0.995
"""Share of a kernel's trace that its leading eigenvectors must cover."""

TESTED = 0.3
"""Variance of a mode, in units of the sensor's, from which on it takes part in the global test."""


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
    ) -> None:
        self.valid, self.frames = valid, len(valid)
        self._scale = 1.0 / np.repeat(sigma[valid], 3)
        found = remembered(
            "noise",
            lambda: [sigma, valid, motion, reruns, start_sensitivity],
            {"basis": (len(self._scale), None), "values": (None,)},
            lambda: self._modes(sigma, points0, motion, reruns, start_sensitivity, fps, error, device),
        )
        self._basis, self._values = torch.from_numpy(found["basis"]).to(device), found["values"]

    def _modes(self, sigma, points0, motion, reruns, start_sensitivity, fps, error, device) -> dict[str, Array]:
        """Principal axes of the weighted columns of U, shape [n, K], and the variances along them, shape [K]."""
        valid = self.valid
        parts = [error.reruns * self.rows(reruns), _smooth_field(valid, points0, motion, reruns, fps, error)]
        columns = np.concatenate([*parts, _start_errors(valid, sigma, self.rows(start_sensitivity))], axis=1)
        weighted = torch.from_numpy((columns * self._scale[:, None]).astype(np.float32)).to(device)
        values, vectors = torch.linalg.eigh((weighted.T @ weighted).double())
        kept = values > 1e-6 * values[-1].clamp_min(1e-30)
        basis = weighted @ (vectors[:, kept] / values[kept].sqrt()).float()
        return {"basis": basis.cpu().numpy(), "values": values[kept].cpu().numpy()}

    def rows(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """The valid entries of fields over at least these frames, one column per field."""
        return fields[:, : self.frames][:, self.valid].reshape(len(fields), 3 * int(self.valid.sum())).T

    def whiten(self, fields: Float[Array, "columns frames tracks 3"]) -> Float[Array, "entries columns"]:
        """Fields [m] as columns, in units in which residuals of a correct model are independent with variance one."""
        weighted = self.rows(fields) * self._scale[:, None]
        shrink = torch.from_numpy(1.0 - 1.0 / np.sqrt(1.0 + self._values)).to(self._basis)
        given = torch.from_numpy(weighted).to(self._basis)
        imitated = self._basis @ (shrink[:, None] * (self._basis.T @ given))
        return weighted - imitated.double().cpu().numpy()

    def modes(self) -> Float[Array, "modes entries 3"]:
        """The columns of U in their principal axes [m], one standard deviation long each, at the valid entries."""
        columns = self._basis.cpu().numpy() * np.sqrt(self._values) / self._scale[:, None]
        return columns.T.reshape(len(self._values), -1, 3)

    def global_test(self, residual: Float[Array, "frames tracks 3"], freedom: int) -> dict[str, float]:
        """Test whether the smooth part of a residual is larger than noise and model error allow.

        The projection on a mode has a variance of one plus its eigenvalue. The sum of the squares in those units is
        chi-square distributed, with one degree of freedom per mode, less those that the baseline has fitted. Modes that
        the sensor drowns are left out, since they would only dilute the test.

        Args:
            residual: [m], shape [T, J, 3].
            freedom: degrees of freedom that have been fitted.

        Returns:
            `statistic`, `degrees`, `p_value`.
        """
        weighted = self.rows(residual[None])[:, 0] * self._scale
        tested = self._values > TESTED
        along = self._basis.cpu().numpy()[:, tested].T.astype(np.float64) @ weighted
        statistic = float((along**2 / (1.0 + self._values[tested])).sum())
        degrees = max(int(tested.sum()) - freedom, 1)
        return {"statistic": statistic, "degrees": float(degrees), "p_value": float(chi2.sf(statistic, degrees))}


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


def _start_errors(valid, sigma, sensitivity: Float[Array, "entries 3"]) -> Float[Array, "entries columns"]:
    """Columns of the sensor's error in frame 0 [m], three a track, as large as it is in the track's median frame."""
    track = np.repeat(np.nonzero(valid)[1], 3)
    seen = np.unique(track)
    typical = np.array([np.median(sigma[valid[:, j], j]) for j in seen])
    columns = np.zeros((len(track), len(seen), 3), dtype=np.float32)
    place = np.searchsorted(seen, track)
    columns[np.arange(len(track)), place] = sensitivity * typical[place][:, None]
    return columns.reshape(len(track), -1)


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
