"""How the measurement of one interaction departs from its simulation, and the force per mass that would explain it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.lead.force_library import RegionMotion, region_motion
from physreal_core.gap.lead.responses import Responses

Whiten = Callable[[Float[Array, "C T J 3"]], Float[Array, "entries C"]]


@dataclass(frozen=True)
class Departure:
    """One interaction.

    Args:
        simulated, measured: tracks [m], shape [T, J, 3].
        valid: entries with a measurement, shape [T, J].
        fps: frames per second.
        responses: of the tracks to forces on regions of the body.
        weights: share of each region in every track, shape [J, R].
        train, held_out: map displacements of the tracks over all frames [m] to whitened entries of the training and of
            the held-out frames.
    """

    simulated: Float[Array, "T J 3"]
    measured: Float[Array, "T J 3"]
    valid: Bool[Array, "T J"]
    fps: float
    responses: Responses
    weights: Float[Array, "J R"]
    train: Whiten
    held_out: Whiten

    @property
    def displacement(self) -> Float[Array, "1 T J 3"]:
        """Measured - simulated [m], zero where nothing was measured."""
        return np.where(self.valid[..., None], self.measured - self.simulated, 0.0)[None]

    def motion(self) -> RegionMotion:
        """Motion of the regions, as measured."""
        return region_motion(self.simulated, self.measured, self.valid, self.weights, self.fps)


@dataclass(frozen=True)
class ForceField:
    """A force per mass, constant in each region and stretch of time, with the region's position, velocity and swelling.

    Args:
        frames: middle of each stretch, shape [K].
        acceleration, deviation: mean and standard deviation of the force per mass [m/s2], shape [K, R, 3].
        position: of the regions [m], shape [K, R, 3].
        velocity: of the regions [m/s], shape [K, R, 3].
        swelling: relative change of their volume [1], shape [K, R].
        explained: share of the training disagreement that the field explains.
    """

    frames: Float[Array, " K"]
    acceleration: Float[Array, "K R 3"]
    deviation: Float[Array, "K R 3"]
    position: Float[Array, "K R 3"]
    velocity: Float[Array, "K R 3"]
    swelling: Float[Array, "K R"]
    explained: float


def force_field(departure: Departure, stretch: float = 0.2) -> ForceField:
    """The force per mass that would explain a departure, without a formula.

    It is found by least squares with a Gaussian prior, whose width the data choose (evidence maximisation, MacKay
    1992).

    Args:
        departure: of one interaction.
        stretch: time over which the field is constant [s].
    """
    frames, regions = len(departure.simulated), departure.weights.shape[1]
    length = max(1, round(stretch * departure.fps))
    starts = np.arange(0, frames, length)
    among = (np.arange(frames)[None] >= starts[:, None]) & (np.arange(frames)[None] < starts[:, None] + length)
    pushes = np.einsum("kt,rs,ac->kratsc", among.astype(float), np.eye(regions), np.eye(3))
    columns = departure.train(departure.responses.displacement(pushes.reshape(-1, frames, regions, 3)))
    target = departure.train(departure.displacement)[:, 0]
    mean, deviation = _ridge(columns, target)
    motion, middle = departure.motion(), (starts + np.minimum(starts + length, frames) - 1) / 2.0
    shape, at = (len(starts), regions, 3), middle.astype(int)
    return ForceField(
        middle, mean.reshape(shape), deviation.reshape(shape),
        motion.position[at], motion.velocity[at], motion.swelling[at],
        explained_share(target, target - columns @ mean),
    )  # fmt: skip


def explained_share(target: Float[Array, " n"], left: Float[Array, " n"]) -> float:
    """Share of the square of `target` beyond its noise (of variance one) that is not in `left`."""
    total = float(target @ target)
    excess = total - len(target)
    return float(np.clip((total - float(left @ left)) / excess, 0.0, 1.0)) if excess > 0 else 0.0


def _ridge(columns: Float[Array, "n C"], target: Float[Array, " n"]) -> tuple[Float[Array, " C"], Float[Array, " C"]]:
    """Posterior mean and standard deviation of coefficients of mean zero and one common variance.

    The noise has a variance of one, or more where the responses are no exact model.
    """
    values, vectors = np.linalg.eigh(columns.T @ columns)
    values = np.maximum(values, 0.0)
    along = vectors.T @ (columns.T @ target)

    def noise(ratio: float) -> float:
        return max(1.0, float(target @ target - (ratio * along**2 / (1.0 + ratio * values)).sum()) / len(target))

    def minus_log_evidence(ratio: float) -> float:
        left = float(target @ target - (ratio * along**2 / (1.0 + ratio * values)).sum())
        return len(target) * np.log(noise(ratio)) + left / noise(ratio) + float(np.log1p(ratio * values).sum())

    ratio = min(np.logspace(-8, 4, 61), key=minus_log_evidence)
    covariance = vectors / (values + 1.0 / ratio)
    return covariance @ along, np.sqrt(noise(ratio) * (covariance * vectors).sum(1))
