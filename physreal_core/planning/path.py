"""The way of the hand: knots of a clamped cubic B-spline, from which controller points follow, within bounds on place and speed.

A B-spline lies in the convex hull of its knots, and its velocity in that of their differences over their spacing (de Boor, A Practical
Guide to Splines, ch. IX to XI). So both bounds hold at all times, not at frame times alone, where they hold for the knots.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from scipy.interpolate import BSpline
from torch import Tensor

from physreal_core.array_types import Array, Float, Int
from physreal_core.errors import InputError

DEGREE = 3

_GIVEN = 2
"""Knots that follow from where the hand is and how fast it moves there."""


@dataclass(frozen=True)
class Bounds:
    """Where a hand may be and how fast it may move.

    Args:
        lower, upper: corners of the box in which the centre of each grasp's points stays [m], world frame.
        speed: largest [m/s].
    """

    lower: tuple[float, float, float]
    upper: tuple[float, float, float]
    speed: float

    def __post_init__(self) -> None:
        if not (np.isfinite([*self.lower, *self.upper]).all() and np.less(self.lower, self.upper).all()):
            raise InputError(
                f"a box from {self.lower} to {self.upper}",
                where="bounds of the hand",
                expected="finite corners, the lower below the upper [m]",
            )
        if not 0 < self.speed < np.inf:
            raise InputError(f"a speed of {self.speed}", where="bounds of the hand", expected="a positive one [m/s]")


@dataclass(frozen=True)
class Grasps:
    """Controller points that move as one, without a turn.

    Args:
        points0: controller points in frame 0 [m].
        group: number from 0 of the grasp that each belongs to.
    """

    points0: Float[Tensor, "points 3"]
    group: Int[Tensor, " points"]

    @property
    def count(self) -> int:
        """Number of grasps."""
        return int(self.group.max()) + 1

    @property
    def centres(self) -> Float[Array, "grasps 3"]:
        """Of the points of each in frame 0 [m]."""
        points, group = self.points0.cpu().double().numpy(), self.group.cpu().numpy()
        return np.stack([points[group == number].mean(0) for number in range(self.count)])

    def controllers(self, moved: Float[Tensor, "*ways frames grasps 3"]) -> Float[Tensor, "*ways frames points 3"]:
        """Controller points [m] where each grasp has moved by so much since frame 0 [m]; differentiable."""
        points0, group = self.points0.to(moved), self.group.to(moved.device)
        return points0 + moved[..., group, :]


@dataclass(frozen=True)
class Way:
    """Ways of some grasps from one place to rest, as functions of their knots.

    Args:
        start: how far each grasp has moved since frame 0 where the way begins [m].
        velocity: there [m/s].
        frames: from the beginning to the end.
        knots: free ones; the last is where the way ends.
        lower, upper: of how far each may have moved [m].
        speed: largest [m/s].
        fps: frames per second.
    """

    start: Float[Array, "grasps 3"]
    velocity: Float[Array, "grasps 3"]
    frames: int
    knots: int
    lower: Float[Array, "grasps 3"]
    upper: Float[Array, "grasps 3"]
    speed: float
    fps: float

    def __post_init__(self) -> None:
        if self.frames < 1 or self.knots < 1:
            raise InputError(
                f"{self.knots} knots over {self.frames} frames", where="Way", expected="at least one of either"
            )

    @classmethod
    def within(
        cls,
        bounds: Bounds,
        grasps: Grasps,
        fps: float,
        moved: Float[Array, "done grasps 3"],
        frames: int,
        knots: int,
    ) -> Way:
        """The ways that go on from a way that is done [m]; its last two frames say how fast."""
        velocity = fps * (moved[-1] - moved[-2]) if len(moved) > 1 else np.zeros_like(moved[-1])
        lower, upper = (np.asarray(corner) - grasps.centres for corner in (bounds.lower, bounds.upper))
        return cls(moved[-1], velocity, frames, knots, lower, upper, bounds.speed, fps)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Of the free knots: knots, grasps, 3."""
        return self.knots, len(self.start), 3

    def feasible(self, knots: Float[Tensor, "*ways knots grasps 3"]) -> Float[Tensor, "*ways knots grasps 3"]:
        """The knots drawn into the bounds one after another, each towards the one before it; differentiable almost everywhere."""
        return self._all(knots)[..., _GIVEN:-1, :, :]

    def moved(self, knots: Float[Tensor, "*ways knots grasps 3"]) -> Float[Tensor, "*ways frames grasps 3"]:
        """How far each grasp has moved since frame 0 [m] at the frames + 1 frame times; the first is `start`. Differentiable."""
        basis = torch.from_numpy(self._basis).to(knots)
        return torch.einsum("tk,...kgc->...tgc", basis, self._all(knots))

    def nearest(self, moved: Float[Array, "frames grasps 3"]) -> Float[Tensor, "knots grasps 3"]:
        """Knots of the way nearest to another one [m] with as many frames, by least squares."""
        given, free = self._basis[:, :_GIVEN], self._basis[:, _GIVEN:-1].copy()
        free[:, -1] += self._basis[:, -1]  # the last knot stands twice, so that the way ends at rest
        left = (moved - np.einsum("tk,kgc->tgc", given, self._given.numpy())).reshape(len(moved), -1)
        found = np.linalg.lstsq(free, left, rcond=None)[0].reshape(self.shape)
        return self.feasible(torch.from_numpy(found))

    def from_modes(self, modes: Float[Tensor, "*ways knots grasps 3"]) -> Float[Tensor, "*ways knots grasps 3"]:
        """Sizes of the modes [m] to how far they take the knots [m].

        The first goes straight to the way's end. The others are its detours, sines that vanish at both ends, each smaller by its number, as in the
        Karhunen-Loeve expansion of a Brownian bridge. So modes that are drawn alike are a way that goes somewhere.
        """
        return torch.einsum("km,...mgc->...kgc", torch.from_numpy(self._modes).to(modes), modes)

    def to_modes(self, knots: Float[Tensor, "*ways knots grasps 3"]) -> Float[Tensor, "*ways knots grasps 3"]:
        """The inverse of `from_modes`."""
        return torch.einsum("mk,...kgc->...mgc", torch.from_numpy(np.linalg.inv(self._modes)).to(knots), knots)

    def straight(self, by: Float[Array, "grasps 3"]) -> Float[Tensor, "knots grasps 3"]:
        """Knots of the way that goes straight by so much [m], as far as the bounds let it."""
        share = np.arange(1.0, self.knots + 1)[:, None, None] / self.knots
        return self.feasible(torch.from_numpy(self.start + share * by))

    @cached_property
    def _modes(self) -> Float[Array, "knots modes"]:
        share = np.arange(1, self.knots + 1)[:, None] / self.knots
        number = np.arange(1, self.knots)
        return np.concatenate([share, np.sin(np.pi * share * number) / number], 1)

    @cached_property
    def _breaks(self) -> Float[Array, " breaks"]:
        """The spline's own knots, its parameter values, in frames."""
        count = _GIVEN + self.knots + 1
        inner = np.linspace(0.0, self.frames, count - DEGREE + 1)
        return np.concatenate([np.zeros(DEGREE), inner, np.full(DEGREE, float(self.frames))])

    @cached_property
    def _basis(self) -> Float[Array, "frames knots"]:
        times = np.arange(self.frames + 1.0)
        return BSpline.design_matrix(times, self._breaks, DEGREE).toarray()

    @cached_property
    def _reach(self) -> Float[Array, " steps"]:
        """How far each knot may be from the one before it [m]."""
        t, steps = self._breaks, _GIVEN + self.knots
        spans = np.array([t[i + DEGREE + 1] - t[i + 1] for i in range(steps)])
        return self.speed / self.fps * spans / DEGREE

    @cached_property
    def _given(self) -> Float[Tensor, "given grasps 3"]:
        """The first knots: the place, and what goes on at the velocity that the hand has there."""
        start = np.clip(self.start, self.lower, self.upper)
        share = self._reach[0] / self.speed * self.velocity
        length = np.linalg.norm(share, axis=-1, keepdims=True)
        share = share * np.minimum(1.0, self._reach[0] / np.maximum(length, 1e-300))
        return torch.from_numpy(np.stack([start, np.clip(start + share, self.lower, self.upper)]))

    def _all(self, knots: Tensor) -> Tensor:
        """Given, free and last knots, all within the bounds."""
        lower, upper = (torch.from_numpy(corner).to(knots) for corner in (self.lower, self.upper))
        given = self._given.to(knots).expand(*knots.shape[:-3], -1, -1, -1)
        rows = list(given.unbind(-3))
        for knot, reach in zip(knots.unbind(-3), self._reach[1:-1], strict=True):
            way = knot.clamp(lower, upper) - rows[-1]
            length = way.norm(dim=-1, keepdim=True).clamp_min(1e-12)
            rows.append(rows[-1] + way * (float(reach) / length).clamp_max(1.0))
        return torch.stack([*rows, rows[-1]], -3)
