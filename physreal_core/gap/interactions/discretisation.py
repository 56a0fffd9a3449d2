"""Other discretisations of one problem, which show the simulator's numerical error, another hold of a hand that was seen, and another far side of
a body that was."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects import Inputs
from physreal_core.errors import InputError
from physreal_core.fitting.grip import reaching
from physreal_core.fitting.problem import Problem
from physreal_core.simulation import Body, Grip, SimulationConfig


@dataclass(frozen=True)
class Discretisation:
    """How a rerun of the same model differs from the first run.

    Args:
        name: what differs, in words.
        cell: factor on the size of a grid cell.
        courant: factor on the time step.
        turn: angle by which body, hand and gravity are turned about the vertical, against the grid [rad].
        elastic_law: another law of the same small-strain stiffness; None for the model's own.
        hold: factor on how far from the hand's points the body is held.
        matter: factor on the matter of what the camera did not see, where that was guessed: in full at the far side, growing with the depth
            behind the seen one.
        error: the first run's error divided by the difference between the two runs (Richardson's extrapolation).
    """

    name: str
    cell: float = 1.0
    courant: float = 1.0
    turn: float = 0.0
    elastic_law: str | None = None
    hold: float = 1.0
    matter: float = 1.0
    error: float = 1.0


UNCHANGED = Discretisation("unchanged")


class DiscretisedProblem:
    """Body and configuration of a problem in one discretisation, and the way to its frame and back.

    Args:
        problem: gives the body.
        config: of the simulator, unchanged.
        discretisation: what differs.

    Attributes:
        body, config: as the simulator takes them.
    """

    def __init__(self, problem: Problem, config: SimulationConfig, discretisation: Discretisation) -> None:
        body, given = problem.body, discretisation
        self._problem, self._hold = problem, given.hold
        c, s = np.cos(given.turn), np.sin(given.turn)
        self._turn = torch.tensor([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float32)
        self._centre = torch.as_tensor(body.x0.mean(0), dtype=torch.float32) * torch.tensor([1.0, 1.0, 0.0])
        self._turns = given.turn != 0.0
        x0 = self._turned(torch.as_tensor(body.x0, dtype=torch.float32)).double().numpy() if self._turns else body.x0
        thin = body.elements is not None
        if thin and (self._turns or given.cell != 1.0):
            raise InputError(
                f"the discretisation {given.name!r} of a thin body", where="DiscretisedProblem", expected="its own mesh"
            )
        volume = body.volume
        if problem.unseen is not None:
            volume = volume * (1.0 + (given.matter - 1.0) * problem.unseen)
        self.body = body if thin else Body(x0, volume, body.density, body.spacing * given.cell, pieces=body.piece)
        gravity = tuple((self._turn.double() @ torch.tensor(config.gravity, dtype=torch.float64)).tolist())
        changed = {
            "courant": config.courant * given.courant,
            "gravity": gravity,
            "elastic_law": given.elastic_law or config.elastic_law,
        }
        self.config = dataclasses.replace(config, **changed)

    @property
    def grip(self) -> Grip | None:
        """As the simulator takes it."""
        problem = self._problem
        if self._hold == 1.0:
            return problem.grip
        hand = problem.controllers[0].numpy().astype(np.float64)
        return reaching(problem.grip, problem.body.x0, hand, self._hold, problem.body.spacing)

    def _turned(self, points: Float[Tensor, "*shape 3"]) -> Float[Tensor, "*shape 3"]:
        turn, centre = self._turn.to(points), self._centre.to(points)
        return (points - centre) @ turn.T + centre

    def inputs(self, inputs: Inputs) -> Inputs:
        """Inputs of the capture's frame, in this discretisation's frame."""
        if not self._turns:
            return inputs
        return dataclasses.replace(inputs, controllers=self._turned(inputs.controllers))

    def states(
        self, x: Float[Tensor, "*shape 3"], F: Float[Tensor, "*shape 3 3"]
    ) -> tuple[Float[Tensor, "*shape 3"], Float[Tensor, "*shape 3 3"]]:
        """States of this discretisation's frame, x [m] and F, in the capture's frame."""
        if not self._turns:
            return x, F
        turn, centre = self._turn.to(x), self._centre.to(x)
        return (x - centre) @ turn + centre, turn.T @ F @ turn
