"""Model-predictive control: a plan is begun, looked at after some frames, and made anew from there."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.planning.planner import Plan, Planner


@runtime_checkable
class Executor(Protocol):
    """What does what is planned: a robot, another simulator, or a model."""

    def advance(self, controllers: Float[Tensor, "frames controllers 3"]) -> Float[Array, "frames points 3"]:
        """Move the hand on over some frames.

        Args:
            controllers: controller points [m]: where they are now, at the coming frame times, and one frame after the last of them, which
                says how the hand goes on.

        Returns:
            Where the followed points were seen at these frame times, the present one left out [m]; not a number where they were not
            seen.
        """
        ...


@dataclass(frozen=True)
class Execution:
    """What came of it.

    Attributes:
        plans: one after another; the first was made in frame 0.
        begun: the frame in which each was.
        moved: how far each grasp has moved since frame 0 [m].
        seen: where the followed points were seen [m]; in frame 0 where they were given.
        planned: where the plan that was followed at the time had them [m].
    """

    plans: tuple[Plan, ...]
    begun: tuple[int, ...]
    moved: Float[Array, "frames grasps 3"]
    seen: Float[Array, "frames points 3"]
    planned: Float[Array, "frames points 3"]

    @property
    def replans(self) -> int:
        """How often a plan was made anew."""
        return len(self.plans) - 1

    @property
    def seconds(self) -> float:
        """That planning took."""
        return sum(plan.seconds for plan in self.plans)

    @property
    def apart(self) -> Float[Array, " frames"]:
        """Mean distance of where the points were seen from where the plan had them [m]."""
        return np.nanmean(np.linalg.norm(self.seen - self.planned, axis=2), axis=1)


def execute(planner: Planner, executor: Executor, every: int | None = None, first: Plan | None = None) -> Execution:
    """Plan, go on for `every` frames, look, plan anew; to the end of the planner's frames.

    Args:
        planner: makes the plans.
        executor: follows them.
        every: frames between plans; None: the first plan is followed to its end. With less time to move than from knot to knot no further
            plan is made.
        first: plan, where it is made already.

    Raises:
        InputError: as of `Planner.plan`.
    """
    config = planner.config
    plans, begun = [first or planner.plan()], [0]
    moved = plans[0].moved[:1]
    seen = [planner.forecast.points0[None]]
    planned = [plans[0].points[:1]]
    while (frame := len(moved) - 1) < config.frames:
        if every and frame and config.frames - config.rest - frame >= config.spacing:  # there is time to move yet
            plans.append(planner.plan(moved, plans[-1].moved, np.concatenate(seen)))
            begun.append(frame)
        until = min(frame + every, config.frames) if every else config.frames
        plan = plans[-1]
        ahead = plan.controllers[frame : until + 2]
        if len(ahead) < until + 2 - frame:
            ahead = torch.cat([ahead, ahead[-1:]])
        seen.append(executor.advance(ahead))
        planned.append(plan.points[frame + 1 : until + 1])
        moved = plan.moved[: until + 1]
    return Execution(tuple(plans), tuple(begun), moved, np.concatenate(seen), np.concatenate(planned))
