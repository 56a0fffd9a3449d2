"""Frame after frame of R rollouts, forward and adjoint, through a form of the step.

The forward pass keeps particle states at frame times only; the backward pass recomputes one frame's substeps at a time
and runs their adjoint. Memory grows with frames and with substeps per frame, not with their product; up to a fixed
amount, a stepper may keep something of each substep that makes the second time cheaper.
Arrays have axes frames, rollouts, particles.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Int, Tensor
from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation.body import Body, Grip
from physreal_core.simulation.bonds import Bonds
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters, row_of
from physreal_core.simulation.start import NodeStart, VertexStart
from physreal_core.simulation.stepper import NOT_FAILED, Span, State, Stepper
from physreal_core.simulation.timestep import LARGEST_SUBSTEPS, needed_substeps, substeps_per_frame

Progress = Callable[[int, int], None]
SHOWN = ("x", "v", "F", "director")
"""What a rollout shows of its states at frame times, as far as they have it."""
Bars = dict[str, Tensor]
"""Derivatives of the loss by what is shown, by name."""
TORN = 10.0
"""Cells by which a controller point moves within a frame where it may have torn the body."""


@dataclass
class Record:
    """What a backward pass needs beside what is shown of the states at frame times.

    Attributes:
        substeps: per frame, of each rollout.
        further: what else there is of the states (`stepper.State`) at frame times by name, each [T, R, ...].
        ran: number of frames that ran.
        failures: what ended each rollout early.
        lengths: of the bonds without force [m], shape [R, B]; None without a grip.
        kept: leading frames of which the stepper keeps something, while its `holder` is this record.
    """

    substeps: list[int]
    further: dict[str, Tensor]
    ran: int = 0
    failures: list[SimulationError | None] = field(default_factory=list)
    kept: int = 0
    lengths: Tensor | None = None

    def carried(self, frame: int) -> dict[str, Tensor]:
        """What else there is of a frame's state."""
        return {name: values[frame] for name, values in self.further.items()}

    def alive(self, frame: int) -> Bool[Array, " rollouts"]:
        """Rollouts that had not failed by the end of a frame."""
        return np.array([failure is None or failure.frame > frame for failure in self.failures])


