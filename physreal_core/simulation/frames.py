"""Frame after frame of one rollout, forward and adjoint, through a form of the step.

The forward pass keeps particle states at frame times only; the backward pass recomputes one frame's substeps at a time
and runs their adjoint. Memory grows with frames and with substeps per frame, not with their product; up to a fixed
amount, a stepper may keep something of each substep that makes the second time cheaper.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import SimulationError
from physreal_core.simulation.body import Body
from physreal_core.simulation.box import GridBox, grid_box, largest_box
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.stepper import State, Stepper

Progress = Callable[[int, int], None]
Substeps = Callable[[Parameters], int]
"""Substeps per frame that a rollout with these parameters takes."""
Bars = tuple[Tensor | None, Tensor | None, Tensor | None]
"""Derivatives of the loss by x, v and F at frame times."""
ATTEMPTS = 4  # a frame whose particles leave their box is run again in a larger one, this many times in all


PerRollout = float | Float[Array, " rollouts"]


def larger(margin: PerRollout, cell: float) -> PerRollout:
    """Margin [m] of the box in which a frame is run again."""
    return 2.0 * margin + 4.0 * cell


def margin_of(frame_time: float, gravity: PerRollout, cell: float, speed: PerRollout, travel: PerRollout) -> PerRollout:
    """By how much particles may miss where their velocities take them within a frame [m].

    Args:
        frame_time: from one frame to the next [s].
        gravity: its size [m/s2].
        cell: dx [m].
        speed: of the fastest particle [m/s].
        travel: of the fastest controller point within the frame [m].
    """
    fall = gravity * frame_time**2
    return cell + fall + 0.5 * speed * frame_time + travel


@dataclass
class Record:
    """What a backward pass needs beside the states x, v, F at frame times.

    Attributes:
        substeps: per frame.
        C: affine velocities at frame times (and what `terms.inner_shape` says), shape [T, N, 3, 3].
        boxes: of every frame that ran.
        failures: what ended the rollout early, one entry.
        kept: leading frames of which the stepper keeps something, while its `holder` is this record.
    """

    substeps: int
    C: Tensor
    boxes: list[GridBox] = field(default_factory=list)
    failures: list[SimulationError | None] = field(default_factory=lambda: [None])
    kept: int = 0


class Frames:
    """The frame loop of one rollout on one stepper."""

    def __init__(self, body: Body, config: SimulationConfig, stepper: Stepper, substeps: Substeps) -> None:
        self.config, self.stepper, self._substeps = config, stepper, substeps
        self._x0 = torch.tensor(body.x0, dtype=stepper.types.torch_dtype, device=config.device)
        self._gravity = float(np.linalg.norm(config.gravity))  # of the rollout under way

    def _start(self, parameters: Parameters, substeps: int) -> State:
        """Load a rollout's parameters; its state at the first frame time, C = 0."""
        self.stepper.load_parameters(parameters, substeps)
        if parameters.gravity is not None:
            self._gravity = float(parameters.gravity.norm())
        x = self._x0 if parameters.initial_position is None else parameters.initial_position
        F = parameters.initial_deformation
        if F is None:
            F = torch.eye(3).to(x).expand(len(x), 3, 3)
        return x, parameters.initial_velocity, F, x.new_zeros(len(x), *self.stepper.inner_shape)

    def forward(
        self, parameters: Parameters, points: Tensor, progress: Progress | None, keep: bool
    ) -> tuple[Tensor, Tensor, Tensor, Record]:
        """States x, v, F at frame times, and what `backward` needs; with `keep` that holds affine velocities, too.

        A frame that fails ends the rollout: from its end on the states are not numbers.
        """
        frames, n = len(points), len(self._x0)
        x, v = self._x0.new_empty(frames, n, 3), self._x0.new_empty(frames, n, 3)
        F = self._x0.new_empty(frames, n, 3, 3)
        C = self._x0.new_zeros(frames if keep else 2, n, *self.stepper.inner_shape)
        record = Record(self._substeps(parameters), C)
        x[0], v[0], F[0], C[0] = self._start(parameters, record.substeps)
        for frame in range(frames - 1):
            now, after = (frame, frame + 1) if keep else (0, 1)
            state = (x[frame], v[frame], F[frame], C[now])
            try:
                box = self._advance(frame, state, points[frame : frame + 2], record if keep else None)
            except SimulationError as error:
                record.failures[0] = error
                for states in (x, v, F):
                    states[frame + 1 :] = torch.nan
                break
            record.boxes.append(box)
            x[frame + 1], v[frame + 1], F[frame + 1], C[after] = self.stepper.state()
            if not keep:
                C[0] = C[1]
            if progress is not None:
                progress(frame + 1, frames - 1)
        return x, v, F, record

    def play(self, parameters: Parameters, points: Tensor) -> Generator[State, Tensor, None]:
        """Yields the state and takes the controller points [C, 3] of the next frame time; starts at `points`."""
        state, frame = self._start(parameters, self._substeps(parameters)), 0
        while True:
            following = yield state
            self._advance(frame, state, torch.stack([points, following]).to(self._x0))
            state, points, frame = tuple(t.clone() for t in self.stepper.state()), following, frame + 1

    def _advance(self, frame: int, state: State, points: Tensor, record: Record | None = None) -> GridBox:
        """Run one frame from `state`, in a box large enough; the result stays in the stepper.

        Args:
            frame: its number.
            state: at its start.
            points: controller points [m] at both of its ends, shape [2, C, 3].
            record: of the rollout, if a backward pass may follow.

        Raises:
            SimulationError: where a state turns non-finite or a particle leaves its grid.
        """
        stepper = self.stepper
        lower, upper, margin = self._motion_bound(state[0], state[1], points)
        for _ in range(ATTEMPTS):
            box = grid_box(lower, upper, margin, stepper.cell, stepper.offset, largest_box(stepper.particles))
            if box is None:
                particle = int(state[1].norm(dim=1).argmax())
                raise SimulationError("the body runs away", frame=frame, substep=0, particle=particle)
            if record is not None and frame == 0:
                record.kept = stepper.keep_frames(record, len(record.C) - 1, box.nodes)
            kept = frame if record is not None and frame < record.kept else None
            stepper.start_frame(box, points, keep=False, kept=kept)
            stepper.set_state(*state)
            stepper.forward(keep=False)
            outside, not_finite = stepper.failures()
            if not_finite is not None:
                raise SimulationError(
                    "the state is not finite", frame=frame, substep=not_finite[0], particle=not_finite[1]
                )
            if outside is None:
                return box
            margin = larger(margin, stepper.cell)
        raise SimulationError("a particle left the grid", frame=frame, substep=outside[0], particle=outside[1])

    def _motion_bound(self, x: Tensor, v: Tensor, points: Tensor) -> tuple[Float[Array, "3"], Float[Array, "3"], float]:
        """Where the particles are and where their velocities take them within a frame, and a margin for the forces."""
        ahead = x + v * (1.0 / self.config.fps)
        travel = (points[1] - points[0]).norm(dim=-1).max() if points.shape[1] else x.new_zeros(())
        bounds = torch.cat(
            [
                torch.minimum(x, ahead).amin(0),
                torch.maximum(x, ahead).amax(0),
                torch.stack([v.norm(dim=1).max(), travel]),
            ]
        )
        bounds = bounds.double().cpu().numpy()
        return (
            bounds[:3],
            bounds[3:6],
            float(margin_of(1.0 / self.config.fps, self._gravity, self.stepper.cell, bounds[6], bounds[7])),
        )

    def backward(
        self,
        parameters: Parameters,
        record: Record,
        points: Tensor,
        states: tuple[Tensor, Tensor, Tensor],
        bars: Bars,
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name, and of `points` as "controllers", of losses with these derivatives.

        Frames after a failure have none.
        """
        stepper, frames = self.stepper, len(points)
        stepper.load_parameters(parameters, record.substeps)
        stepper.clear_adjoints()
        last = min(last_frame(bars), len(record.boxes))
        self._inject(bars, last)
        points_bar = torch.zeros_like(points)
        for frame in reversed(range(last)):
            kept = frame if frame < record.kept and stepper.holder is record else None
            stepper.start_frame(record.boxes[frame], points[frame : frame + 2], keep=True, kept=kept)
            stepper.set_state(*(state[frame] for state in (*states, record.C)))
            stepper.forward(keep=True)
            stepper.backward()
            bar = stepper.controllers_adjoint()
            points_bar[frame : frame + 2, : bar.shape[1]] += bar
            self._inject(bars, frame)
            if progress is not None:
                progress(frames - 1 - frame, frames - 1)
        return stepper.gradients() | {"controllers": points_bar}

    def _inject(self, bars: Bars, frame: int) -> None:
        self.stepper.add_adjoints(*(None if bar is None else bar[frame] for bar in bars))


def last_frame(bars: Bars) -> int:
    """Last frame at which a loss acts; frames after it have no adjoint."""
    acting = [bar.flatten(1).any(1) for bar in bars if bar is not None]
    if not acting:
        return 0
    frames = torch.stack(acting).any(0).nonzero().flatten()
    return int(frames[-1]) if len(frames) else 0
