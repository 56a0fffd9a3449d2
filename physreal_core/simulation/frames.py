"""Frame after frame of R rollouts, forward and adjoint, through a form of the step.

The forward pass keeps particle states at frame times only; the backward pass recomputes one frame's substeps at a time
and runs their adjoint. Memory grows with frames and with substeps per frame, not with their product; up to a fixed
amount, a stepper may keep something of each substep that makes the second time cheaper.
Arrays have axes frames, rollouts, particles.
"""

from collections.abc import Callable, Generator
from dataclasses import dataclass, field, replace

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation.body import Body
from physreal_core.simulation.box import box_corners, largest_box, small_enough
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.parameters import Parameters, row_of
from physreal_core.simulation.stepper import NOT_FAILED, Report, Span, State, Stepper
from physreal_core.simulation.timestep import LARGEST_SUBSTEPS, needed_substeps, substeps_per_frame

Progress = Callable[[int, int], None]
Bars = tuple[Tensor | None, Tensor | None, Tensor | None]
"""Derivatives of the loss by x, v and F at frame times."""
RUNAWAY = "the body runs away"
ATTEMPTS = 4  # a frame whose particles leave their box is run again in a larger one, this many times in all


@dataclass
class Record:
    """What a backward pass needs beside the states x, v, F at frame times.

    Attributes:
        substeps: per frame, of each rollout.
        C, rate, branches: of the states (`stepper.State`) at frame times, shape [T, R, N, ..., 3, 3].
        spans: the frames that ran.
        failures: what ended each rollout early.
        kept: leading frames of which the stepper keeps something, while its `holder` is this record.
    """

    substeps: list[int]
    C: Tensor
    rate: Tensor | None
    branches: Tensor | None
    spans: list[Span] = field(default_factory=list)
    failures: list[SimulationError | None] = field(default_factory=list)
    kept: int = 0

    def carried(self, frame: int) -> tuple[Tensor, Tensor | None, Tensor | None]:
        """C, rate and branches of a frame."""
        return (self.C[frame], *(None if values is None else values[frame] for values in (self.rate, self.branches)))

    def alive(self, frame: int) -> Bool[Array, " rollouts"]:
        """Rollouts that had not failed by the end of a frame."""
        return np.array([failure is None or failure.frame > frame for failure in self.failures])


