"""Where points of the body come to be under ways of the hand, by one model or several, in batches of rollouts."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Fields, Rollouts
from physreal_core.fitting.thin import bind_to_body
from physreal_core.rendering import carry_points

LARGEST = 2**27
"""Numbers that the states of the rollouts of one batch may have; more rollouts follow in turn."""

_STATE = 15
"""Numbers of a particle's state: place, velocity, deformation."""


@dataclass(frozen=True)
class Seen:
    """What a forecast says of some ways.

    Attributes:
        points: [m]; not a number where a rollout could not go on.
        failed: whether it could not.
    """

    points: Float[Tensor, "ways models frames points 3"]
    failed: Bool[Tensor, "ways models"]


class Forecast:
    """Rollouts of one problem under several models that differ in their fields, and material points in them.

    An effect of the model on the recorded hand has nothing to act on here, as in `Rollouts.play`.

    Args:
        problem: the body and its holds; the recorded path of the hand is not read beyond frame 0.
        model: fitted; says laws, effects and numerical settings.
        members: fields of each model, as of `Model.fields`; by default those of `model` alone.
        points0: material points in frame 0 [m].
        device: of the simulator.

    Attributes:
        rollouts: of the problem.
        members, points0: as given.
        count: rollouts so far.

    Raises:
        InputError: as of `Rollouts`, or without a model.
    """

    def __init__(
        self,
        problem: Problem,
        model: Model,
        points0: Float[Array, "points 3"],
        members: Sequence[Fields] | None = None,
        device: str = "cpu",
    ) -> None:
        self.rollouts = Rollouts(problem, model, device=device)
        self.members = tuple(members) if members is not None else (model.fields,)
        if not self.members:
            raise InputError("no model", where="Forecast", expected="one at least")
        body = self.rollouts.problem.body
        self.points0 = np.asarray(points0, float)
        self._points0 = torch.as_tensor(self.points0, device=device).to(self.rollouts.dtype)
        self._x0 = torch.as_tensor(body.x0, device=device).to(self.rollouts.dtype)
        self._binding = bind_to_body(points0, body).to(device)
        with torch.no_grad():
            self._inputs = [self.rollouts.inputs(fields) for fields in self.members]
        self.count = 0

    @property
    def fps(self) -> float:
        """Frames per second."""
        return float(self.rollouts.problem.fps)

    def __call__(self, controllers: Float[Tensor, "ways frames controllers 3"], last: int | None = None) -> Seen:
        """Where the points are in the last frames of each way; differentiable by the controller points.

        Args:
            controllers: controller points [m] at frame times from frame 0 on.
            last: number of frames; all by default.
        """
        asked = [(way, member) for way in range(len(controllers)) for member in range(len(self.members))]
        size = _STATE * controllers.shape[1] * len(self._x0)
        at_once = max(1, LARGEST // size)
        parts = [self._carried(controllers, asked[i : i + at_once], last) for i in range(0, len(asked), at_once)]
        points, failed = (torch.cat(column) for column in zip(*parts, strict=True))
        shape = len(controllers), len(self.members)
        return Seen(points.reshape(*shape, *points.shape[1:]), failed.reshape(shape))

    def _carried(self, controllers: Tensor, asked: list[tuple[int, int]], last: int | None) -> tuple[Tensor, Tensor]:
        points = controllers.to(self.rollouts.device, self.rollouts.dtype)
        inputs = [dataclasses.replace(self._inputs[member], controllers=points[way]) for way, member in asked]
        states = self.rollouts.simulate_batch(inputs, controllers.shape[1])
        self.count += len(asked)
        x, F = (value if last is None else value[:, -last:] for value in (states.x, states.F))
        failed = torch.tensor([failure is not None for failure in states.failures], device=x.device)
        return carry_points(self._binding, self._points0, self._x0, x, F), failed
