"""A follower that learns the material, kept only where it forecasts better than one that does not.

What makes the forecast wrong is not always the material. Where the hold, the shape or an effect is, a learnt modulus makes up for it for a moment and
misleads in the next. So both run side by side.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.errors import SimulationError
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.following.follower import FollowConfig, Follower
from physreal_core.following.stream import Followed, Seen
from physreal_core.simulation.play import FrameState

Result = TypeVar("Result")

BETTER = 0.9
"""Of the other's mean square error, below which the learnt material forecasts better."""


class CarefulFollower:
    """Steps like a `Follower`; its frames are those of the one of two that has been nearer of late.

    Args:
        problem, model, device: as of `Follower`.
        config: with `learns`.

    Attributes:
        material: what is learnt, whether it is in use or not.
        learnt: whether the learnt material is in use now.
    """

    def __init__(self, problem: Problem, model: Model, config: FollowConfig, device: str = "cpu") -> None:
        self._plain = Follower(problem, model, replace(config, learns={}), device)
        self._learning: Follower | None = Follower(problem, model, config, device)
        self.material = self._learning.material
        self._kept = 1.0 - 1.0 / config.memory
        self._errors: Float[Array, " two"] = np.zeros(2)
        self.fps, self.learnt = self._plain.fps, False

    def go_on(self, controllers: Float[Array, "controllers 3"]) -> FrameState:
        """As of `Follower`."""
        plain = self._plain.go_on(controllers)
        found = self._tried(lambda learning: learning.go_on(controllers))
        return found if self.learnt and found is not None else plain

    def step(self, seen: Seen) -> Followed:
        """As of `Follower`."""
        plain = self._plain.step(seen)
        found = self._tried(lambda learning: learning.step(seen))
        if found is None:
            return plain
        if seen.valid.any():
            off = [((own.forecast - seen.points)[seen.valid] ** 2).sum(-1) for own in (plain, found)]
            now = np.array([np.median(squares) for squares in off])
            self._errors = self._kept * self._errors + (1.0 - self._kept) * now
        self.learnt = bool(self._errors[1] < BETTER * self._errors[0])
        return found if self.learnt else plain

    def _tried(self, step: Callable[[Follower], Result]) -> Result | None:
        """What the follower that learns makes of a frame; None, and never again, where its simulation breaks off."""
        if self._learning is None:
            return None
        try:
            return step(self._learning)
        except SimulationError:
            self._learning, self.learnt = None, False
            return None


def follower_of(
    problem: Problem, model: Model, config: FollowConfig | None = None, device: str = "cpu"
) -> Follower | CarefulFollower:
    """The follower that a configuration asks for."""
    config = config or FollowConfig()
    kind = CarefulFollower if config.learns else Follower
    return kind(problem, model, config, device)
