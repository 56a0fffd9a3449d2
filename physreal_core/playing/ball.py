"""A ball that a user pushes the body with: one more capsule of the tool, whose two ends are one point. Solids stop it."""

from dataclasses import dataclass, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.simulation import Solids, Tool
from physreal_core.simulation.laws.terms_reference import solids

AWAY = np.array([0.0, 0.0, -10.0])
"""Where it is while nobody uses it [m]: it touches nothing there."""

FASTEST = 1.0
"""How fast it follows its target at most [m/s]."""

_PUSHES, _FLAT = 5, 1e-3
"""How often it is pushed out of solids at most, as in a corner, and the slope of the distance that says no direction."""

FIRMNESS, FRICTION = 1e6, 0.5
"""How firmly it pushes [1/s2], and its friction, where the model knows of no tool (`fit_global.tool_stiffness`, `tool_friction`)."""


@dataclass
class Ball:
    """Where it is, where it is wanted, and where it was a frame ago [m]; away while nobody uses it."""

    place: Float[Array, " 3"]
    target: Float[Array, " 3"]
    before: Float[Array, " 3"] | None = None

    @classmethod
    def away(cls) -> "Ball":
        """A ball that nobody uses."""
        return cls(AWAY, AWAY)

    @property
    def used(self) -> bool:
        """Whether it can touch the body."""
        return self.place is not AWAY

    def follow(self, fps: float, radius: float, around: Solids | None) -> None:
        """Bring it towards its target, as far as it may go in a frame and as solids let it.

        Args:
            fps: frames per second.
            radius: its own [m].
            around: solids, or none.
        """
        self.before = self.place
        way = self.target - self.place
        way = way * min(1.0, FASTEST / fps / max(float(np.linalg.norm(way)), 1e-12))
        if around is None:
            self.place = self.place + way
            return
        steps = max(1, int(np.ceil(2.0 * np.linalg.norm(way) / radius)))  # so short that it jumps over no wall
        for _ in range(steps):
            self.place = clear_of(self.place + way / steps, radius, around)


def clear_of(place: Float[Array, " 3"], radius: float, around: Solids) -> Float[Array, " 3"]:
    """A ball's place, or the one near it where it only touches the solids: it is pushed out along the slope of the distance, as far as the
    solids' lattice reaches.

    Args:
        place: of its middle [m].
        radius: of the ball [m].
        around: the solids.
    """
    for _ in range(_PUSHES):
        at = torch.from_numpy(place.copy()).requires_grad_()
        distance = around.at(at)
        if distance >= radius:
            break
        (slope,) = torch.autograd.grad(distance, at)
        steepness = float(slope.norm())
        if steepness < _FLAT:  # halfway between two walls
            break
        place = place + (radius - float(distance)) * slope.numpy() / steepness
    return place


def push_on(
    x: Float[Array, "particles 3"],
    v: Float[Array, "particles 3"],
    mass: Float[Array, " particles"],
    reach: Float[Array, " particles"],
    ball: tuple[Float[Array, " 3"], Float[Array, " 3"], float],
    law: tuple[float, float],
) -> Float[Array, " 3"]:
    """Force of a ball on a body [N] at one time: a tool's law (`simulation/laws/tool.h`) is that of solids with the ball's distance.

    Args:
        x, v, mass, reach: of the particles [m, m/s, kg, m].
        ball: its place [m], velocity [m/s] and radius [m].
        law: stiffness [1/s2] and friction.
    """
    place, velocity, radius = ball
    with torch.enable_grad():
        places = torch.from_numpy(x).requires_grad_()
        distance = (places - torch.from_numpy(place)).norm(dim=-1) - radius
        rest = (torch.from_numpy(values) for values in (v - velocity, mass, reach))
        force = solids(distance, places, *rest, *(torch.tensor(number) for number in law))
    return force.detach().sum(0).numpy()


def with_ball(problem: Problem, model: Model, radius: float) -> tuple[Problem, Model]:
    """A problem with a ball of this radius [m] as its last controller point, and a model that knows how a tool pushes."""
    frames, count = problem.controllers.shape[:2]
    place = torch.as_tensor(AWAY).to(problem.controllers).expand(frames, 1, 3)
    ends, radii, spared = np.array([[count, count]]), np.array([radius]), None
    if problem.tool is not None:
        ends, radii = np.concatenate([problem.tool.ends, ends]), np.append(problem.tool.radius, radius)
        spared = problem.tool.spared
    given = replace(problem, controllers=torch.cat([problem.controllers, place], 1), tool=Tool(ends, radii, spared))
    known = {"tool_stiffness": FIRMNESS, "tool_friction": FRICTION}
    missing = {n: torch.tensor(v, dtype=torch.float64) for n, v in known.items() if n not in model.fields}
    return given, replace(model, fields={**model.fields, **missing})