class Frames:
    """The frame loop of a stepper's rollouts."""

    def __init__(self, body: Body, config: SimulationConfig, stepper: Stepper) -> None:
        self.config, self.stepper, self._scene = config, stepper, (body, config)
        self._x0 = torch.tensor(body.x0, dtype=stepper.dtype, device=config.device)
        self._gravity = np.linalg.norm(config.gravity)  # its size in each rollout under way

    # --- forward ------------------------------------------------------------------------------------------------

    def forward(
        self, parameters: Parameters, points: Tensor, progress: Progress | None, keep: bool
    ) -> tuple[Tensor, Tensor, Tensor, Record]:
        """States x, v, F [T, R, N, ...] at frame times, and what `backward` needs.

        A rollout that fails has states that are not numbers from the end of the failing frame on; the others go on.

        Args:
            parameters: complete, with an axis of rollouts.
            points: controller points [m], shape [T, R, C, 3].
            progress: called after each frame.
            keep: whether a backward pass may follow.
        """
        stepper, frames = self.stepper, len(points)
        shape = (stepper.rollouts, stepper.particles, 3)
        x, v = self._x0.new_empty(frames, *shape), self._x0.new_empty(frames, *shape)
        F = self._x0.new_empty(frames, *shape, 3)
        C = self._x0.new_zeros(frames if keep else 2, *shape, 3)
        rate = torch.zeros_like(C) if stepper.viscous else None
        branches = C.new_zeros(len(C), *shape[:2], stepper.branches, 3, 3) if stepper.branches else None
        substeps, failures = self._substeps(parameters)
        record = Record(substeps, C, rate, branches, failures=failures)

        def state(frame: int) -> State:
            return State(x[frame], v[frame], F[frame], *record.carried(frame if keep else frame % 2))

        self._start(parameters, record.substeps, state(0))
        travel, report = _travel(points), self._first_report(state(0))
        for frame in range(frames - 1):
            both, kept = points[frame : frame + 2], frames - 1 if keep else 0
            report = self._advance(frame, state(frame), state(frame + 1), both, travel[frame], report, record, kept)
            if progress is not None:
                progress(frame + 1, frames - 1)
            if all(record.failures):
                break
        for rollout, failure in enumerate(record.failures):
            if failure is not None:
                record.failures[rollout] = _with_hand(failure, points[:, rollout])
                for states in (x, v, F):
                    states[failure.frame + 1 :, rollout] = torch.nan
        return x, v, F, record

    def play(self, parameters: Parameters, points: Tensor) -> Generator[State, Tensor, None]:
        """Yields the state of the one rollout and takes the controller points [C, 3] of the next frame time."""
        stepper = self.stepper
        shape = (1, stepper.particles, 3)
        states = [
            State(
                *(self._x0.new_zeros(shape) for _ in range(2)),
                *(self._x0.new_zeros(*shape, 3) for _ in range(2)),
                self._x0.new_zeros(*shape, 3) if stepper.viscous else None,
                self._x0.new_zeros(*shape[:2], stepper.branches, 3, 3) if stepper.branches else None,
            )
            for _ in range(2)
        ]
        substeps, _ = self._substeps(parameters)
        self._start(parameters, substeps, states[0])
        report, frame = self._first_report(states[0]), 0
        while True:
            start, end = states[frame % 2], states[(frame + 1) % 2]
            following = yield start
            both = torch.stack([points, following])[:, None]
            record = Record(substeps, start.C, start.rate, start.branches, failures=[None])
            report = self._advance(frame, start, end, both.to(self._x0), _travel(both)[0], report, record, 0)
            if record.failures[0] is not None:
                raise _with_hand(record.failures[0], both[:, 0], frame)
            points, frame = following, frame + 1

    def _substeps(self, parameters: Parameters) -> tuple[list[int], list[SimulationError | None]]:
        """Substeps per frame of each rollout; of many, those that would need too many have failed before the first frame."""
        rollouts = self.stepper.rollouts
        if self.stepper.in_step and (rollouts == 1 or needed_substeps(*self._scene, parameters) <= LARGEST_SUBSTEPS):
            return [substeps_per_frame(*self._scene, parameters)] * rollouts, [None] * rollouts
        counts, failures = [1] * rollouts, [None] * rollouts
        for rollout in range(rollouts):
            try:
                counts[rollout] = substeps_per_frame(*self._scene, row_of(parameters, rollout))
            except InputError as error:
                if rollouts == 1:
                    raise
                failures[rollout] = SimulationError(str(error), frame=0, substep=0, particle=0)
        return [max(counts)] * rollouts if self.stepper.in_step else counts, failures

    def _start(self, parameters: Parameters, substeps: list[int], state: State) -> None:
        """Load the rollouts' parameters, and put their state at the first frame time into `state`."""
        self.stepper.load_parameters(parameters, substeps)
        if parameters.gravity is not None:
            self._gravity = parameters.gravity.norm(dim=-1).double().cpu().numpy()
        state.x.copy_(self._x0 if parameters.initial_position is None else parameters.initial_position)
        state.v.copy_(parameters.initial_velocity)
        F = parameters.initial_deformation
        state.F.copy_(torch.eye(3).to(state.F) if F is None else F)

    def _first_report(self, state: State) -> Report:
        """Of a state that no frame has reported on."""
        ahead = torch.add(state.x, state.v, alpha=1.0 / self.config.fps)
        lower, upper = torch.minimum(state.x, ahead).amin(1), torch.maximum(state.x, ahead).amax(1)
        bounds = torch.cat([lower, upper, state.v.norm(dim=2).amax(1, keepdim=True)], 1).double().cpu().numpy()
        none = np.full((len(bounds), 2), NOT_FAILED)
        return Report(none, bounds[:, :3], bounds[:, 3:6], bounds[:, 6])

    def _advance(
        self,
        frame: int,
        start: State,
        end: State,
        points: Tensor,
        travel: Float[Array, " rollouts"],
        report: Report,
        record: Record,
        kept: int,
    ) -> Report:
        """Run one frame of all rollouts in boxes large enough.

        Args:
            frame: its number.
            start, end: states there.
            points: controller points [m] at both ends, shape [2, R, C, 3].
            travel: how far the fastest controller point of each rollout goes [m].
            report: on the frame before.
            record: gets the frame's span, and failures.
            kept: frames of the rollout of which something may be kept for a backward pass; 0 for none.

        Returns:
            The report on it.
        """
        stepper, motion = self.stepper, report
        margins = self._margins(report.speed, travel)
        carries_on = frame > 0 and all(f is None or f.frame != frame - 1 for f in record.failures)
        for attempt in range(ATTEMPTS):
            boxes, alive = self._place(frame, start.v, motion, margins, record)
            span = Span(frame, boxes, points, alive)
            if kept and frame == 0:
                record.kept = stepper.keep_frames(record, kept, span.nodes)
            if frame < record.kept and stepper.holder is record:
                span = replace(span, kept=frame)
            report, ran = stepper.forward(span, start, end, carries_on and attempt == 0)
            again = self._judge(span, report, record, attempt == ATTEMPTS - 1)
            if not again.any():
                break
            margins = np.where(again, 2.0 * margins + 4.0 * stepper.cell, margins)
        if kept:
            record.spans.append(ran.without_points())
        failed = np.flatnonzero(~record.alive(frame))
        if len(failed):
            end.x[torch.as_tensor(failed, device=end.x.device)] = torch.nan  # which keeps them out of every grid
        return report

    def _margins(self, speed: Float[Array, " rollouts"], travel: Float[Array, " rollouts"]) -> np.ndarray:
        """By how much particles may miss where their velocities take them within a frame [m], shape [R]."""
        frame_time = 1.0 / self.config.fps
        return self.stepper.cell + self._gravity * frame_time**2 + 0.5 * speed * frame_time + travel

    def _place(
        self, frame: int, v: Tensor, motion: Report, margins: Float[Array, " rollouts"], record: Record
    ) -> tuple[np.ndarray, np.ndarray]:
        """Boxes [R, 6] of nodes, and who runs in them [R]; a rollout that needs too large a one has failed."""
        stepper = self.stepper
        first, count = box_corners(motion.lower, motion.upper, margins, stepper.cell, stepper.offset)
        alive = record.alive(frame)
        asked = np.where(alive[:, None], count, np.nan)
        fits, given = stepper.fitting(asked)
        for rollout in np.flatnonzero(alive & ~fits):
            alone = small_enough(count[rollout], largest_box(stepper.particles))
            what = f"{stepper.rollouts} rollouts are too many for so large a box" if alone else RUNAWAY
            particle = int(v[rollout].norm(dim=1).argmax())
            record.failures[rollout] = SimulationError(what, frame=frame, substep=0, particle=particle)
        boxes = np.full((len(first), 6), 3, dtype=np.int32)  # of those that do not run: the smallest there is
        boxes[fits, :3], boxes[:, 3:] = (
            first[fits],
            np.where(fits[:, None], given, given[fits][:1] if fits.any() else 3),
        )
        return boxes, fits

    def _judge(self, span: Span, report: Report, record: Record, last: bool) -> Bool[Array, " rollouts"]:
        """Put down which rollouts have failed; returns whose particles only need a larger box, shape [R]."""
        again = np.zeros(len(span.alive), dtype=bool)
        for rollout in np.flatnonzero(span.alive & (report.failures != NOT_FAILED).any(1)):
            outside, not_finite = report.failures[rollout]
            key, what = outside, "a particle left the grid"
            if not_finite != NOT_FAILED:
                key, what = not_finite, "the state is not finite"
            elif not last:
                again[rollout] = True
                continue
            substep, particle = divmod(int(key), self.stepper.particles)
            record.failures[rollout] = SimulationError(what, frame=span.frame, substep=substep, particle=particle)
        return again

    # --- backward -----------------------------------------------------------------------------------------------

    def backward(
        self,
        parameters: Parameters,
        record: Record,
        points: Tensor,
        states: tuple[Tensor, Tensor, Tensor],
        bars: Bars,
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name, with an axis of rollouts, and of `points` as "controllers" if they ask for it.

        Frames after a rollout's failure have none.
        """
        stepper, frames = self.stepper, len(points)
        held = stepper.holder is record
        bars = _before_failures(bars, record)
        last = min(last_frame(bars), len(record.spans))
        stepper.load_parameters(parameters, record.substeps)
        stepper.begin_backward(record.spans[:last], held)
        self._inject(bars, last)
        led, points_bar = points.requires_grad, torch.zeros_like(points)
        for frame in reversed(range(last)):
            kept = frame if held and frame < record.kept else None
            span = replace(record.spans[frame], points=points[frame : frame + 2], alive=record.alive(frame), kept=kept)
            start = State(*(state[frame] for state in states), *record.carried(frame))
            bar = stepper.backward(span, start, led)
            if led:
                count = min(points.shape[2], bar.shape[2])
                points_bar[frame : frame + 2, :, :count] += bar[:, :, :count]
            self._inject(bars, frame)
            if progress is not None:
                progress(frames - 1 - frame, frames - 1)
        return stepper.gradients() | ({"controllers": points_bar} if led else {})

    def _inject(self, bars: Bars, frame: int) -> None:
        self.stepper.add_adjoints(*(None if bar is None else bar[frame] for bar in bars))


def _travel(points: Tensor) -> Float[Array, "frames rollouts"]:
    """How far the fastest controller point goes in each frame [m]."""
    if points.shape[2] == 0 or len(points) < 2:
        return np.zeros((len(points), points.shape[1]))
    return (points[1:] - points[:-1]).norm(dim=-1).amax(-1).double().cpu().numpy()


def _with_hand(failure: SimulationError, points: Tensor, first: int = 0) -> SimulationError:
    """A body that runs away with the controller point that moved farthest within a frame until then, which may have torn it.

    Args:
        failure: any.
        points: controller points at frame times [m], shape [T, C, 3].
        first: frame of the first of them.
    """
    until = points[: failure.frame - first + 2]
    if failure.what != RUNAWAY or until.shape[1] == 0 or len(until) < 2:
        return failure
    moved = (until[1:] - until[:-1]).norm(dim=-1)
    frame, controller = divmod(int(moved.argmax()), moved.shape[1])
    path = f"controller point {controller} moves {float(moved.max()):.3g} m from frame {first + frame} to {first + frame + 1}"
    return SimulationError(
        f"{RUNAWAY}; {path}", frame=failure.frame, substep=failure.substep, particle=failure.particle
    )


def _before_failures(bars: Bars, record: Record) -> Bars:
    """The derivatives, zero where a state is not a number."""
    if not any(record.failures):
        return bars
    cleared = []
    for bar in bars:
        bar = None if bar is None else bar.clone()
        for rollout, failure in enumerate(record.failures):
            if bar is not None and failure is not None:
                bar[failure.frame + 1 :, rollout] = 0.0
        cleared.append(bar)
    return tuple(cleared)


def last_frame(bars: Bars) -> int:
    """Last frame at which a loss acts; frames after it have no adjoint."""
    acting = [bar.flatten(1).any(1) for bar in bars if bar is not None]
    if not acting:
        return 0
    frames = torch.stack(acting).any(0).nonzero().flatten()
    return int(frames[-1]) if len(frames) else 0
