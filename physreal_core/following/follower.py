"""A twin that follows a stream, frame by frame.

Each frame, the simulation goes on with the hand's points. How far it is then from what is seen is a smooth field over the body (`SmoothError`). The
twin's state is its simulation plus that field. The simulation itself is drawn along by forces on its particles, as an extended state observer
(Han 2009): with the field d, an acceleration

    a = b + w^2 d + 2 w d',   b' = i w^2 d,

at most `FollowConfig.strongest` in size. These forces are held from frame to frame, and d' is a difference of two frames, so by themselves they would drive
what swings faster than a sixth of the frame rate. Where the body can be viscous, it is so by `FollowConfig.calm` of the time between frames beside what the
model says: with a tenth no swing grows, whatever its frequency, and what swings slowly hardly feels it. The stress of the body stays that of a body on which
forces act, and b is what the model lacks: it comes to rest where the simulation and the measurement agree without further pull.

Where the material is learnt too (`FollowConfig.learns`), several models run side by side that differ in it (`LearntMaterial`). They are drawn along by the
same accelerations, so that what parts them is their material, and the forecast is their mean.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, lacking
from physreal_core.errors import InputError
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.following.alarm import Alarm
from physreal_core.following.material import LearntMaterial, Update
from physreal_core.following.running import Running, mean_state
from physreal_core.following.sizes import LearntSizes
from physreal_core.following.smooth_error import SmoothError
from physreal_core.following.stream import Followed, Seen
from physreal_core.simulation.play import FrameState


@dataclass(frozen=True)
class FollowConfig:
    """How a follower follows.

    Attributes:
        smoothness: length over which the forecast's error changes, over the body's diagonal.
        pull: w, how fast the simulation is drawn to what is seen [1/s].
        calm: retardation time over the time between frames, of a viscosity beside the model's.
        learning: i, how fast the missing acceleration is learnt [1/s].
        strongest: largest acceleration of a particle [m/s2].
        memory: frames over which the size of the error is known.
        least: size of the forecast's error, however well it fits [m].
        shared: of the stated noise of a camera's points, the share that neighbours have in common, which no average takes away.
        usual: frames from which the usual gap is learnt, for the alarm.
        learns: fields of the model of which a factor is learnt, with the standard deviation of its logarithm at first.
        members: models that run side by side where something is learnt.
    """

    smoothness: float = 0.25
    pull: float = 12.0
    calm: float = 0.1
    learning: float = 3.0
    strongest: float = 30.0
    memory: int = 10
    least: float = 2e-4
    shared: float = 0.15
    usual: int = 20
    learns: Mapping[str, float] = field(default_factory=dict)
    members: int = 6


class Follower:
    """A fitted model that follows the points of a problem's tracks.

    Args:
        problem: body, hand in frame 0, and the tracks' material points; their measurements are not read.
        model: fitted.
        config: how it follows.
        device: of the simulator.

    Attributes:
        material: what is learnt of it; None where nothing is.
        learnt: whether a learnt material is in use.

    Raises:
        InputError: as of `Rollouts` and `LearntMaterial`, or a problem without tracks.
    """

    def __init__(self, problem: Problem, model: Model, config: FollowConfig | None = None, device: str = "cpu") -> None:
        if problem.tracks is None:
            raise InputError("no tracks", where="Follower", expected="a problem with tracked points")
        self.config = config or FollowConfig()
        viscous = not lacking(EFFECTS["kelvin_voigt"], problem.body)
        rollouts = Rollouts(problem, model, device=device, terms=("force", "viscosity") if viscous else ("force",))
        calm = self.config.calm / float(problem.fps) if viscous else None
        own = rollouts.problem
        self.fps, self._mass = float(own.fps), np.asarray(own.body.mass, float)
        points0 = own.tracks.points0.cpu().double().numpy()
        size = float(np.linalg.norm(np.ptp(own.body.x0, axis=0)))
        self._shared = 0.0 if own.camera is None else self.config.shared
        self._error = SmoothError(points0, own.body.x0, self.config.smoothness * size)
        self._learnt = LearntSizes(points0, self.config.least, self.config.memory)
        self._alarm = Alarm(self.config.usual)
        learns, members, frames = self.config.learns, self.config.members, float(self.config.memory)
        self.material = LearntMaterial(model, learns, members, frames) if learns else None
        self.learnt = self.material is not None
        every = [model.fields] if self.material is None else map(self.material.fields, range(members))
        self._members = [Running(rollouts, fields, calm) for fields in every]
        self._missing = np.zeros_like(own.body.x0)
        self._before: Array | None = None

    def go_on(self, controllers: Float[Array, "controllers 3"]) -> FrameState:
        """The next frame, in which nothing is looked at; F is the motion since frame 0.

        Args:
            controllers: points of the hand there [m].

        Raises:
            SimulationError: as of `Player.step`.
        """
        return mean_state([member.go_on(controllers) for member in self._members])

    def step(self, seen: Seen) -> Followed:
        """The next frame.

        Raises:
            SimulationError: as of `Player.step`.
        """
        states = [member.go_on(seen.controllers) for member in self._members]
        state, forecasts = mean_state(states), np.stack([member.forecast() for member in self._members])
        forecast = forecasts.mean(0)
        difference = np.where(seen.valid[:, None], seen.points - forecast, 0.0)
        size, noise = self._learnt.update(difference, seen.valid, seen.sigma)
        update = self._learn(forecasts, difference, seen, size, noise)
        moved = update.of_mean(forecasts)
        found = self._error.analysis(difference - moved, seen.valid, noise * seen.sigma, size)
        places = np.stack([own.x.cpu().double().numpy() for own in states])
        off = found.at_particles + update.of_mean(places)
        spread = np.sqrt((update.spread(forecasts) ** 2).mean(1))
        stated = float(np.median(seen.sigma[seen.valid])) if seen.valid.any() else 0.0
        gap = float(np.sqrt((self._mass @ (off**2).sum(1)) / self._mass.sum()))
        self._draw(off)
        return Followed(
            forecast=forecast,
            points=forecast + moved + found.at_points,
            deviation=np.sqrt(found.deviation**2 + spread**2 + (self._shared * stated) ** 2),
            x=places.mean(0) + off,
            F=state.F.cpu().double().numpy(),
            acceleration=self._missing.copy(),
            gap=gap,
            alarm=self._alarm.update(gap),
        )

    def _learn(self, forecasts: Array, difference: Array, seen: Seen, size: float, noise: float) -> Update:
        """What the frame says about the material."""
        if self.material is None:
            return Update(np.zeros(1), np.eye(1))
        covariance = self._error.covariance(noise * seen.sigma, size)
        return self.material.update(forecasts, difference, seen.valid, covariance)

    def _draw(self, error: Float[Array, "particles 3"]) -> None:
        """Give all members what they have learnt, and the forces that draw them along in the next frame."""
        config = self.config
        rate = np.zeros_like(error) if self._before is None else (error - self._before) * self.fps
        self._before = error
        self._missing = self._missing + config.learning * config.pull**2 * error / self.fps
        acceleration = self._missing + config.pull**2 * error + 2.0 * config.pull * rate
        length = np.linalg.norm(acceleration, axis=1, keepdims=True)
        acceleration = acceleration * np.minimum(1.0, config.strongest / np.maximum(length, 1e-12))
        for number, member in enumerate(self._members):
            fields = None if self.material is None else self.material.fields(number)
            member.change(self._mass[:, None] * acceleration, fields)
