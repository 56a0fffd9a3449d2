"""One frame of substeps of many rollouts of one body at once, forward and adjoint, as CUDA graphs.

Particles are in the order of their cells; states and gradients are given and taken in the caller's order. The kernels run on the
CPU too, launch by launch, for the tests.
"""

import math
import os
from collections.abc import Callable, Sequence

import numpy as np
import torch
import warp as wp

from physreal_core.array_types import Array, Int, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, Tool
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.launches import FrameLaunches, Launches
from physreal_core.simulation.cuda.parts import NODE_THREADS
from physreal_core.simulation.cuda.thin_launches import ThinLaunches
from physreal_core.simulation.cuda.thin_model import ThinModel
from physreal_core.simulation.cuda.volume_model import VolumeModel
from physreal_core.simulation.lattice import particle_order
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.stepper import Span, State

KEPT_SHARE = 0.25
"""Share of a GPU's memory for frames whose substeps are kept for the backward pass. 20 frames of 50 substeps of 20 000
particles take 1.3 GB; images and networks of a fit want the rest. On the CPU nothing is kept."""
CARD_SHARE = "PHYSREAL_CARD_SHARE"
"""Environment variable: share of a GPU that this process may use, 1 by default. Half of it goes to kept frames at most."""
MOST_NUMBERS = 2**31 - 1  # threads for the nodes of all rollouts, and parts that particles leave, are 32-bit integers
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

    Raises:
        InputError: nodes and parts of so many rollouts cannot be counted.
    """

    in_step = True

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        tool: Tool | None = None,
        solids: Solids | None = None,
        rollouts: int = 1,
    ) -> None:
        self.dtype, self.device = config.torch_dtype, config.device
        self.particles, self.rollouts = len(body.x0), rollouts
        self._thin = body.elements is not None
        self.model = (ThinModel if self._thin else VolumeModel)(
            body, config, grip, clamps, loads, tool, solids, rollouts
        )
        self._contact = self.model.contact
        self.shapes, self.state_shapes, self.lattice = self.model.shapes, self.model.state_shapes, self.model.lattice
        if rollouts * max(NODE_THREADS * self.lattice.nodes, 27 * self.particles) > MOST_NUMBERS:
            raise InputError(
                f"{rollouts} rollouts of {self.particles} particles and {self.lattice.nodes} nodes",
                where="Simulator.rollout_batch",
                expected="fewer at once",
            )
        self.substeps = self.slots = self.kept_slots = 0
        self.kept_bytes = 0 if self.device == "cpu" else kept_bytes_of(self.device)
        self.holder: object | None = None
        self.order = self._cell_order(body)
        self._report = torch.zeros(rollouts, dtype=torch.int64, device=self.device)
        self._first = torch.zeros(1, dtype=torch.int32, device=self.device)
        self._slot = 0
        self._weighed = False  # whether the nodes know what is around them
        self._fresh = True  # whether the state has to be put in anew
        self._launches: Launches | None = None
        self._graphs: dict[tuple[str, int, int], wp.Graph] = {}
        self._lists: dict[int, int] = {}  # by frame, substeps from one list of pairs that touch to the next

    def _cell_order(self, body: Body) -> Tensor:
        """Order of the particles by columns of cells, rollout by rollout, shape [P]; the vertices of a thin body stay as they are."""
        firsts = self.particles * np.arange(self.rollouts)[:, None]
        return torch.as_tensor((particle_order(body, self.lattice) + firsts).ravel(), device=self.device)

    # --- memory -------------------------------------------------------------------------------------------------

    def frame_bytes(self) -> int:
        """Bytes of a kept frame: the state of a particle, and 4 numbers a node, for each substep."""
        own = sum(map(math.prod, self.state_shapes.values()))
        numbers = self.rollouts * (own * self.particles + 4 * self.lattice.nodes)
        return (self.substeps + 1) * numbers * self.dtype.itemsize

    def keep_frames(self, holder: object, frames: int) -> int:
        """Make room to keep as many of a rollout's frames as `kept_bytes` allows; who held frames loses them.

        Args:
            holder: the rollout.
            frames: how many there are.

        Returns:
            How many will be kept: fewer where others have taken the memory.
        """
        kept = min(frames, self.kept_bytes // self.frame_bytes())
        self.holder, self.kept_slots = None, 0
        while True:
            slots = kept * (self.substeps + 1)
            try:
                self.reserve(slots + (2 if kept == frames else self.substeps + 1))
                break
            except torch.OutOfMemoryError:
                if not kept:
                    raise
                kept //= 2
        if kept:
            self.holder, self.kept_slots = holder, slots
        return kept

    def reserve(self, working: int) -> bool:
        """Make room for `working` slots; whether arrays moved, and all states are lost."""
        if self.kept_slots + working <= self.slots:
            return False
        self.holder, self.kept_slots = None, 0
        if working > self.slots:
            self._launches = None
            self._graphs.clear()
            self.slots = 0
            kind = ThinLaunches if self._thin else FrameLaunches
            self._launches = kind(self.model, working, self._first, self._report)
            self.slots = working
        return True

    # --- rollouts -----------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: Sequence[int]) -> None:
        """Take over parameters (complete, with an axis of rollouts) and the number of substeps in a frame, the same for all."""
        self.substeps = substeps[0]
        self.model.load(parameters, self.substeps)
        self.model.sort(self.order)
        self._weighed = False

    def forward(self, span: Span, start: State, end: State, carries_on: bool) -> Int[Array, " rollouts"]:
        """All substeps of a frame, from `start` to `end`; see `stepper.Stepper`."""
        self._fresh |= not carries_on
        self._fresh |= self.reserve(2)  # where that moves arrays, nothing is held any more
        kept = span.kept if self.holder is not None else None
        self._start_frame(span, kept)
        if self._fresh or kept is not None:
            self._launches.set_state(start, self._slot, self.order)
        kept = self._run_forward(span, start, kept)
        self._launches.write_state(end, self._slot + (self.substeps if kept is not None else 0), self.order)
        self._fresh = kept is not None
        return self._report.cpu().numpy()

    def _run_forward(self, span: Span, start: State, kept: int | None) -> int | None:
        """Run the frame's substeps, again where the lists of pairs that touch did not do; whether and where the frame is still kept."""
        if self._contact is not None:
            self._contact.list_less_often()
        self._run_substeps(kept is not None)
        while self._contact is not None:
            grown, too_far = self._contact.grow(), self._contact.list_more_often()
            if grown:  # the pairs are elsewhere, which all launches have to know
                self.slots, self.kept_slots, self.holder, kept = 0, 0, None, None
                self.reserve(2)
                self._start_frame(span, None)
            elif not too_far:
                self._lists[span.frame] = self._contact.every
                break
            self._launches.set_state(start, self._slot, self.order)
            self._run_substeps(kept is not None)
        return kept

    def _run_substeps(self, keep: bool) -> None:
        self._run(f"forward, keep={keep}", lambda: self._launches.forward(self.substeps, keep))

    def _start_frame(self, span: Span, kept: int | None) -> None:
        """Choose the slots: those of a kept frame, else the working ones; and put in what differs between frames."""
        slot = self.kept_slots if kept is None else kept * (self.substeps + 1)
        if slot != self._slot:
            self._first.fill_(slot)
            self._slot = slot
        if self.model.hold(span):
            self.model.sort(self.order)
            self._weighed = False
        if not self._weighed and not self._thin:
            self._run("weigh", self._launches.weigh)
            self._weighed = True
        self.model.hand.place(span.points)

    def _run(self, name: str, launches: Callable[[], None]) -> None:
        """Launch one by one on the CPU, on a GPU as a CUDA graph captured when first needed."""
        if self.device == "cpu":
            launches()
            return
        key = (name, self.substeps, self._contact.every if self._contact else 0)
        if key not in self._graphs:
            if len(self._graphs) >= GRAPHS:
                self._graphs.pop(next(iter(self._graphs)))
            with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
                launches()
            self._graphs[key] = capture.graph
        wp.capture_launch(self._graphs[key])

    # --- adjoints -----------------------------------------------------------------------------------------------

    def begin_backward(self, frames: int, held: bool) -> None:
        """Make room, and set all adjoints to zero."""
        if not held and frames:
            self.reserve(self.substeps + 1)
        self.model.clear_bars()

    def add_adjoints(self, bars: dict[str, Tensor]) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...], by name."""
        for name, bar in bars.items():
            self.model.state_bars[name] += bar.flatten(0, 1)[self.order]

    def backward(self, span: Span, start: State, led: bool) -> Tensor | None:
        """Adjoint of a frame; see `stepper.Stepper`."""
        self._start_frame(span, span.kept)
        launches, self._fresh = self._launches, True
        if self._contact is not None:
            self._contact.every = self._lists[span.frame]
        if span.kept is None:
            launches.set_state(start, self._slot, self.order)
            self._run_substeps(True)
            while self._contact is not None and self._contact.list_more_often():  # of a rollout since then
                launches.set_state(start, self._slot, self.order)
                self._run_substeps(True)
        launches.recall(start)
        for rollout in np.flatnonzero(~span.alive):
            launches.void(rollout, slice(self._slot, self._slot + self.substeps + 1))
        launches.prepare_backward(led)
        self.model.hand.controllers_bar.zero_()
        self._run(f"backward, controllers={led}", lambda: launches.backward(self.substeps, led))
        if self._contact is not None:
            self._contact.check()
        return self.model.hand.controllers_bar.transpose(0, 1) if led else None

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]."""
        return self.model.nodes_adjoint()

    def lengths_adjoint(self) -> Tensor:
        """Derivative of the loss by the lengths of the bonds, in the grip's order, [R, B]."""
        return self.model.hand.lengths_adjoint()

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
        return self.model.gradients()
