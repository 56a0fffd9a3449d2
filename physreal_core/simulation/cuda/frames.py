"""Frame after frame of many rollouts at once on a GPU, forward and adjoint, with one wait for the device a frame.

As `simulation.frames`, but the substeps of as many frames as fit into a budget stay in memory and are not recomputed;
beyond it memory grows as there. Arrays have axes frames, rollouts, particles.
"""

from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import SimulationError
from physreal_core.simulation.body import Body
from physreal_core.simulation.box import box_corners, largest_box, small_enough
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.report import bounds
from physreal_core.simulation.cuda.stepper import CudaStepper
from physreal_core.simulation.frames import (
    ATTEMPTS,
    Bars,
    PerRollout,
    Progress,
    Substeps,
    larger,
    last_frame,
    margin_of,
)
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.stepper import State

SORT_FRAMES = 32
"""Frames after which particles are put in the order of their cells again. On an H200 sorting every frame costs 20 000
particles a third of their speed and a million 4 %; an elastic body's order stays good, one that flows loses it slowly."""
_NONE = torch.iinfo(torch.int64).max


@dataclass
class CudaRecord:
    """What a backward pass needs beside the states x, v, F at frame times.

    Attributes:
        substeps: per frame, of all rollouts.
        C: affine velocities at frame times (and what `terms.inner_shape` says), shape [T, R, N, 3, 3].
        boxes: nodes of a rollout, and the boxes [R, 6], of every frame.
        orders: order of the particles in every frame.
        failures: what ended each rollout early.
        kept: frames whose substeps are in memory, while the stepper's `holder` is this record.
    """

    substeps: int
    C: Tensor
    boxes: list[tuple[int, Tensor]] = field(default_factory=list)
    orders: list[Tensor] = field(default_factory=list)
    failures: list[SimulationError | None] = field(default_factory=list)
    kept: int = 0


@dataclass
class _Course:
    """What a frame leaves for the next one.

    Attributes:
        bounds: of the motion, per rollout, see `report.bounds`.
        moved: whether the state has to be put into the stepper anew.
        kept_frames: how many frames of the rollout are to be kept if there is room.
    """

    bounds: np.ndarray
    moved: bool = True
    kept_frames: int = 0


