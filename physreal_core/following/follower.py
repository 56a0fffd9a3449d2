"""A twin that follows a stream, frame by frame.

Each frame, the simulation goes on with the hand's points. How far it is then from what is seen is a smooth field over the body (`SmoothError`). The
twin's state is its simulation plus that field. The simulation itself is drawn along by forces on its particles, as an extended state observer
(Han 2009): with the field d, an acceleration

    a = b + w^2 d + 2 w d',   b' = i w^2 d,

at most `FollowConfig.strongest` in size. The stress of the body stays that of a body on which forces act, and b is what the model lacks: it comes to
rest where the simulation and the measurement agree without further pull.
"""

from dataclasses import dataclass, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts, frame_since_start
from physreal_core.following.alarm import Alarm
from physreal_core.following.sizes import LearntSizes
from physreal_core.following.smooth_error import SmoothError
from physreal_core.following.stream import Followed, Seen
from physreal_core.rendering import carry_points
from physreal_core.simulation.play import FrameState


@dataclass(frozen=True)
class FollowConfig:
    """How a follower follows.

    Attributes:
        smoothness: length over which the forecast's error changes, over the body's diagonal.
        pull: w, how fast the simulation is drawn to what is seen [1/s].
        learning: i, how fast the missing acceleration is learnt [1/s].
        strongest: largest acceleration of a particle [m/s2].
        memory: frames over which the size of the error is known.
        least: size of the forecast's error, however well it fits [m].
        shared: of the stated noise of a camera's points, the share that neighbours have in common, which no average takes away.
        usual: frames from which the usual gap is learnt, for the alarm.
    """

    smoothness: float = 0.25
    pull: float = 12.0
    learning: float = 3.0
    strongest: float = 30.0
    memory: int = 10
    least: float = 2e-4
    shared: float = 0.15
    usual: int = 20


class Follower:
    """A fitted model that follows the points of a problem's tracks.

    Args:
        problem: body, hand in frame 0, and the tracks' material points; their measurements are not read.
        model: fitted.
        config: how it follows.
        device: of the simulator.

    Raises:
        InputError: as of `Rollouts`, or a problem without tracks.
    """

    def __init__(self, problem: Problem, model: Model, config: FollowConfig | None = None, device: str = "cpu") -> None:
        if problem.tracks is None:
            raise InputError("no tracks", where="Follower", expected="a problem with tracked points")
        self.config = config or FollowConfig()
        self._rollouts = Rollouts(problem, model, device=device, terms=("force",))
        own = self._rollouts.problem
        self._tracks, self.fps = own.tracks, float(own.fps)
        self._x0 = torch.as_tensor(own.body.x0, device=device).to(self._rollouts.dtype)
        self._mass = np.asarray(own.body.mass, float)
        points0 = own.tracks.points0.cpu().double().numpy()
        size = float(np.linalg.norm(np.ptp(own.body.x0, axis=0)))
        self._shared = 0.0 if own.camera is None else self.config.shared
        self._error = SmoothError(points0, own.body.x0, self.config.smoothness * size)
        with torch.no_grad():
            self._parameters = self._rollouts.inputs(model.fields).parameters
        self._player = self._rollouts.play(model.fields)
        self._missing = np.zeros_like(own.body.x0)
        self._before: Array | None = None
        self._learnt = LearntSizes(points0, self.config.least, self.config.memory)
        self._alarm = Alarm(self.config.usual)

    def go_on(self, controllers: Float[Array, "controllers 3"]) -> FrameState:
        """The next frame, in which nothing is looked at; F is the motion since frame 0.

        Args:
            controllers: points of the hand there [m].

        Raises:
            SimulationError: as of `Player.step`.
        """
        return frame_since_start(self._player.step(torch.from_numpy(controllers)), self._parameters)

    def step(self, seen: Seen) -> Followed:
        """The next frame.

        Raises:
            SimulationError: as of `Player.step`.
        """
        state = self.go_on(seen.controllers)
        points0 = self._tracks.points0.to(state.x)
        forecast = carry_points(self._tracks.binding, points0, self._x0, state.x, state.F).cpu().double().numpy()
        difference = np.where(seen.valid[:, None], seen.points - forecast, 0.0)
        size, noise = self._learnt.update(difference, seen.valid, seen.sigma)
        found = self._error.analysis(difference, seen.valid, noise * seen.sigma, size)
        stated = float(np.median(seen.sigma[seen.valid])) if seen.valid.any() else 0.0
        gap = float(np.sqrt((self._mass @ (found.at_particles**2).sum(1)) / self._mass.sum()))
        self._draw(found.at_particles)
        return Followed(
            forecast=forecast,
            points=forecast + found.at_points,
            deviation=np.hypot(found.deviation, self._shared * stated),
            x=state.x.cpu().double().numpy() + found.at_particles,
            F=state.F.cpu().double().numpy(),
            acceleration=self._missing.copy(),
            gap=gap,
            alarm=self._alarm.update(gap),
        )

    def _draw(self, error: Float[Array, "particles 3"]) -> None:
        """Give the simulation the forces that draw it along in the next frame."""
        config = self.config
        rate = np.zeros_like(error) if self._before is None else (error - self._before) * self.fps
        self._before = error
        self._missing = self._missing + config.learning * config.pull**2 * error / self.fps
        acceleration = self._missing + config.pull**2 * error + 2.0 * config.pull * rate
        length = np.linalg.norm(acceleration, axis=1, keepdims=True)
        acceleration = acceleration * np.minimum(1.0, config.strongest / np.maximum(length, 1e-12))
        force = torch.as_tensor(self._mass[:, None] * acceleration).to(self._x0)
        known = self._parameters.force
        self._player.change(replace(self._parameters, force=force if known is None else known + force))
