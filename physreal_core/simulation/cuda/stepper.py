"""One frame of substeps of many rollouts of one body at once, forward and adjoint, as CUDA graphs.

Particles are put in the order of their cells now and then; states and gradients are given and taken in the caller's order. The
kernels run on the CPU too, launch by launch, for the tests.
"""

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import torch
import warp as wp

from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad
from physreal_core.simulation.box import LARGEST_EDGE, largest_box, lattice_offset, small_enough
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.launches import FrameLaunches
from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.particle_rows import NODE_SUMS
from physreal_core.simulation.stepper import Report, Span, State, state_shapes

KEPT_SHARE = 0.25
"""Share of a GPU's memory for frames whose substeps are kept for the backward pass. 20 frames of 50 substeps of 20 000
particles take 3 GB; images and networks of a fit want the rest. On the CPU nothing is kept."""
CARD_SHARE = "PHYSREAL_CARD_SHARE"
"""Environment variable: share of a GPU that this process may use, 1 by default. Half of it goes to kept frames at most."""
MOST_NODES = 2**31 - 1  # of all rollouts: threads count them as 32-bit integers
REPORT_COLUMNS = 9  # of report.h
SORT_FRAMES = 32
"""Frames after which particles are put in the order of their cells again. On an H200 sorting every frame costs 20 000
particles a third of their speed and a million 4 %; an elastic body's order stays good, one that flows loses it slowly."""
NODE_RESERVE = 1.2  # boxes grow as a body deforms, and new arrays mean new graphs
ROOMY = 16  # arrays for boxes of so many times the nodes are given back when a rollout begins
GRAPHS = 12  # kept at once; each number of substeps needs up to four


def kept_bytes_of(device: str) -> int:
    """Memory of a GPU for kept frames.

    Raises:
        InputError: `CARD_SHARE` is no share.
    """
    given = os.environ.get(CARD_SHARE, "1")
    try:
        share = float(given)
    except ValueError:
        share = 0.0
    if not 0.0 < share <= 1.0:
        raise InputError(f"{given!r} is no share of a GPU", where=CARD_SHARE, expected="a number above 0 and at most 1")
    return int(min(KEPT_SHARE, 0.5 * share) * torch.cuda.get_device_properties(device).total_memory)


