"""Frames of substeps, forward and adjoint, as one call of vector C++ per thread (worker.h): one rollout by all threads, or
each of many by one."""

import ctypes
import math
from collections.abc import Sequence

import numpy as np
import torch
import warp as wp

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.cores import available_cores
from physreal_core.native import launch_on_threads
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, Tool, controller_count, load_forces
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.lattice import held_boxes, lattice_of, particle_order
from physreal_core.simulation.native.contacts import ContactArrays
from physreal_core.simulation.native.frame import FRAME, THIN_FRAME, WORKSPACE, frame_kernels
from physreal_core.simulation.parameters import Parameters, row_of
from physreal_core.simulation.particle_rows import NODE_SUMS, PARTICLE_SUMS, ParticleRows
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.step_layout import law_bits
from physreal_core.simulation.stepper import NOT_FAILED, Span, State, state_shapes
from physreal_core.simulation.thin.arrays import ElementArrays, SegmentArrays
from physreal_core.simulation.timestep import rate_memory
from physreal_core.simulation.touch import NEARLY, TOUCHING, touch_heights

NODE_ARRAYS = ("velocity", "node_bar", "carry")
BLOCK = 16  # particles; the widest block that a machine works on, to which rows of particles are filled up
PARTICLES_PER_THREAD = 256  # fewer are not worth the threads' meeting twice a substep
KEPT_BYTES = 2**28
"""Memory for grids of frames that stay for the backward pass: with them a frame's states need less than half of the time
that the frame took, since no stress is evaluated and nothing scattered again. A grid is a twelfth of the particles' states:
with 20 000 particles, 55 frames of 50 substeps fit."""


def _yield_address() -> int:
    """Address of the function that gives the core to another thread; 0 where there is none."""
    function = getattr(ctypes.CDLL(None), "sched_yield", None)
    return 0 if function is None else ctypes.cast(function, ctypes.c_void_p).value


