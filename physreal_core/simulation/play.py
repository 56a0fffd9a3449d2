"""A rollout frame by frame, for interactive use: controller points in, state out, nothing kept; what holds the body may change."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.simulation.body import Body, Grip
from physreal_core.simulation.frames import Frames
from physreal_core.simulation.hand_path import steered
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.stepper import State, Stepper


@dataclass
class FrameState:
    """State at one frame time: x [N, 3] m, v [N, 3] m/s, F [N, 3, 3], of framed rods the segments' directors [N, 3] and
    spins [N] rad/s (`stepper.State`); its arrays are valid until the step after next."""

    x: Float[Tensor, "particles 3"]
    v: Float[Tensor, "particles 3"]
    F: Float[Tensor, "particles 3 3"]
    director: Float[Tensor, "particles 3"] | None = None
    spin: Float[Tensor, " particles"] | None = None


@dataclass(frozen=True)
class Played:
    """What a player needs of its simulator.

    Attributes:
        body: that is played with.
        frames: the frame loop of a form of the step of its own, for a grip.
        points: checks controller points [C, 3] for a grip, and brings them into the simulator's type.
        complete: fills parameters up, with an axis of so many rollouts, for a form of the step.
        stream: where a loop runs.
        deformation: F of a thin body from its places and directors; None for a volume.
    """

    body: Body
    frames: Callable[[Grip | None], Frames]
    points: Callable[[Tensor, Grip | None], Tensor]
    complete: Callable[[Parameters, int, Stepper], Parameters]
    stream: Callable[[], AbstractContextManager]
    deformation: Callable[[Tensor, Tensor | None], Tensor] | None = None


class Player:
    """A rollout that goes on for as long as it is stepped; made by `Simulator.play`.

    Attributes:
        frame: number of the frame time where it stands.
        state: the state there.
        grip: the bonds that hold the body from there on.
    """

    def __init__(
        self, played: Played, parameters: Parameters, controllers: Float[Tensor, "points 3"], grip: Grip | None
    ) -> None:
        self._played, self.grip, self.frame = played, grip, 0
        self._points, self._before = self._checked(controllers), None
        with torch.no_grad(), played.stream():
            self._parameters, self._loop = parameters, played.frames(grip)
            self._states = self._loop.begin(self._complete(parameters, self._loop))
        self._lengths, self._carries_on = self._loop.given_lengths(), False
        self.state = self._alone(self._states[0])

    @property
    def lengths(self) -> Float[Array, " bonds"]:
        """Lengths of the grip's bonds without force [m]; not a number for those that are not taken yet."""
        return np.zeros(0) if self._lengths is None else self._lengths[0].cpu().double().numpy()

    def step(self, controllers: Float[Tensor, "points 3"]) -> FrameState:
        """Go on by one frame, in which the controller points move to `controllers` [m], shape [C, 3], smoothly (`hand_path`).

        Raises:
            InputError: for controllers that do not fit.
            SimulationError: where the state turns non-finite; the player stands where it stood, and what would follow is undefined.
        """
        following = self._checked(controllers)
        around = steered(self._points, following, self._before)
        start, end = (self._states[(self.frame + turn) % 2] for turn in range(2))
        with torch.no_grad(), self._played.stream():
            self._loop.go_on(self.frame, start, end, around, self._lengths, self._carries_on)
        self._before, self._points, self._carries_on = self._points, following, True
        self.frame += 1
        self.state = self._alone(end)
        return self.state

    def hold(
        self,
        grip: Grip | None,
        controllers: Float[Tensor, "points 3"],
        before: Float[Tensor, "points 3"] | None = None,
    ) -> None:
        """From here on the body is held by these bonds alone; it goes on moving as it moved.

        Args:
            grip: with controller points of its own; None lets go of all. A bond without a length is as long as it is here, or where
                it is taken if that is later.
            controllers: where those points are now [m], shape [C, 3].
            before: where they were a frame ago; None for a hand that begins at rest in the sense of `hand_path`.

        Raises:
            InputError: for bonds or points that do not fit.
        """
        points = self._played.points(controllers.detach().cpu(), grip)
        if grip is not None:
            grip.check(self._played.body)
            late = np.isnan(grip.rest_lengths) & (grip.taken < self.frame)
            grip = replace(grip, taken=np.where(late, self.frame, grip.taken))
        with torch.no_grad(), self._played.stream():
            loop = self._played.frames(grip)
            loop.load(self._complete(self._parameters, loop))
        self.grip, self._loop, self._points = grip, loop, points
        self._before = None if before is None else self._checked(before)
        self._lengths, self._carries_on = loop.given_lengths(), False

    def change(self, parameters: Parameters) -> None:
        """From here on these parameters hold; InputError where they do not fit or need too many substeps."""
        with torch.no_grad(), self._played.stream():
            self._loop.load(self._complete(parameters, self._loop))
        self._parameters, self._carries_on = parameters, False

    def _complete(self, parameters: Parameters, loop: Frames) -> Parameters:
        return self._played.complete(parameters, 1, loop.stepper)

    def _checked(self, controllers: Tensor) -> Tensor:
        return self._played.points(controllers.detach().cpu(), self.grip)

    def _alone(self, state: State) -> FrameState:
        """The one rollout's, with the F of a thin body from its places and directors."""
        F = self._played.deformation(state.x, state.director) if state.F is None else state.F
        frames = () if state.director is None else (state.director[0], state.spin[0])
        return FrameState(state.x[0], state.v[0], F[0], *frames)