class CudaStepper:
    """Arrays, launches and graphs of `rollouts` copies of a body.

    State arrays are [slots, P, ...] with P = rollouts x particles. A kept frame takes `substeps + 1` slots, slot s for
    the state after s substeps; behind the kept frames lie the working slots, for all other frames.

    Attributes:
        order: the caller's number (rollout x particles + particle) of each particle, shape [P].
        kept_bytes: memory that kept frames may take.
        most_nodes: of a rollout's box, so that the nodes of all can be counted.
    """

    in_step = True

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        rollouts: int = 1,
    ) -> None:
        self.dtype, self.device = config.torch_dtype, config.device
        self.particles, self.rollouts, self.cell = len(body.x0), rollouts, body.cell
        self.offset = lattice_offset(body, config.ground_height, clamps)
        self.model = BodyModel(body, config, grip, clamps, loads, rollouts, self.offset)
        self.shapes, self.viscous, self.branches = self.model.shapes, self.model.viscous, self.model.branches
        self.substeps = self.slots = self.nodes = self.kept_slots = 0
        self.kept_bytes = 0 if self.device == "cpu" else kept_bytes_of(self.device)
        self.most_nodes = int(MOST_NODES / (NODE_RESERVE * rollouts))
        self.holder: object | None = None
        self.order = torch.arange(rollouts * self.particles, device=self.device)
        self._report = torch.zeros(rollouts, REPORT_COLUMNS, dtype=torch.int64, device=self.device)
        self._first = torch.zeros(1, dtype=torch.int32, device=self.device)
        self._slot = 0
        self._boxes: np.ndarray | None = None  # that the device knows
        self._fresh = True  # whether the state has to be put in anew
        self._launches: FrameLaunches | None = None
        self._graphs: dict[tuple[str, int], wp.Graph] = {}
        self._lattice = torch.as_tensor(self.offset, dtype=self.dtype, device=self.device)

    # --- memory -------------------------------------------------------------------------------------------------

    def frame_bytes(self, nodes: int) -> int:
        """Bytes of a kept frame: the state of a particle, and 4 numbers a node, for each substep."""
        own = sum(math.prod(shape) for shape in state_shapes(self.viscous, self.branches).values())
        numbers = self.rollouts * (own * self.particles + 4 * max(int(NODE_RESERVE * nodes), self.nodes))
        return (self.substeps + 1) * numbers * self.dtype.itemsize

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """Make room to keep as many of a rollout's frames as `kept_bytes` allows; who held frames loses them.

        Args:
            holder: the rollout.
            frames: how many there are.
            nodes: nodes of the first frame's box.

        Returns:
            How many will be kept: fewer where others have taken the memory.
        """
        self._release(nodes)
        kept = min(frames, self.kept_bytes // self.frame_bytes(nodes))
        self.holder, self.kept_slots = None, 0
        while True:
            slots = kept * (self.substeps + 1)
            try:
                self.reserve(slots + (2 if kept == frames else self.substeps + 1), nodes)
                break
            except torch.OutOfMemoryError:
                if not kept:
                    raise
                kept //= 2
        if kept:
            self.holder, self.kept_slots = holder, slots
        return kept

    def _release(self, nodes: int) -> None:
        """Give back arrays for boxes many times as large as `nodes` nodes: a rollout before this one nearly ran away."""
        if self.nodes > ROOMY * nodes:
            self._forget()

    def _forget(self) -> None:
        self.holder, self._launches = None, None
        self.kept_slots = self.slots = self.nodes = 0
        self._graphs.clear()

    def reserve(self, working: int, nodes: int) -> bool:
        """Make room for `working` slots and for boxes of so many nodes; whether arrays moved, and all states are lost."""
        if self.kept_slots + working <= self.slots and nodes <= self.nodes:
            return False
        self.holder, self.kept_slots = None, 0
        if working <= self.slots and nodes <= self.nodes:
            return True
        slots, nodes = max(self.slots, working), int(NODE_RESERVE * nodes) if nodes > self.nodes else self.nodes
        node_sums = self._node_sums()  # a backward pass may be under way
        self._forget()
        self._launches = FrameLaunches(self.model, slots, nodes, self._first, self._report)
        self.slots, self.nodes = slots, nodes
        self._launches.node_sums.unflatten(1, (self.rollouts, -1))[:, :, 0] = node_sums.T
        return True

    def fitting(self, count: Float[Array, "rollouts 3"]) -> tuple[Bool[Array, " rollouts"], Float[Array, "rollouts 3"]]:
        """Whose boxes are small enough, also for the one shape that all of them get: the largest do not fit."""
        largest = min(largest_box(self.particles), self.most_nodes)
        fits = small_enough(count, largest)
        while fits.any() and count[fits].max(0).prod() > largest:
            fits[np.where(fits, count.prod(1), 0.0).argmax()] = False
        return fits, np.broadcast_to(count[fits].max(0) if fits.any() else np.full(3, 3.0), count.shape)

    # --- rollouts -----------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: Sequence[int]) -> None:
        """Take over parameters (complete, with an axis of rollouts) and the number of substeps in a frame, the same for all."""
        self.substeps = substeps[0]
        self.model.load(parameters, self.substeps)
        self.model.sort(self.order)

    def forward(self, span: Span, start: State, end: State, carries_on: bool) -> tuple[Report, Span]:
        """All substeps of a frame, from `start` to `end`; see `stepper.Stepper`."""
        self._fresh |= not carries_on
        if span.frame == 0:
            self._release(span.nodes)
        if span.frame % SORT_FRAMES == 0:
            self._use_order(self.cell_order(start.x), adjoints=False)
        self._fresh |= self.reserve(2, span.nodes)  # where that moves arrays, nothing is held any more
        kept = span.kept if self.holder is not None else None
        self._start_frame(span, kept)
        if self._fresh or kept is not None:
            self._set_state(start)
        self._run(f"forward, keep={kept is not None}", lambda: self._launches.forward(self.substeps, kept is not None))
        self._write_state(end, kept is not None)
        self._fresh = kept is not None
        return self._read_report(), replace(span, order=self.order)

    def _read_report(self) -> Report:
        """Wait for the frame, and what there is to know of it."""
        found = self._report.cpu().numpy()
        keys = found[:, 2:]
        values = np.where(keys < 0, keys ^ np.int64((1 << 63) - 1), keys).view(np.float64)
        return Report(found[:, :2], -values[:, :3], values[:, 3:6], values[:, 6])

    def cell_order(self, x: torch.Tensor) -> torch.Tensor:
        """Order of the particles by columns of cells, rollout by rollout, shape [P]; x is [R, N, 3]."""
        cells = ((x.reshape(self.rollouts, -1, 3) - self._lattice) / self.cell - 0.5).floor()
        cells = (cells - cells.amin(1, keepdim=True)).nan_to_num().clamp(0, LARGEST_EDGE).int()
        key = (cells[..., 0] * (LARGEST_EDGE + 1) + cells[..., 1]) * (LARGEST_EDGE + 1) + cells[..., 2]
        places = torch.argsort(key, dim=1, stable=True)
        return (places + self.particles * torch.arange(self.rollouts, device=self.device)[:, None]).flatten()

    def _use_order(self, order: torch.Tensor, adjoints: bool) -> None:
        """Sort parameters and, if they are in use, adjoints; the state has to be put in again."""
        if order is self.order:
            return
        if adjoints:
            place = torch.empty_like(order)
            place[self.order] = torch.arange(len(order), device=self.device)
            self.model.sort_bars(place[order])
        self.model.sort(order)
        self.order, self._fresh = order, True

    def _start_frame(self, span: Span, kept: int | None) -> None:
        """Place the grids and choose the slots: those of a kept frame, else the working ones."""
        slot = self.kept_slots if kept is None else kept * (self.substeps + 1)
        if slot != self._slot:
            self._first.fill_(slot)
            self._slot = slot
        if self._boxes is None or not np.array_equal(span.boxes, self._boxes):
            self.model.box.copy_(torch.from_numpy(span.boxes))
            self._boxes = span.boxes
        if self.model.gripped:
            points = self.model.controllers.shape[2]
            self.model.controllers.copy_(span.points[:, :, :points].transpose(0, 1))

    def _set_state(self, state: State) -> None:
        """Put in the state at the frame's start."""
        for name, value in state.named().items():
            torch.index_select(value.flatten(0, 1), 0, self.order, out=self._launches.states[name][self._slot])

    def _write_state(self, out: State, keep: bool) -> None:
        """Write the state at the frame's end."""
        slot = self._slot + (self.substeps if keep else 0)
        for name, target in out.named().items():
            target.flatten(0, 1).index_copy_(0, self.order, self._launches.states[name][slot])

    def _void(self, rollout: int) -> None:
        """Take a rollout out of the kept frame, so that its adjoint is zero."""
        n, slots = self.particles, slice(self._slot, self._slot + self.substeps + 1)
        self._launches.states["x"][slots, rollout * n : (rollout + 1) * n] = torch.nan
        self._launches.momentum[slots, rollout * self.nodes : (rollout + 1) * self.nodes] = 0.0

    def _run(self, name: str, launches: Callable[[], None]) -> None:
        """Launch one by one on the CPU, on a GPU as a CUDA graph captured when first needed."""
        if self.device == "cpu":
            launches()
            return
        key = (name, self.substeps)
        if key not in self._graphs:
            if len(self._graphs) >= GRAPHS:
                self._graphs.pop(next(iter(self._graphs)))
            with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
                launches()
            self._graphs[key] = capture.graph
        wp.capture_launch(self._graphs[key])

    # --- adjoints -----------------------------------------------------------------------------------------------

    def begin_backward(self, spans: Sequence[Span], held: bool) -> None:
        """Make room, and set all adjoints to zero, in the order of the last frame's particles."""
        if not held and spans:
            self.reserve(self.substeps + 1, max(span.nodes for span in spans))
        self.model.clear_bars()
        if self._launches is not None:
            self._launches.node_sums.zero_()
        if spans:
            self._use_order(spans[-1].order, adjoints=False)

    def add_adjoints(self, x_bar: Tensor | None, v_bar: Tensor | None, F_bar: Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...]."""
        for name, bar in (("x", x_bar), ("v", v_bar), ("F", F_bar)):
            if bar is not None:
                self.model.state_bars[name] += bar.flatten(0, 1)[self.order]

    def backward(self, span: Span, start: State, led: bool) -> Tensor | None:
        """Adjoint of a frame; see `stepper.Stepper`."""
        self._use_order(span.order, adjoints=True)
        self._start_frame(span, span.kept)
        launches, self._fresh = self._launches, True
        if span.kept is None:
            self._set_state(start)
            self._run("forward, keep=True", lambda: launches.forward(self.substeps, True))
        for rollout in np.flatnonzero(~span.alive):
            self._void(rollout)
        launches.prepare_backward(led)
        self.model.controllers_bar.zero_()
        self._run(f"backward, controllers={led}", lambda: launches.backward(self.substeps, led))
        return self.model.controllers_bar.transpose(0, 1) if led else None

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
        return self.model.gradients(self.order, self._node_sums())

    def _node_sums(self) -> Float[Tensor, "rollouts sums"]:
        """Adjoints of what nodes of a rollout share."""
        if self._launches is None:
            return torch.zeros(self.rollouts, NODE_SUMS.count).to(self._lattice)
        return self._launches.node_sums.unflatten(1, (self.rollouts, -1)).sum(2).T