class NativeStepper:
    """`Stepper` on the CPU. Particles are in the order of their cells; results are in the caller's.

    Args:
        body, config, grip, clamps, loads, tool, solids: as for `Simulator`.
        rollouts: R.
        threads: by default torch's number for one rollout, fewer for few particles, and all cores for many. The sums'
            order within a rollout, and with it the last digits, depend on how many share it.
        kept_bytes: memory for kept grids; `KEPT_BYTES` by default.
    """

    device = "cpu"
    in_step = False

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
        threads: int | None = None,
        kept_bytes: int | None = None,
    ) -> None:
        self.dtype, self.config, self.rollouts = config.torch_dtype, config, rollouts
        self.particles, self.lattice = len(body.x0), lattice_of(body, clamps)
        thin = body.elements is not None
        self.viscous = "viscosity" in config.terms
        self.state_shapes = state_shapes(config, body.elements)
        framed = thin and body.elements.framed
        if framed and rollouts == 1:
            self.threads = 1
        elif rollouts == 1:
            self.threads = min(threads or torch.get_num_threads(), max(1, self.particles // PARTICLES_PER_THREAD))
        else:
            self.threads = min(rollouts, threads or available_cores())
        self._sharing = self.threads if rollouts == 1 else 1  # threads of one rollout
        self._body, self._start = body, self._numbers(body.x0)
        self._kept_bytes = KEPT_BYTES if kept_bytes is None else kept_bytes
        self.slots = self._grid_numbers = self._measured = 0
        self.substeps: list[int] = []
        self.holder: object | None = None
        self._settled = self._weight_bar = torch.zeros(())
        self._kept: list[Tensor] = []
        wp.init()  # before tensors are wrapped for it
        self._kernels = frame_kernels(config, body.elements.element if thin else None)
        self._frames = np.zeros(rollouts, (THIN_FRAME if thin else FRAME).dtype(config.dtype))
        self._workspaces = np.zeros(1 if rollouts == 1 else self.threads, WORKSPACE.dtype(config.dtype))
        self._held: dict[str, Tensor] = {}
        self._set_controllers(grip, tool)
        if solids is not None:
            self._give(self._frames, "solid_distance", self._numbers(solids.distance), shared=True)
            for name, value in solids.lattice.items():
                self._frames[name] = value
        gripped = self._set_grip(body, grip)
        self._rows = ParticleRows(config, self.particles, gripped, tool is not None)
        self.shapes = self._rows.shapes
        self._set_model(body, clamps, loads, body.reach if tool is None else tool.reach(body))
        self._elements = self._set_elements(body) if thin else None
        self._segments = self._set_segments(body, clamps, grip) if framed else None
        self._contacts = ContactArrays(body, self._order, self._sharing, self.dtype) if config.self_contact else None
        if self._contacts is not None:
            self._give_all(self._frames, self._contacts.model(), shared=True)
            for name, value in self._contacts.numbers().items():
                self._frames[name] = value
            needed = torch.zeros(rollouts, self._sharing, 2, dtype=torch.int64)
            self._needed = self._give(self._frames, "pairs_needed", needed)
        self._set_adjoints()
        self._set_workspaces()

    # --- arrays -------------------------------------------------------------------------------------------------

    def _zeros(self, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        return torch.zeros(shape, dtype=dtype or self.dtype)

    def _numbers(self, array: np.ndarray) -> Tensor:
        return torch.as_tensor(array).to(self.dtype)

    def _give(self, records: np.ndarray, name: str, value: Tensor, shared: bool = False) -> Tensor:
        """Keep a tensor alive and give the records its address; unless it is shared, each a row of it."""
        value = self._held[name] = value.contiguous()
        records[name] = _addresses(value, shared)
        return value

    def _set_controllers(self, grip: Grip | None, tool: Tool | None) -> None:
        """Make room for the controller points, and take over what pushes."""
        points = controller_count(grip, tool)
        self._frames["controller_points"] = points
        self._give(self._frames, "controllers_bar", self._zeros(self.rollouts, self._sharing, 4, points, 3))
        if tool is not None:
            self._frames["capsules"] = len(tool.ends)
            self._give(self._frames, "capsule_ends", torch.from_numpy(tool.ends), shared=True)
            self._give(self._frames, "capsule_radius", self._numbers(tool.radius), shared=True)

    def _give_all(self, records: np.ndarray, arrays: dict[str, Tensor], shared: bool) -> None:
        for name, value in arrays.items():
            self._give(records, name, value, shared)

    def _set_grip(self, body: Body, grip: Grip | None) -> bool:
        gripped = grip is not None and len(grip.particles) > 0
        self._inertia = GripInertia(body, grip) if gripped else None
        self._acting: Bool[Array, " bonds"] | None = None
        if not gripped:
            return False
        particles, first, order = grip.by_particle()
        self._frames["gripped"], self._frames["grip_softening"] = len(particles), (1e-4 * body.spacing) ** 2
        for name, array in (("particle", particles), ("first", first), ("controller", grip.controllers[order])):
            whole = torch.from_numpy(np.ascontiguousarray(array, dtype=np.int32))
            self._give(self._frames, f"grip_{name}", whole, shared=True)
        self._grip, self._bond_order, bonds = grip, order, len(order)
        self._frames["bonds"] = bonds
        self._give(self._frames, "grip_weight", self._numbers(grip.weights[order]), shared=True)
        lengths = self._numbers(grip.rest_lengths[order]).expand(self.rollouts, -1)
        self._give(self._frames, "grip_rest_length", lengths.clone())
        self._give(self._frames, "rest_length_bar", self._zeros(self.rollouts, self._sharing, bonds))
        return True

    def _hold(self, span: Span) -> None:
        """Let those bonds act that do so in this frame, of a grip that takes and lets go."""
        if self._inertia is None or self._grip.steady:
            return
        acting = self._grip.acting(span.frame)
        if self._acting is not None and (acting == self._acting).all():
            return
        self._settle_weight()
        self._acting = acting
        lengths = torch.where(torch.from_numpy(acting), span.lengths, 1.0)
        self._held["grip_weight"].copy_(self._numbers(np.where(acting, self._grip.weights, 0.0)[self._bond_order]))
        self._held["grip_rest_length"].copy_(lengths[:, self._bond_order])
        self._inertia.hold(acting, lengths)
        self._load_forces()

    def _set_model(
        self, body: Body, clamps: tuple[Clamp, ...], loads: tuple[PointLoad, ...], reach: Float[Array, " particles"]
    ) -> None:
        frames, config = self._frames, self.config
        frames["particles"], frames["threads"] = self.particles, self._sharing
        frames["stride"] = -(-self.particles // BLOCK) * BLOCK
        frames["gravity"] = config.gravity
        lattice, thin = self.lattice, body.elements is not None
        order = self._order = particle_order(body, lattice)
        for name, array in (("order", order), ("place", np.argsort(order))):
            self._give(frames, name, torch.from_numpy(array.astype(np.int32)), shared=True)
        frames["offset"], frames["count"], frames["cell"] = lattice.offset, lattice.count, lattice.cell
        frames["tied"] = len(lattice.copies) > 0
        for name in ("first_copy", "next_copy"):
            self._give(frames, name, torch.from_numpy(getattr(lattice, name).astype(np.int32)), shared=True)
        frames["mass_floor"] = torch.finfo(self.dtype).eps ** 2 * body.mass.min()
        frames["touching"], frames["touch_slope"] = TOUCHING, 1.0 / (NEARLY * body.spacing)
        frames["yield_address"] = _yield_address()
        frames["terms"], frames["frame_rate"] = law_bits(config), config.fps
        boxes = held_boxes(clamps, lattice, thin)
        frames["clamps"] = len(boxes[0])
        for name, array in zip(("clamp_lower", "clamp_upper"), boxes, strict=True):
            self._give(frames, name, self._numbers(array), shared=True)
        self._mass, self._load = self._numbers(body.mass), self._numbers(load_forces(body, loads))
        self._volume = self._numbers(body.volume)
        rows = self._zeros(self.rollouts, self._rows.constant_count, self.particles)
        heights = self._numbers(touch_heights(body, config.ground_height))
        self._rows.fill_body(rows, self._numbers(lattice.place), self._numbers(reach), heights, self._volume)
        self._give(frames, "given", rows)
        frames["constant_rows"], frames["bar_rows"] = self._rows.constant_count, self._rows.bar_count
        for kind, residual in (("elastic", config.elastic_residual), ("plastic", config.plastic_residual)):
            if residual is not None:
                frames[f"weights_{kind}"], frames[f"latent_{kind}_size"] = residual.weight_count, residual.latent_size
                frames[f"beta_{kind}"], frames["strain_scale"] = (
                    getattr(residual, f"beta_{kind}"),
                    residual.strain_scale,
                )

    def _set_elements(self, body: Body) -> ElementArrays:
        """Take over the elements of a thin body."""
        frames = self._frames
        arrays = ElementArrays(body.elements, self.particles, BLOCK, self.dtype, config=self.config)
        frames["elements"], frames["element_stride"] = arrays.count, arrays.stride
        for name in ("corners", "incident_first", "incident"):
            self._give(frames, name, getattr(arrays, name), shared=True)
        self._give(frames, "element_constants", arrays.constants(), shared=True)
        return arrays

    def _set_segments(self, body: Body, clamps: tuple[Clamp, ...], grip: Grip | None) -> SegmentArrays:
        """Take over the segments of framed rods; clamps and a grip hold those between two vertices that they hold."""
        lower, upper = held_boxes(clamps, self.lattice, True)
        held = ((body.x0[:, None] >= lower) & (body.x0[:, None] <= upper)).all(-1).any(-1)
        if grip is not None:
            held[grip.particles] = True
        segments = SegmentArrays(body.elements, held, torch.as_tensor(body.density), BLOCK, self.dtype)
        self._give(self._frames, "begins", segments.begins, shared=True)
        return segments

    def _set_adjoints(self) -> None:
        r, n, frames = self.rollouts, self.particles, self._frames
        for name, shape in self.state_shapes.items():
            self._give(frames, f"{name}_bar", self._zeros(r, n, *shape))
        self._give(frames, "nodes_bar", self._zeros(r, self.lattice.nodes, 4))
        self._give(frames, "given_bars", self._zeros(r, self._rows.bar_count, n))
        self._give(frames, "particle_sums", self._zeros(r, self._sharing, PARTICLE_SUMS.count))
        self._give(frames, "node_sums", self._zeros(r, self._sharing, NODE_SUMS.count))
        for kind in ("elastic", "plastic"):
            if f"network_{kind}" in self.shapes:
                weights = self.shapes[f"network_{kind}"]
                self._give(frames, f"network_{kind}_bar", self._zeros(r, self._sharing, *weights))
        if self._elements is not None:
            self._give(frames, "element_bars", self._zeros(r, self._elements.rows, self._elements.stride))
        if self._segments is not None:
            self._give(frames, "mobility_bar", self._zeros(r, int(frames["stride"][0])))
        self._bars = [bar for name, bar in self._held.items() if name.endswith(("_bar", "_bars", "_sums"))]
        self._status = self._give(frames, "status", self._zeros(r, self._sharing, dtype=torch.int64))

    def _set_workspaces(self) -> None:
        work, stride = self._workspaces, int(self._frames["stride"][0])
        size = torch.zeros(1, dtype=torch.int64)
        wp.launch(self._kernels.measure, dim=1, inputs=[wp.from_torch(size)], device="cpu")
        self._frames["network_numbers"] = int(size)
        self._state_rows = sum(map(math.prod, self.state_shapes.values()))
        count = len(work)
        for name, shape in (
            ("constants", (self._rows.constant_count, stride)),
            ("bars", (self._rows.bar_count, stride)),
            ("force", (3, stride)),
            ("force_bar", (3, stride)),
            ("adjoint", (self._state_rows, stride)),
            ("networks", (self._sharing, int(size))),
        ):
            self._give(work, name, self._zeros(count, *shape))
        if self._elements is not None:
            corners, framed = len(self._elements.corners), self._segments is not None
            # adjoints of x, directors, v and spins; of x, the mean of v and v
            left = 10 if framed else 3 * (1 + self.viscous + ("surface_drag" in self.config.terms))
            self._give(work, "element_force", self._zeros(count, left, corners, self._elements.stride))
            for name, rows in (("torque", 1), ("turned", 3)) if framed else ():
                self._give(work, name, self._zeros(count, rows, stride))
        for name, grids in (("scratch", self._sharing), *((name, 1) for name in NODE_ARRAYS)):
            self._give(work, name, self._zeros(count, grids, self.lattice.nodes + 4, 4))
        if self._contacts is not None:
            self._give(work, "contact_force", self._zeros(count, 3, stride))
            self._give(work, "places", self._zeros(count, 2, 3, stride))
            self._give(work, "path", self._zeros(count, stride))
            self._give_all(work, self._contacts.workspace(count), shared=False)
            self._reserve_pairs()
        self._give(work, "around", self._zeros(count, self.lattice.nodes, 2))
        self._give(work, "shared", self._zeros(count, 128, dtype=torch.int32))
        self._next = self._zeros(1, dtype=torch.int32)

    def _reserve(self, slots: int, grid_numbers: int) -> None:
        """Make room for states of so many substeps, and for kept grids."""
        work, count = self._workspaces, len(self._workspaces)
        if slots > self.slots:
            self.slots, stride = slots, int(self._frames["stride"][0])
            states = torch.empty(count, slots, self._state_rows, stride, dtype=self.dtype)
            self._give(work, "state", states)
        if self._contacts is not None and max(self.substeps) > self._measured:
            self._measured = max(self.substeps)
            self._give(work, "farthest", self._zeros(count, self._measured + 1, self._sharing, 2))
        if grid_numbers > self._grid_numbers:
            self._grid_numbers = grid_numbers
            self._give(work, "free", torch.empty(count, self._grid_numbers, dtype=self.dtype))

    def _reserve_pairs(self) -> None:
        """Make room for the pairs that may touch."""
        self._frames["pair_capacity"] = self._contacts.capacity
        self._give_all(self._workspaces, self._contacts.pairs(len(self._workspaces)), shared=False)

    def keep_frames(self, holder: object, frames: int) -> int:
        """How many of the rollouts' frames may keep their grids; whose were kept is forgotten."""
        numbers = int(self._grids()[-1])
        kept = min(frames, self._kept_bytes // (numbers * self.dtype.itemsize))
        self.holder = holder if kept else None
        held = [grid for grid in self._kept[:kept] if grid.numel() >= numbers]  # a fit comes here in every step
        self._kept = held + [torch.empty(numbers, dtype=self.dtype) for _ in range(kept - len(held))]
        return kept

    def _grids(self) -> np.ndarray:
        """Where each rollout's grids of a frame begin among those of all, in numbers, and their end, shape [R + 1]."""
        numbers = 4 if self._segments is None else 5  # the fifth: spins
        return np.concatenate([[0], np.cumsum(numbers * np.asarray(self.substeps) * self.lattice.nodes)])

    # --- rollouts -----------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: Sequence[int]) -> None:
        """Take over parameters (complete, of this stepper's type, with an axis of rollouts) and substeps per frame [R]."""
        frames = self._frames
        self.substeps = list(substeps)
        steps = np.asarray(self.substeps)
        dt = 1.0 / (self.config.fps * steps)
        frames["substeps"], frames["dt"], frames["share"] = steps, dt, 1.0 / steps
        for field, name in (
            ("friction", "friction_coefficient"),
            ("layer_friction", "layer_friction"),
            ("grip_stiffness", "grip_stiffness"),
            ("grip_damping", "grip_damping"),
            ("tool_stiffness", "tool_stiffness"),
            ("tool_friction", "tool_friction"),
            ("gravity", "gravity"),
            ("friction_law", "friction_law"),
        ):
            value = getattr(parameters, name)
            if value is not None:
                frames[field] = value.detach().numpy()
        for kind in ("elastic", "plastic"):
            if f"network_{kind}" in self.shapes:
                self._give(frames, f"network_{kind}", getattr(parameters, f"network_{kind}").detach())
        frames["numbers"] = self._rows.numbers(parameters).numpy()
        if self.viscous:
            memory = [rate_memory(self._body, self.config, row_of(parameters, r)) for r in range(self.rollouts)]
            frames["remembered"] = np.array(memory) / (np.array(memory) + 1.0)
        self._parameters, self._dt, self._acting = parameters, torch.from_numpy(dt), None
        if self._elements is not None:
            self._give(frames, "element_stiffness", self._elements.stiffness(parameters))
        if self._segments is not None:
            self._give(frames, "mobility", self._segments.mobility(parameters, self.rollouts))
        self._load_forces()

    def _load_forces(self) -> None:
        """Put masses and constant forces, and with them all constants, into the rows."""
        parameters, dt = self._parameters, self._dt
        mass = self._mass if parameters.density is None else parameters.density.detach() * self._volume
        load = self._load if parameters.force is None else self._load + parameters.force.detach()
        mass, load = mass.expand(self.rollouts, -1), load.expand(self.rollouts, -1, -1)
        if self._inertia is not None:
            gravity = torch.from_numpy(self._frames["gravity"].copy())
            mass, load = self._inertia.add(mass, load, gravity, parameters, dt)
        self._rows.fill(self._held["given"], parameters, mass, load, self._start)

    def forward(self, span: Span, start: State, end: State, carries_on: bool) -> Int[Array, " rollouts"]:
        """All substeps of a frame, from `start` to `end`; see `stepper.Stepper`."""
        self._enter(span)
        self._reserve(1 if self._elements is None else 2, 0)  # a thin body has two by turns
        self._frames["keep_states"], self._frames["replay"] = 0, 0
        self._frames["keep_grids"] = span.kept is not None
        self._point("", start)
        self._point("_end", end)
        self._run(self._kernels.forward, span)
        while self._contacts is not None and self._contacts.grow(int(self._needed.max())):
            self._reserve_pairs()
            self._status.fill_(NOT_FAILED)
            self._run(self._kernels.forward, span)
        return self._status.amin(1).numpy()

    def _enter(self, span: Span) -> None:
        """Set what differs between frames."""
        frames = self._frames
        frames["kept_grids"] = 0
        self._hold(span)
        if frames["controller_points"][0]:
            points = span.points[:, :, : frames["controller_points"][0]].detach()
            self._give(frames, "controllers", points.transpose(0, 1))
        if span.kept is not None:
            grid = self._kept[span.kept]
            frames["kept_grids"] = grid.data_ptr() + self._grids()[:-1] * grid.element_size()
        self._status.fill_(NOT_FAILED)

    def _point(self, suffix: str, state: State) -> None:
        """Let the frames read or write a state's arrays."""
        if suffix == "" and self._contacts is not None:
            self._frames["contact_drift"] = state.v.mean(1).numpy()
        for name, values in state.named().items():
            self._frames[f"{name}{suffix}"] = _addresses(values, shared=False)

    def _run(self, kernel: wp.Kernel, span: Span) -> None:
        """Run the frames of the rollouts that are alive."""
        self._held["shared"].zero_()
        if self._contacts is not None:
            self._needed.zero_()
        self._next.zero_()
        frames = self._frames if span.alive.all() else self._frames[span.alive]
        if len(frames):
            # one frame of many rollouts is still a thread's own
            threads = self.threads if self.rollouts == 1 else min(self.threads, len(frames))
            addresses = (frames.ctypes.data, self._workspaces.ctypes.data, len(frames), self._next.data_ptr())
            launch_on_threads(kernel, threads, *addresses)

    # --- adjoints -----------------------------------------------------------------------------------------------

    def begin_backward(self, frames: int, held: bool) -> None:
        """Set all adjoints to zero; room is made frame by frame."""
        for bar in self._bars:
            bar.zero_()
        self._settled = self._weight_bar = torch.zeros(())

    def add_adjoints(self, bars: dict[str, Tensor]) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now, each [R, N, ...], by name."""
        for name, bar in bars.items():
            self._held[f"{name}_bar"] += bar

    def backward(self, span: Span, start: State, led: bool) -> Tensor | None:
        """Adjoint of a frame; see `stepper.Stepper`."""
        self._enter(span)
        self._reserve(max(self.substeps) + 1, 0 if span.kept is not None else int(np.diff(self._grids()).max()))
        self._frames["keep_states"] = self._frames["keep_grids"] = 1
        self._frames["replay"] = span.kept is not None
        self._point("", start)
        self._held["controllers_bar"].zero_()
        self._run(self._kernels.backward, span)
        if self._contacts is not None:
            self._contacts.check(int(self._needed.max()))
        return self._held["controllers_bar"].sum(1).transpose(0, 1) if led else None

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]."""
        return self._held["nodes_bar"]

    def lengths_adjoint(self) -> Tensor:
        """Derivative of the loss by the lengths of the bonds, in the grip's order, [R, B]."""
        found = torch.empty_like(self._held["rest_length_bar"][:, 0])
        found[:, self._bond_order] = self._held["rest_length_bar"].sum(1)
        return found

    def _settle_weight(self) -> None:
        """Count the adjoint of gravity through what takes the weight off the bonds' added mass, of the frames with these bonds."""
        if self._inertia is None or "load" not in self._rows.bars:
            return
        load_bar = self._held["given_bars"][:, self._rows.bars["load"]].movedim(1, -1)
        self._weight_bar = self._weight_bar + self._inertia.gravity_adjoint(load_bar - self._settled)
        self._settled = load_bar.clone()

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts."""
        held = self._held
        networks = {k: held[f"network_{k}_bar"].sum(1) for k in ("elastic", "plastic") if f"network_{k}" in self.shapes}
        state_bars = {name: held[f"{name}_bar"] for name in self.state_shapes}
        sums = held["particle_sums"].sum(1), held["node_sums"].sum(1)
        elements = None
        if self._elements is not None:
            elements = self._elements.gradients(self._parameters, held["element_bars"])
        self._settle_weight()
        found = self._rows.gradients(
            held["given_bars"], state_bars, *sums, networks, self._volume, self._weight_bar, elements
        )
        if self._segments is not None:
            given = self._parameters, self._start, held["mobility_bar"], held["director_bar"]
            for name, bar in self._segments.adjoints(*given).items():
                if name in found:
                    found[name] = found[name] + bar
        return found


def _addresses(values: Tensor, shared: bool) -> int | np.ndarray:
    """Of a contiguous tensor, or of each of its rows."""
    if shared:
        return values.data_ptr()
    assert values.is_contiguous(), values.shape
    row = values[0].numel() * values.element_size()
    return values.data_ptr() + row * np.arange(len(values))
