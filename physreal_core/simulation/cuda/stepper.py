"""One frame of substeps of many rollouts of one body at once, forward and adjoint, as CUDA graphs.

It offers what `stepper.Stepper` does with a leading axis of rollouts on every array, and more: the order of particles,
and frames that are kept. Rollouts, states and gradients are given and taken in the caller's order. The kernels run on the
CPU too, launch by launch, for the tests.
"""

import os

import torch
import warp as wp

from physreal_core.array_types import Array, Int
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad
from physreal_core.simulation.box import LARGEST_EDGE, lattice_offset
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.launches import FrameLaunches
from physreal_core.simulation.cuda.model import BodyModel
from physreal_core.simulation.cuda.report import COLUMNS
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.scalars import scalar_types
from physreal_core.simulation.terms import inner_shape

KEPT_SHARE = 0.25
"""Share of a GPU's memory for frames whose substeps are kept for the backward pass. 20 frames of 50 substeps of 20 000
particles take 3 GB; images and networks of a fit want the rest. On the CPU nothing is kept."""
CARD_SHARE = "PHYSREAL_CARD_SHARE"
"""Environment variable: share of a GPU that this process may use, 1 by default. Half of it goes to kept frames at most."""
LARGEST_STRIDE = 2**31 - 1  # bytes from one slot to the next: Warp's arrays have them as 32-bit integers
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
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        order: the caller's number (rollout x particles + particle) of each particle, shape [P].
        kept_bytes: memory that kept frames may take.
        most_nodes: of a rollout's box, so that all fit into arrays.
        inner_shape: of what a particle carries beside x, v and F, see `terms.inner_shape`.
        holder: whose frames are kept; None if nobody's.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        rollouts: int = 1,
    ) -> None:
        self.types, self.device = scalar_types(config.dtype), config.device
        self.particles, self.rollouts, self.cell = len(body.x0), rollouts, body.cell
        self.offset = lattice_offset(body, config.ground_height, clamps)
        self.model = BodyModel(body, config, grip, clamps, loads, rollouts, self.offset)
        self.shapes, self.inner_shape = self.model.shapes, inner_shape(config.terms)
        self.substeps = self.slots = self.nodes = self.kept_slots = 0
        self.kept_bytes = 0 if self.device == "cpu" else kept_bytes_of(self.device)
        self.most_nodes = int(LARGEST_STRIDE / (NODE_RESERVE * 4 * self.types.torch_dtype.itemsize * rollouts))
        self.holder: object | None = None
        self.order = torch.arange(rollouts * self.particles, device=self.device)
        self._report = torch.zeros(rollouts, COLUMNS, dtype=torch.int64, device=self.device)
        self._first = torch.zeros(1, dtype=torch.int32, device=self.device)
        self._slot = 0
        self._placed: tuple[int, torch.Tensor | None] = (0, None)  # slot and boxes that the device knows
        self._launches: FrameLaunches | None = None
        self._graphs: dict[tuple[str, int], wp.Graph] = {}
        self._lattice = torch.as_tensor(self.offset, dtype=self.types.torch_dtype, device=self.device)

    # --- memory -------------------------------------------------------------------------------------------------

    def frame_bytes(self, nodes: int) -> int:
        """Bytes of a kept frame: 24 numbers a particle, what it carries besides, and 4 a node, for each substep."""
        own = 24 + 3 * self.inner_shape[0]
        numbers = self.rollouts * (own * self.particles + 4 * max(int(NODE_RESERVE * nodes), self.nodes))
        return (self.substeps + 1) * numbers * self.types.torch_dtype.itemsize

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """Make room to keep as many of a rollout's frames as `kept_bytes` allows; who held frames loses them.

        Args:
            holder: the rollout.
            frames: how many there are.
            nodes: nodes of the first frame's box.

        Returns:
            How many will be kept: fewer where others have taken the memory.
        """
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

    def release(self, nodes: int) -> None:
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
        node_bars = self._node_bars()  # a backward pass may be under way
        self._forget()
        self._launches = FrameLaunches(self.model, slots, nodes, self._first, self._report.view(-1))
        self.slots, self.nodes = slots, nodes
        for name, bar in node_bars.items():
            self._launches.node_bars[name].unflatten(0, (self.rollouts, -1))[:, 0] = bar
        return True

    # --- one rollout --------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters (complete, with an axis of rollouts) and the number of substeps in a frame."""
        self.substeps = substeps
        self.model.load(parameters, substeps)
        self.model.sort(self.order)

    def cell_order(self, x: torch.Tensor) -> torch.Tensor:
        """Order of the particles by columns of cells, rollout by rollout, shape [P]; x is [R, N, 3]."""
        cells = ((x.reshape(self.rollouts, -1, 3) - self._lattice) / self.cell - 0.5).floor()
        cells = (cells - cells.amin(1, keepdim=True)).nan_to_num().clamp(0, LARGEST_EDGE).int()
        key = (cells[..., 0] * (LARGEST_EDGE + 1) + cells[..., 1]) * (LARGEST_EDGE + 1) + cells[..., 2]
        places = torch.argsort(key, dim=1, stable=True)
        return (places + self.particles * torch.arange(self.rollouts, device=self.device)[:, None]).flatten()

    def use_order(self, order: torch.Tensor, adjoints: bool) -> None:
        """Sort parameters and, if they are in use, adjoints; the state has to be put in again."""
        if order is self.order:
            return
        if adjoints:
            place = torch.empty_like(order)
            place[self.order] = torch.arange(len(order), device=self.device)
            self.model.sort_bars(place[order])
        self.model.sort(order)
        self.order = order

    def start_frame(self, box: torch.Tensor, controllers: torch.Tensor, kept: int | None) -> None:
        """Place the grids and choose the slots.

        Args:
            box: origin and count of each rollout's nodes, shape [R, 6], int32; `reserve` has made room.
            controllers: controller points [m] at both ends of the frame, shape [R, 2, C, 3].
            kept: number of the frame among the kept ones; None for the working slots.
        """
        self._slot = self.kept_slots if kept is None else kept * (self.substeps + 1)
        if self._slot != self._placed[0]:
            self._first.fill_(self._slot)
        if box is not self._placed[1]:
            self.model.box.copy_(box)
        self._placed = self._slot, box
        if self.model.gripped:
            self.model.controllers.copy_(controllers[:, :, : self.model.controllers.shape[2]])

    def set_state(self, x: torch.Tensor, v: torch.Tensor, F: torch.Tensor, C: torch.Tensor) -> None:
        """Put in the state at the frame's start, each [R, N, ...]."""
        for name, value in (("x", x), ("v", v), ("F", F), *self._inner(C)):
            torch.index_select(value.flatten(0, 1), 0, self.order, out=self._launches.states[name][self._slot])

    def write_state(self, out: tuple[torch.Tensor, ...], keep: bool) -> None:
        """Write the state at the frame's end to x, v, F, C, each contiguous [R, N, ...]."""
        slot = self._slot + (self.substeps if keep else 0)
        x, v, F, C = out
        for name, target in (("x", x), ("v", v), ("F", F), *self._inner(C)):
            target.flatten(0, 1).index_copy_(0, self.order, self._launches.states[name][slot])

    def _inner(self, C: torch.Tensor) -> list[tuple[str, torch.Tensor]]:
        """Affine velocity and, with viscosity, mean rate of deformation as views of [R, N, 3 or 6, 3]."""
        return list(zip(("C", "rate"), C.split(3, dim=-2), strict=False))

    def void(self, rollout: int) -> None:
        """Take a rollout out of the kept frame, so that its adjoint is zero."""
        n, slots = self.particles, slice(self._slot, self._slot + self.substeps + 1)
        self._launches.states["x"][slots, rollout * n : (rollout + 1) * n] = torch.nan
        self._launches.momentum[slots, rollout * self.nodes : (rollout + 1) * self.nodes] = 0.0

    def forward(self, keep: bool) -> None:
        """All substeps of the frame; with `keep` everything that `backward` needs stays."""
        launches = self._launches
        self._run(f"forward, keep={keep}", lambda: launches.forward(self.substeps, keep))

    def report(self) -> Int[Array, "rollouts 9"]:
        """Wait for the frame, and what there is to know of it, see `report`."""
        return self._report.cpu().numpy()

    def backward(self, controllers: bool) -> None:
        """Adjoint of the kept frame: the state's adjoints go from its end to its start; the parameters' grow.

        With `controllers`, `controllers_adjoint` has that of the controller points then.
        """
        launches = self._launches
        launches.prepare_backward(controllers)
        if controllers:
            self.model.controllers_bar.zero_()
        self._run(f"backward, controllers={controllers}", lambda: launches.backward(self.substeps, controllers))

    def controllers_adjoint(self) -> torch.Tensor:
        """Adjoint of the controller points of the frame that `backward` went through last, shape [R, 2, C, 3]."""
        return self.model.controllers_bar

    def _run(self, name: str, launches) -> None:
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

    def clear_adjoints(self) -> None:
        """Set all adjoints to zero."""
        self.model.clear_bars()
        if self._launches is not None:
            for bar in self._launches.node_bars.values():
                bar.zero_()

    def add_adjoints(self, x_bar: torch.Tensor | None, v_bar: torch.Tensor | None, F_bar: torch.Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...]."""
        for name, bar in (("x", x_bar), ("v", v_bar), ("F", F_bar)):
            if bar is not None:
                self.model.bars[name] += bar.flatten(0, 1)[self.order]

    def gradients(self) -> dict[str, torch.Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
        return self.model.gradients(self.order, self._node_bars())

    def _node_bars(self) -> dict[str, torch.Tensor]:
        """Adjoints by name of what acts on nodes, each [R, ...]."""
        if self._launches is None:
            return {
                name: torch.zeros(self.rollouts, *size).to(self._lattice)
                for name, size in self.model.node_shapes.items()
            }
        return {name: bar.unflatten(0, (self.rollouts, -1)).sum(1) for name, bar in self._launches.node_bars.items()}