class Frames:
    """The frame loop of a stepper's rollouts.

    Args:
        body, config, grip: as for `Simulator`.
        stepper: runs the frames.
        strict: whether a rollout that would need too many substeps is an InputError; else it fails before the first frame.
    """

    def __init__(
        self, body: Body, config: SimulationConfig, stepper: Stepper, grip: Grip | None = None, strict: bool = True
    ) -> None:
        self.config, self.stepper, self._scene, self._strict = config, stepper, (body, config), strict
        self._bonds = (
            None if grip is None or len(grip.particles) == 0 else Bonds(body, grip, stepper.rollouts, config.device)
        )
        self._x0 = torch.tensor(body.x0, dtype=stepper.dtype, device=config.device)

    @cached_property
    def _node_start(self) -> NodeStart | VertexStart:
        """How the nodes start; most bodies start at rest."""
        if self._scene[0].elements is not None:
            return VertexStart()
        return NodeStart(self._scene[0], self.stepper.lattice, self.stepper.dtype, self.config.device)

    # --- forward ------------------------------------------------------------------------------------------------

    def forward(
        self, parameters: Parameters, points: Tensor, progress: Progress | None, keep: bool
    ) -> tuple[dict[str, Tensor], Record]:
        """What is shown of the states [T, R, N, ...] at frame times, by name, and what `backward` needs.

        A rollout that fails has states that are not numbers from the end of the failing frame on; the others go on.

        Args:
            parameters: complete, with an axis of rollouts.
            points: controller points [m], shape [T, R, C, 3], with their neighbours (`hand_path`).
            progress: called after each frame.
            keep: whether a backward pass may follow.
        """
        frames = len(points) - 2
        sizes = self._sizes()
        shown = {name: self._zeros(frames, sizes.pop(name)) for name in SHOWN if name in sizes}
        further = {name: self._zeros(frames if keep else 2, size) for name, size in sizes.items()}
        substeps, failures = self._substeps(parameters)
        record = Record(substeps, further, failures=failures, lengths=self.given_lengths())

        def state(frame: int) -> State:
            return _state(shown, frame, record.carried(frame if keep else frame % 2))

        self._start(parameters, record.substeps, state(0))
        if keep and frames > 1:
            record.kept = self.stepper.keep_frames(record, frames - 1)
        for frame in range(frames - 1):
            self._advance(frame, state(frame), state(frame + 1), points[frame : frame + 4], record)
            if progress is not None:
                progress(frame + 1, frames - 1)
            if all(record.failures):
                break
        for rollout, failure in enumerate(record.failures):
            if failure is not None:
                record.failures[rollout] = _with_hand(failure, points[1:-1, rollout], self.stepper.lattice.cell)
                for values in shown.values():
                    values[failure.frame + 1 :, rollout] = torch.nan
        return shown, record

    def begin(self, parameters: Parameters) -> tuple[State, State]:
        """Loads the parameters of the one rollout; two states that take turns, the first at the start."""
        arrays = {name: self._zeros(2, size) for name, size in self._sizes().items()}
        states = tuple(
            State(**{"F": None} | {name: values[turn] for name, values in arrays.items()}) for turn in (0, 1)
        )
        self._start(parameters, self._substeps(parameters)[0], states[0])
        return states

    def load(self, parameters: Parameters) -> None:
        """Loads the parameters of the one rollout, which goes on."""
        self.stepper.load_parameters(parameters, self._substeps(parameters)[0])

    def go_on(
        self, frame: int, start: State, end: State, around: Tensor, lengths: Tensor | None, carries_on: bool
    ) -> None:
        """Run one frame of the one rollout.

        Args:
            frame: its number.
            start, end: states there.
            around: controller points [m] around it, shape [4, C, 3].
            lengths: of the bonds [m], shape [1, B]; gets those of bonds that are taken here.
            carries_on: whether `start` is where this loop's last frame ended.

        Raises:
            SimulationError: where the state turns non-finite.
        """
        record = Record([], {}, failures=[None], lengths=lengths)
        points = around[:, None]
        self._advance(frame, start, end, points.to(self._x0), record, carries_on)
        if record.failures[0] is not None:
            raise _with_hand(record.failures[0], points[1:3, 0], self.stepper.lattice.cell, frame)

    def given_lengths(self) -> Tensor | None:
        """Lengths of the bonds [R, B], not a number for those that are as long as they are when taken; None without bonds."""
        return None if self._bonds is None else self._bonds.given()

    def _sizes(self) -> dict[str, tuple[int, ...]]:
        """Shape of what a rollout's state has, by name."""
        stepper = self.stepper
        sizes = {name: (stepper.particles, *size) for name, size in stepper.state_shapes.items()}
        return sizes | {"nodes": (stepper.lattice.nodes, 4)}

    def _zeros(self, frames: int, size: tuple[int, ...]) -> Tensor:
        return self._x0.new_zeros(frames, self.stepper.rollouts, *size)

    def _substeps(self, parameters: Parameters) -> tuple[list[int], list[SimulationError | None]]:
        """Substeps per frame of each rollout, and which have failed for needing too many."""
        rollouts = self.stepper.rollouts
        if self.stepper.in_step and (self._strict or needed_substeps(*self._scene, parameters) <= LARGEST_SUBSTEPS):
            return [substeps_per_frame(*self._scene, parameters)] * rollouts, [None] * rollouts
        counts, failures = [1] * rollouts, [None] * rollouts
        for rollout in range(rollouts):
            try:
                counts[rollout] = substeps_per_frame(*self._scene, row_of(parameters, rollout))
            except InputError as error:
                if self._strict:
                    raise
                failures[rollout] = SimulationError(str(error), frame=0, substep=0, particle=0)
        return [max(counts)] * rollouts if self.stepper.in_step else counts, failures

    def _start(self, parameters: Parameters, substeps: list[int], state: State) -> None:
        """Load the rollouts' parameters, and put their state at the first frame time into `state`."""
        self.stepper.load_parameters(parameters, substeps)
        state.x.copy_(self._x0 if parameters.initial_position is None else parameters.initial_position)
        state.v.copy_(parameters.initial_velocity)
        if parameters.initial_velocity.any():
            state.nodes.copy_(self._node_start.nodes(parameters.initial_velocity.detach()))
        if state.F is not None:
            F = parameters.initial_deformation
            state.F.copy_(torch.eye(3).to(state.F) if F is None else F)
        if state.shape is not None:
            state.shape.copy_(state.F)
        if state.mean_velocity is not None:
            state.mean_velocity.copy_(parameters.initial_velocity)
        if state.director is not None:
            state.director.copy_(self._scene[0].elements.directors_at(state.x, parameters.initial_director))
            state.spin.zero_()

    def _advance(
        self, frame: int, start: State, end: State, points: Tensor, record: Record, carries_on: bool | None = None
    ) -> None:
        """Run one frame of all rollouts.

        Args:
            frame: its number.
            start, end: states there.
            points: controller points [m] around it, shape [4, R, C, 3].
            record: gets failures.
            carries_on: whether `start` is where the last frame ended; by default in all but the first.
        """
        alive = record.alive(frame)
        kept = frame if frame < record.kept and self.stepper.holder is record else None
        if self._bonds is not None:
            self._bonds.take(frame, start.x, points[1], record.lengths)
        span = Span(frame, points, alive, record.lengths, kept)
        failures = self.stepper.forward(span, start, end, carries_on=frame > 0 if carries_on is None else carries_on)
        self._judge(frame, failures, alive, record)
        record.ran = frame + 1

    def _judge(
        self, frame: int, failures: Int[Array, " rollouts"], alive: Bool[Array, " rollouts"], record: Record
    ) -> None:
        """Put down which rollouts have failed."""
        for rollout in np.flatnonzero(alive & (failures != NOT_FAILED)):
            substep, particle = divmod(int(failures[rollout]), self.stepper.particles)
            record.failures[rollout] = SimulationError(
                "the state is not finite", frame=frame, substep=substep, particle=particle
            )

    # --- backward -----------------------------------------------------------------------------------------------

    def backward(
        self,
        parameters: Parameters,
        record: Record,
        points: Tensor,
        shown: dict[str, Tensor],
        bars: Bars,
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name, with an axis of rollouts, and of `points` as "controllers" if they ask for it.

        Frames after a rollout's failure have none.
        """
        stepper, frames = self.stepper, len(points) - 2
        held = stepper.holder is record
        bars = _before_failures(bars, record)
        last = min(last_frame(bars), record.ran)
        stepper.load_parameters(parameters, record.substeps)
        stepper.begin_backward(last, held)
        self._inject(bars, last)
        led, points_bar = points.requires_grad, torch.zeros_like(points)
        for frame in reversed(range(last)):
            kept = frame if held and frame < record.kept else None
            span = Span(frame, points[frame : frame + 4], record.alive(frame), record.lengths, kept)
            start = _state(shown, frame, record.carried(frame))
            bar = stepper.backward(span, start, led)
            if led:
                count = min(points.shape[2], bar.shape[2])
                points_bar[frame : frame + 4, :, :count] += bar[:, :, :count]
            if self._bonds is not None and self._bonds.takes(frame):
                bars_taken = self._bonds.take_adjoint(frame, start.x, points[frame + 1], stepper.lengths_adjoint())
                stepper.add_adjoints({"x": bars_taken[0]})
                points_bar[frame + 1] += bars_taken[1]
            self._inject(bars, frame)
            if progress is not None:
                progress(frames - 1 - frame, frames - 1)
        gradients = stepper.gradients() | ({"controllers": points_bar} if led else {})
        if parameters.initial_velocity.requires_grad:
            gradients["initial_velocity"] = gradients["initial_velocity"] + self._node_start.particles(
                stepper.nodes_adjoint()
            )
        return gradients

    def _inject(self, bars: Bars, frame: int) -> None:
        self.stepper.add_adjoints({name: bar[frame] for name, bar in bars.items()})


def _state(shown: dict[str, Tensor], frame: int, carried: dict[str, Tensor]) -> State:
    """A frame's state from what is shown of all frames and what else there is of this one."""
    return State(**{"F": None} | {name: values[frame] for name, values in shown.items()}, **carried)


def _with_hand(failure: SimulationError, points: Tensor, cell: float, first: int = 0) -> SimulationError:
    """The failure with the controller point that moved farthest within a frame until then, if that is so far that it may have torn
    the body.

    Args:
        failure: any.
        points: controller points at frame times [m], shape [T, C, 3].
        cell: of the grid [m].
        first: frame of the first of them.
    """
    until = points[: failure.frame - first + 3]  # a jump behind a frame bends the way within it
    if until.shape[1] == 0 or len(until) < 2:
        return failure
    moved = (until[1:] - until[:-1]).norm(dim=-1)
    if float(moved.max()) < TORN * cell:
        return failure
    frame, controller = divmod(int(moved.argmax()), moved.shape[1])
    path = f"controller point {controller} moves {float(moved.max()):.3g} m from frame {first + frame} to {first + frame + 1}"
    return SimulationError(
        f"{failure.what}; {path}", frame=failure.frame, substep=failure.substep, particle=failure.particle
    )


def _before_failures(bars: Bars, record: Record) -> Bars:
    """The derivatives, zero where a state is not a number."""
    if not any(record.failures):
        return bars
    cleared = {name: bar.clone() for name, bar in bars.items()}
    for bar in cleared.values():
        for rollout, failure in enumerate(record.failures):
            if failure is not None:
                bar[failure.frame + 1 :, rollout] = 0.0
    return cleared


def last_frame(bars: Bars) -> int:
    """Last frame at which a loss acts; frames after it have no adjoint."""
    if not bars:
        return 0
    acting = [bar.flatten(1).any(1) for bar in bars.values()]
    frames = torch.stack(acting).any(0).nonzero().flatten()
    return int(frames[-1]) if len(frames) else 0