class CudaFrames:
    """The frame loop of `stepper.rollouts` rollouts."""

    def __init__(self, body: Body, config: SimulationConfig, stepper: CudaStepper, substeps: Substeps) -> None:
        self.config, self.stepper, self._substeps = config, stepper, substeps
        self._x0 = torch.tensor(body.x0, dtype=stepper.types.torch_dtype, device=config.device)
        self._gravity: PerRollout = float(np.linalg.norm(config.gravity))  # of the rollouts under way
        self._largest = min(largest_box(stepper.particles), stepper.most_nodes)
        self._box_rows: np.ndarray | None = None

    # --- forward ------------------------------------------------------------------------------------------------

    def _start(self, parameters: Parameters, substeps: int) -> State:
        """Load the rollouts' parameters; their state at the first frame time, each [R, N, ...], C = 0."""
        stepper = self.stepper
        stepper.load_parameters(parameters, substeps)
        if parameters.gravity is not None:
            self._gravity = parameters.gravity.norm(dim=-1).double().cpu().numpy()
        v, shape = parameters.initial_velocity, (stepper.rollouts, stepper.particles)
        x = self._x0.expand(*shape, 3) if parameters.initial_position is None else parameters.initial_position
        F = parameters.initial_deformation
        if F is None:
            F = torch.eye(3).to(v).expand(*shape, 3, 3)
        return x, v, F, v.new_zeros(*shape, *stepper.inner_shape)

    def forward(
        self, parameters: Parameters, points: Tensor, progress: Progress | None, keep: bool
    ) -> tuple[Tensor, Tensor, Tensor, CudaRecord]:
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
        C = self._x0.new_zeros(frames if keep else 2, *shape[:2], *stepper.inner_shape)
        record = CudaRecord(self._substeps(parameters), C, failures=[None] * stepper.rollouts)
        x[0], v[0], F[0], C[0] = self._start(parameters, record.substeps)
        travel, course = self._travel(points), _Course(self._first_bounds(x[0], v[0]))
        for frame in range(frames - 1):
            now, after = (frame, frame + 1) if keep else (frame % 2, (frame + 1) % 2)
            start, end = ((x[f], v[f], F[f], C[c]) for f, c in ((frame, now), (frame + 1, after)))
            if keep and frame == 0:
                course.kept_frames = frames - 1
            self._advance(frame, start, end, points[frame : frame + 2], travel[frame], record, course)
            if progress is not None:
                progress(frame + 1, frames - 1)
            if all(record.failures):
                break
        for rollout, failure in enumerate(record.failures):
            if failure is not None:
                for states in (x, v, F):
                    states[failure.frame + 1 :, rollout] = torch.nan
        return x, v, F, record

    def play(self, parameters: Parameters, points: Tensor) -> Generator[State, Tensor, None]:
        """Yields the state of the one rollout and takes the controller points [C, 3] of the next frame time."""
        stepper = self.stepper
        given = self._start(parameters, self._substeps(parameters))
        states = [tuple(t.clone(memory_format=torch.contiguous_format) for t in given) for _ in range(2)]
        course, frame = _Course(self._first_bounds(*states[0][:2])), 0
        while True:
            start, end = states[frame % 2], states[(frame + 1) % 2]
            following = yield tuple(t[0] for t in start)
            both = torch.stack([points, following])[:, None]
            record = CudaRecord(stepper.substeps, start[3], failures=[None])
            travel = self._travel(both)[0]
            self._advance(frame, start, end, both.to(self._x0), travel, record, course)
            if record.failures[0] is not None:
                raise record.failures[0]
            points, frame = following, frame + 1

    def _advance(
        self,
        frame: int,
        start: State,
        end: State,
        points: Tensor,
        travel: Float[Array, " rollouts"],
        record: CudaRecord,
        course: _Course,
    ) -> None:
        """Run one frame of all rollouts in boxes large enough.

        Args:
            frame: its number.
            start, end: x, v, F, C [R, N, ...] at its start, and where those at its end go.
            points: controller points [m] at both ends, shape [2, R, C, 3].
            travel: how far the fastest controller point of each rollout goes [m].
            record: gets the frame's boxes and order, and failures.
            course: what the frame before left for this one.
        """
        stepper = self.stepper
        if frame % SORT_FRAMES == 0:
            stepper.use_order(stepper.cell_order(start[0]), adjoints=False)
            course.moved = True
        margins = margin_of(1.0 / self.config.fps, self._gravity, stepper.cell, course.bounds[:, 6], travel)
        for attempt in range(ATTEMPTS):
            nodes, box = self._place(frame, start[1], course.bounds, margins, record)
            kept = self._room(frame, nodes, record, course)
            stepper.start_frame(box, points.transpose(0, 1), kept)
            if course.moved or attempt or kept is not None:
                stepper.set_state(*start)
            stepper.forward(kept is not None)
            stepper.write_state(end, kept is not None)
            report = stepper.report()
            again = self._judge(frame, report[:, :2], record, attempt == ATTEMPTS - 1)
            if not again.any():
                break
            margins = np.where(again, larger(margins, stepper.cell), margins)
        record.boxes.append((nodes, box))
        record.orders.append(stepper.order)
        failed = [r for r, failure in enumerate(record.failures) if failure is not None and failure.frame == frame]
        if failed:
            end[0][failed] = torch.nan  # which keeps them out of every grid from here on
        course.bounds, course.moved = bounds(report), bool(failed) or kept is not None

    def _room(self, frame: int, nodes: int, record: CudaRecord, course: _Course) -> int | None:
        """Make room for the frame; its number among the kept ones, None if it is not kept."""
        stepper = self.stepper
        if frame == 0:
            stepper.release(nodes)
        if frame == 0 and course.kept_frames:
            record.kept = stepper.keep_frames(record, course.kept_frames, nodes)
        course.moved |= stepper.reserve(2, nodes)  # where that moves arrays, nothing is held any more
        return frame if frame < record.kept and stepper.holder is record else None

    def _travel(self, points: Tensor) -> Float[Array, "frames rollouts"]:
        """How far the fastest controller point goes in each frame [m]."""
        if points.shape[2] == 0 or len(points) < 2:
            return np.zeros((len(points), points.shape[1]))
        return (points[1:] - points[:-1]).norm(dim=-1).amax(-1).double().cpu().numpy()

    def _first_bounds(self, x: Tensor, v: Tensor) -> Float[Array, "rollouts 7"]:
        """`report.bounds` of a state [R, N, 3] that no frame has reported on."""
        ahead = torch.add(x, v, alpha=1.0 / self.config.fps)
        seen = [torch.minimum(x, ahead).amin(1), torch.maximum(x, ahead).amax(1), v.norm(dim=2).amax(1, keepdim=True)]
        return torch.cat(seen, 1).double().cpu().numpy()

    def _place(
        self,
        frame: int,
        v: Tensor,
        motion: Float[Array, "rollouts 7"],
        margins: Float[Array, " rollouts"],
        record: CudaRecord,
    ) -> tuple[int, Tensor]:
        """Nodes of a rollout and boxes [R, 6] of one shape; a rollout that needs too large a one has failed."""
        stepper = self.stepper
        first, count = box_corners(motion[:, :3], motion[:, 3:6], margins, stepper.cell, stepper.offset)
        fits = self._fitting(count)
        for rollout, failure in enumerate(record.failures):
            if failure is None and not fits[rollout]:
                particle = int(v[rollout].norm(dim=1).argmax())
                alone = small_enough(count[rollout], largest_box(stepper.particles))
                what = f"{stepper.rollouts} rollouts are too many for so large a box" if alone else "the body runs away"
                record.failures[rollout] = SimulationError(what, frame=frame, substep=0, particle=particle)
            fits[rollout] &= record.failures[rollout] is None
        if not fits.any():
            first, count, fits = np.zeros_like(first), np.full_like(count, 3.0), np.ones_like(fits)
        rows = np.empty((len(first), 6), dtype=np.int32)
        rows[:, :3] = np.where(fits[:, None], first, first[fits][0])
        rows[:, 3:] = count[fits].max(0)
        if self._box_rows is None or not np.array_equal(rows, self._box_rows):
            self._box_rows, self._box = rows, torch.tensor(rows, device=self._x0.device)
        return int(rows[0, 3:].prod()), self._box

    def _fitting(self, count: Float[Array, "rollouts 3"]) -> np.ndarray:
        """Whose boxes are small enough, shape [R], also for the one shape that all of them get: the largest do not fit."""
        fits = small_enough(count, self._largest)
        while fits.any() and count[fits].max(0).prod() > self._largest:
            fits[np.where(fits, count.prod(1), 0.0).argmax()] = False
        return fits

    def _judge(self, frame: int, keys: Int[Array, "rollouts 2"], record: CudaRecord, last: bool) -> np.ndarray:
        """Put down which rollouts have failed; returns whose particles only need a larger box, shape [R]."""
        again = np.zeros(len(keys), dtype=bool)
        if (keys == _NONE).all():
            return again
        for rollout, (outside, not_finite) in enumerate(keys):
            if record.failures[rollout] is not None or min(outside, not_finite) == _NONE:
                continue
            key, what = outside, "a particle left the grid"
            if not_finite != _NONE:
                key, what = not_finite, "the state is not finite"
            elif not last:
                again[rollout] = True
                continue
            substep, particle = divmod(int(key), self.stepper.particles)
            record.failures[rollout] = SimulationError(what, frame=frame, substep=substep, particle=particle)
        return again

    # --- backward -----------------------------------------------------------------------------------------------

    def backward(
        self,
        parameters: Parameters,
        record: CudaRecord,
        points: Tensor,
        states: tuple[Tensor, Tensor, Tensor],
        bars: Bars,
        progress: Progress | None,
    ) -> dict[str, Tensor]:
        """Gradients by parameter name, with an axis of rollouts, and of `points` as "controllers" if they ask for it.

        Frames after a rollout's failure have none.
        """
        stepper, frames = self.stepper, len(points)
        stepper.load_parameters(parameters, record.substeps)
        held = stepper.holder is record
        if not held and record.boxes:
            stepper.reserve(record.substeps + 1, max(nodes for nodes, _ in record.boxes))
        stepper.clear_adjoints()
        bars = self._before_failures(bars, record)
        last = min(last_frame(bars), len(record.boxes))
        if last:
            stepper.use_order(record.orders[last - 1], adjoints=False)
        self._inject(bars, last)
        led, points_bar = points.requires_grad, torch.zeros_like(points)
        for frame in reversed(range(last)):
            kept = frame if held and frame < record.kept else None
            stepper.use_order(record.orders[frame], adjoints=True)
            stepper.start_frame(record.boxes[frame][1], points[frame : frame + 2].transpose(0, 1), kept)
            if kept is None:
                stepper.set_state(*(state[frame] for state in (*states, record.C)))
                stepper.forward(keep=True)
            for rollout, failure in enumerate(record.failures):
                if failure is not None and failure.frame <= frame:
                    stepper.void(rollout)
            stepper.backward(led)
            if led:
                bar = stepper.controllers_adjoint().transpose(0, 1)
                points_bar[frame : frame + 2, :, : points.shape[2]] += bar[:, :, : points.shape[2]]
            self._inject(bars, frame)
            if progress is not None:
                progress(frames - 1 - frame, frames - 1)
        return stepper.gradients() | ({"controllers": points_bar} if led else {})

    def _before_failures(self, bars: Bars, record: CudaRecord) -> Bars:
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

    def _inject(self, bars: Bars, frame: int) -> None:
        self.stepper.add_adjoints(*(None if bar is None else bar[frame] for bar in bars))
