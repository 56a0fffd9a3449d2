"""A rollout frame by frame, for interactive use: controller points in, state out, nothing kept."""

from collections.abc import Callable, Generator
from contextlib import AbstractContextManager
from dataclasses import dataclass

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.stepper import State


@dataclass
class FrameState:
    """State at one frame time: x [N, 3] m, v [N, 3] m/s, F [N, 3, 3], of framed rods the segments' directors [N, 3] and
    spins [N] rad/s (`stepper.State`); its arrays are valid until the step after next."""

    x: Float[Tensor, "particles 3"]
    v: Float[Tensor, "particles 3"]
    F: Float[Tensor, "particles 3 3"]
    director: Float[Tensor, "particles 3"] | None = None
    spin: Float[Tensor, " particles"] | None = None


class Player:
    """A rollout that goes on for as long as it is stepped; made by `Simulator.play`.

    Attributes:
        frame: number of the frame time where it stands.
        state: the state there.
    """

    def __init__(
        self,
        frames: Generator[State, Tensor, None],
        stream: Callable[[], AbstractContextManager],
        check: Callable[[Tensor], Tensor],
        deformation: Callable[[Tensor, Tensor | None], Tensor] | None = None,
    ) -> None:
        self._frames, self._stream, self._check, self._deformation = frames, stream, check, deformation
        self.frame = 0
        with torch.no_grad(), stream():
            self.state = self._alone(next(frames))

    def step(self, controllers: Float[Tensor, "points 3"]) -> FrameState:
        """Go on by one frame, in which the controller points move to `controllers` [m], shape [C, 3], smoothly (`hand_path`).

        Raises:
            InputError: for controllers that do not fit.
            SimulationError: where the state turns non-finite; the player has then ended.
        """
        points = self._check(controllers.detach().cpu()[None])[0]  # checked on the host
        with torch.no_grad(), self._stream():
            self.state = self._alone(self._frames.send(points))
        self.frame += 1
        return self.state

    def _alone(self, state: State) -> FrameState:
        """The one rollout's, with the F of a thin body from its places and directors."""
        F = self._deformation(state.x, state.director) if state.F is None else state.F
        frames = () if state.director is None else (state.director[0], state.spin[0])
        return FrameState(state.x[0], state.v[0], F[0], *frames)
