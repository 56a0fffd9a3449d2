"""How far each number of a fitted model may be off: its interval, and which numbers can be exchanged for one another.

The posterior of a few numbers that scale the fitted fields is taken as Gaussian around the fit (Laplace's approximation), with the
Gauss-Newton Hessian of the tracks' residuals by finite differences. What a model gets wrong hangs on from frame to frame, so all frames of
a track together count as one reading, of the size of the residuals that the fit has left. Laws and discretisation are not exact either,
which no residual tells: `LEAST` stands for that.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.losses import carried_tracks
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Fields, Rollouts

PRIOR: Mapping[str, float] = MappingProxyType(
    {
        "youngs_modulus": 0.5,
        "friction_coefficient": 0.5,
        "poissons_ratio": 0.2,
        "bending_ratio": 0.5,
        "grip_stiffness": 1.0,
    }
)
"""Standard deviation of the logarithm of each field's scale before the measurement, for the fields that a model has."""

LEAST = 0.1
"""Standard deviation of each logarithm that no measurement takes away: so far is Young's modulus off where another simulator moves the body
(`python -m benchmarks.modulus`), of which nothing shows in the residuals."""

NINETY = 1.6449
"""Standard deviations on either side of the mean that cover 90 % of a Gaussian."""

STEP = 0.05
"""Of the finite differences, in the logarithm."""

LARGEST_RATIO = 0.45
"""Poisson's ratio that no member exceeds."""


@dataclass(frozen=True)
class Spread:
    """What a fit leaves open.

    Attributes:
        names: of the fields that are scaled.
        covariance: of the logarithms of their scales.
    """

    names: tuple[str, ...]
    covariance: Float[Array, "numbers numbers"]

    @property
    def deviations(self) -> dict[str, float]:
        """Standard deviation of each logarithm."""
        return dict(zip(self.names, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def interval(self, name: str, value: float) -> tuple[float, float]:
        """Of 90 % around a fitted value, in its unit."""
        factor = float(np.exp(NINETY * self.deviations[name]))
        return value / factor, value * factor

    def along(self, name: str) -> Float[Array, "2 numbers"]:
        """Logarithms of all scales at both ends (rows) of the 90 % interval of one, the others where they are expected then."""
        number = self.names.index(name)
        way = self.covariance[number] / np.sqrt(self.covariance[number, number])
        return np.array([-NINETY * way, NINETY * way])

    def correlation(self, one: str, other: str) -> float:
        """Of two logarithms; near -1 a body that is softer in a firmer hold moves alike."""
        a, b = self.names.index(one), self.names.index(other)
        return float(self.covariance[a, b] / np.sqrt(self.covariance[a, a] * self.covariance[b, b]))

    def ends(self, one: str, other: str) -> Float[Array, "2 2"]:
        """Logarithms of two scales at both ends (rows) of the 90 % interval along the way in which they are known least."""
        rows = [self.names.index(name) for name in (one, other)]
        sizes, ways = np.linalg.eigh(self.covariance[np.ix_(rows, rows)])
        reach = NINETY * np.sqrt(sizes[-1]) * ways[:, -1]
        return np.array([-reach, reach])


def tells(problem: Problem) -> bool:
    """Whether there is a track in 3D after frame 0, without which nothing is known of a spread."""
    tracks = problem.tracks
    return tracks is not None and bool(tracks.valid3d[1 : problem.observed].any())


def spread_of(problem: Problem, model: Model, device: str = "cpu") -> Spread:
    """How far each number of a fitted model may be off, by the tracks that it was fitted to.

    Raises:
        InputError: there are no tracks in 3D, or the fitted model cannot be simulated.
    """
    names = tuple(name for name in PRIOR if name in model.fields)
    if not tells(problem):
        raise InputError(
            "no tracks in 3D", where="the interval of a fit", expected="a sequence with depth or motion capture"
        )
    valid = problem.tracks.valid3d[: problem.observed].cpu().clone()
    valid[0] = False  # there the points are where they are measured, whatever the model
    scales = np.concatenate([np.zeros((1, len(names))), STEP * np.eye(len(names)), -STEP * np.eye(len(names))])
    here, *moved = (points[valid] for points in _seen(problem, model, names, scales, device))
    residual = here - problem.tracks.points3d[: problem.observed].cpu().double()[valid]
    slopes = [(up - down) / (2 * STEP) for up, down in zip(moved[: len(names)], moved[len(names) :], strict=True)]
    J = torch.stack(slopes).flatten(1).nan_to_num(0.0).numpy() if names else np.zeros((0, residual.numel()))
    readings = float(valid.any(0).sum()) / float(valid.sum())
    information = readings * (J @ J.T) / max(float(residual.square().mean()), 1e-12)
    prior = np.diag([PRIOR[name] ** -2 for name in names])
    return Spread(names, np.linalg.inv(information + prior) + LEAST**2 * np.eye(len(names)))


def _seen(
    problem: Problem, model: Model, names: tuple[str, ...], scales: Float[Array, "rows numbers"], device: str
) -> list[Float[Tensor, "frames tracks 3"]]:
    """Where the measurement would see the tracks [m] in the observed frames, with fields scaled by each row."""
    rollouts = Rollouts(problem, model, device=device)
    with torch.no_grad():
        frames = rollouts.frames_needed(problem.observed)
        inputs = [rollouts.inputs(scaled(model.fields, names, row), frames=frames) for row in scales]
        batch = rollouts.simulate_batch(inputs, frames)
        if batch.failures[0] is not None:
            raise InputError(str(batch.failures[0]), where="the fitted model", expected="one that can be simulated")
        x0 = torch.as_tensor(problem.body.x0).to(batch.x)
        carried = (carried_tracks(rollouts.problem.tracks, x0, x, F) for x, F in zip(batch.x, batch.F, strict=True))
        return [rollouts.seen(points)[: problem.observed].cpu().double() for points in carried]


def scaled(fields: Fields, names: tuple[str, ...], logarithms: Float[Array, " numbers"]) -> dict[str, Tensor]:
    """Fields with some multiplied by the exponentials of these numbers; Poisson's ratio stays below `LARGEST_RATIO`."""
    changed = {name: fields[name] * float(np.exp(number)) for name, number in zip(names, logarithms, strict=True)}
    if "poissons_ratio" in changed:
        changed["poissons_ratio"] = changed["poissons_ratio"].clamp_max(LARGEST_RATIO)
    return {**fields, **changed}
