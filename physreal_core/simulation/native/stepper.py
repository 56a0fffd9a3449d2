"""One frame of substeps, forward and adjoint, as one call of vector C++ per thread (worker.h)."""

import ctypes

import numpy as np
import torch
import warp as wp

from physreal_core.native import launch_on_threads
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, load_forces
from physreal_core.simulation.box import GridBox, held_boxes, lattice_offset
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.native.frame import frame_kernels, frame_type
from physreal_core.simulation.native.terms import INPUT_BARS, SUMS, TERM_ROWS, fill, law_bits, start_height_adjoint
from physreal_core.simulation.native.terms import gradients as law_gradients
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.scalars import scalar_types
from physreal_core.simulation.terms import inner_shape, term_shapes
from physreal_core.simulation.timestep import rate_memory
from physreal_core.simulation.touch import TOUCHING

BLOCK = 16  # particles; the widest block that a machine works on, to which rows of particles are filled up
PARTICLES_PER_THREAD = 256  # fewer are not worth the threads' meeting twice a substep
NODE_RESERVE = 1.2  # boxes grow as a body deforms
KEPT_BYTES = 2**28
"""Memory for grids of frames that stay for the backward pass: with them a frame's states need less than half of the time
that the frame took, since no stress is evaluated and nothing scattered again. A grid is a tenth of the particles' states:
with 20 000 particles, 25 frames of 50 substeps fit."""
STATE_ROWS, CONSTANT_ROWS, BAR_ROWS = 24, 9, 4  # of worker.h; latent codes come on top of the last two
_NONE = torch.iinfo(torch.int64).max
_STATE_SHAPES = {"x": (3,), "v": (3,), "F": (3, 3), "C": (3, 3)}


def _yield_address() -> int:
    """Address of the function that gives the core to another thread; 0 where there is none."""
    function = getattr(ctypes.CDLL(None), "sched_yield", None)
    return 0 if function is None else ctypes.cast(function, ctypes.c_void_p).value


class NativeStepper:
    """`Stepper` on the CPU. Particles are put in the order of their cells at every frame; results are in the caller's.

    Args:
        body, config, grip, clamps, loads: as for `Simulator`.
        threads: threads of a frame; by default torch's number, fewer for few particles. The sums' order, and with it
            the last digits, depend on it.
        kept_bytes: memory for kept grids; `KEPT_BYTES` by default.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        threads: int | None = None,
        kept_bytes: int | None = None,
    ) -> None:
        self.types, self.config = scalar_types(config.dtype), config
        self.cell, self.particles = body.cell, len(body.x0)
        self._body, self._start = body, self._numbers(body.x0)
        self.inner_shape = inner_shape(config.terms)
        self.offset = lattice_offset(body, config.ground_height, clamps)
        self.threads = min(threads or torch.get_num_threads(), max(1, self.particles // PARTICLES_PER_THREAD))
        self._kept_bytes = KEPT_BYTES if kept_bytes is None else kept_bytes
        self.substeps = self.slots = self._nodes = 0
        self.holder: object | None = None
        self._grids, self._kept = self._zeros(0), []
        wp.init()  # before tensors are wrapped for it
        self._kernels = frame_kernels(config)
        self._frame = frame_type(self.types.torch_dtype)()
        self._held: dict[str, torch.Tensor] = {}
        self._set_model(body, clamps, loads)
        self._set_grip(body, grip)
        self._set_parameter_arrays()
        self._set_workspace()

    # --- arrays -------------------------------------------------------------------------------------------------

    def _hold(self, name: str, value: torch.Tensor) -> torch.Tensor:
        """Keep a contiguous tensor alive and give the frame its address."""
        self._held[name] = value.contiguous()
        setattr(self._frame, name, self._held[name].data_ptr())
        return self._held[name]

    def _zeros(self, *shape: int, dtype: torch.dtype | None = None) -> torch.Tensor:
        return torch.zeros(shape, dtype=dtype or self.types.torch_dtype)

    def _numbers(self, array: np.ndarray) -> torch.Tensor:
        return torch.as_tensor(array).to(self.types.torch_dtype)

    def _set_model(self, body: Body, clamps: tuple[Clamp, ...], loads: tuple[PointLoad, ...]) -> None:
        frame = self._frame
        frame.particles, frame.threads = self.particles, self.threads
        frame.stride = -(-self.particles // BLOCK) * BLOCK
        frame.clamps, frame.has_ground = len(clamps), int(self.config.ground_height is not None)
        frame.offset[:], frame.gravity[:] = self.offset, self.config.gravity
        frame.cell = self.cell
        frame.mass_floor = torch.finfo(self.types.torch_dtype).eps ** 2 * body.mass.min()
        frame.touching = TOUCHING
        frame.yield_ = _yield_address()
        lower, upper = held_boxes(clamps, self.cell)
        self._loads = self._numbers(load_forces(body, loads))
        self._hold("load", self._loads)
        for name, array in (
            ("mass", body.mass),
            ("volume", body.volume),
            ("clamp_lower", lower),
            ("clamp_upper", upper),
        ):
            self._hold(name, self._numbers(array))
        self._mass = self._held["mass"]

    def _set_grip(self, body: Body, grip: Grip | None) -> None:
        self.gripped = 0 if grip is None else len(np.unique(grip.particles))
        self._inertia = GripInertia(body, grip) if self.gripped else None
        self._frame.gripped = self.gripped
        self._hold("controllers_bar", self._zeros(self.threads, 2, 0, 3))
        if not self.gripped:
            return
        particles, first, order = grip.by_particle()
        self._frame.grip_softening = (1e-4 * body.spacing) ** 2
        self._frame.controller_points = points = int(grip.controllers.max()) + 1
        self._hold("controllers_bar", self._zeros(self.threads, 2, points, 3))
        for name, array in (("particle", particles), ("first", first), ("controller", grip.controllers[order])):
            self._hold(f"grip_{name}", torch.from_numpy(np.ascontiguousarray(array, dtype=np.int32)))
        self._hold("grip_weight", self._numbers(grip.weights[order]))
        self._hold("grip_rest_length", self._numbers(grip.rest_lengths[order]))

    def _set_parameter_arrays(self) -> None:
        n = self.particles
        self.shapes = {"youngs_modulus": (n,), "poissons_ratio": (n,), "initial_velocity": (n, 3)}
        if self.config.ground_height is not None:
            self.shapes["friction_coefficient"] = ()
        if self.gripped:
            self.shapes |= {"grip_stiffness": (), "grip_damping": ()}
        self.shapes |= term_shapes(self.config.terms, n)
        if self.config.plastic_law != "identity":
            self.shapes["plastic"] = (n, 2)
        self._hold("plastic", self._zeros(n, 2))
        for kind, residual in (("elastic", self.config.elastic_residual), ("plastic", self.config.plastic_residual)):
            if residual is None:
                continue
            self.shapes[f"network_{kind}"] = (residual.weight_count,)
            setattr(self._frame, f"weights_{kind}", residual.weight_count)
            setattr(self._frame, f"latent_{kind}_size", residual.latent_size)
            setattr(self._frame, f"beta_{kind}", getattr(residual, f"beta_{kind}"))
            self._frame.strain_scale = residual.strain_scale
            self._hold(f"network_{kind}_bar", self._zeros(self.threads, residual.weight_count))
            self._hold(f"latent_{kind}", self._zeros(n, residual.latent_size))
            self._hold(f"latent_{kind}_bar", self._zeros(n, residual.latent_size))
            if residual.latent_size:
                self.shapes[f"latent_{kind}"] = (n, residual.latent_size)

    def _set_workspace(self) -> None:
        frame, n, stride = self._frame, self.particles, self._frame.stride
        sizes = torch.zeros(2, dtype=torch.int64)
        wp.launch(self._kernels.measure, dim=1, inputs=[wp.from_torch(sizes)], device="cpu")
        if sizes[0] != ctypes.sizeof(frame):
            raise RuntimeError(f"Frame has {ctypes.sizeof(frame)} bytes here and {sizes[0]} in frame.h")
        frame.workspace_size = int(sizes[1])
        latents = frame.latent_elastic_size + frame.latent_plastic_size
        frame.terms, optional = law_bits(self.config.terms), int(bool(self.config.terms))
        self._viscous = "viscosity" in self.config.terms
        self._state_rows = STATE_ROWS + 9 * self._viscous
        rate = (n, 3, 3) if self._viscous else (0, 3, 3)
        for name, shape in _STATE_SHAPES.items():
            self._hold(name, self._zeros(n, *shape))
            self._hold(f"{name}_bar", self._zeros(n, *shape))
        for name, shape in (
            ("E_bar", (n,)),
            ("nu_bar", (n,)),
            ("plastic_bar", (n, 2)),
            ("sums", (self.threads, SUMS)),
            ("mass_bar", (n,)),
            ("load_bar", (n, 3)),
            ("rate", rate),
            ("rate_bar", rate),
            ("term_values", (n, TERM_ROWS)),
            ("term_bar", (n, TERM_ROWS)),
            ("constants", (CONSTANT_ROWS + latents + optional * TERM_ROWS, stride)),
            ("bars", (BAR_ROWS + latents + optional * INPUT_BARS, stride)),
            ("force", (3, stride)),
            ("force_bar", (3, stride)),
            ("adjoint", (self._state_rows, stride)),
            ("workspace", (self.threads, frame.workspace_size)),
        ):
            self._hold(name, self._zeros(*shape))
        self._hold("place", self._zeros(n, dtype=torch.int32))
        self._hold("shared", self._zeros(64, dtype=torch.int32))
        self._hold("status", self._zeros(self.threads, 2, dtype=torch.int64))

    def _reserve_nodes(self, nodes: int) -> None:
        if nodes <= self._nodes:
            return
        self._nodes = int(NODE_RESERVE * nodes)
        for name, count in (("scratch", self.threads), ("velocity", 1), ("node_bar", 1)):
            self._hold(name, self._zeros(count, self._nodes + 4, 4))
        self._hold("kind", self._zeros(self._nodes, dtype=torch.uint8))

    def _reserve_states(self, slots: int) -> None:
        if slots <= self.slots:
            return
        self.slots = slots
        self._hold("state", torch.empty(slots, self._state_rows, self._frame.stride, dtype=self.types.torch_dtype))

    def _roomy(self, grids: torch.Tensor, nodes: int) -> torch.Tensor:
        """`grids`, or others that have room for those of all substeps; flat."""
        if 4 * self.substeps * nodes <= len(grids):
            return grids
        return torch.empty(4 * self.substeps * int(NODE_RESERVE * nodes), dtype=self.types.torch_dtype)

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """How many of a rollout's frames, each with boxes of about `nodes` nodes, may keep their grids; whose were kept is
        forgotten."""
        frame_bytes = 4 * self.substeps * int(NODE_RESERVE * nodes) * self.types.torch_dtype.itemsize
        kept = min(frames, self._kept_bytes // frame_bytes)
        self.holder = holder if kept else None
        self._kept = self._kept[:kept] + [self._zeros(0) for _ in range(kept - len(self._kept))]
        return kept

    # --- one rollout --------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: int) -> None:
        """Take over a rollout's parameters (complete, of this stepper's type) and its number of substeps."""
        self.substeps = self._frame.substeps = substeps
        self._frame.dt = 1.0 / (self.config.fps * substeps)
        self._frame.share, self._frame.frame_rate = 1.0 / substeps, self.config.fps
        self._hold("E", parameters.youngs_modulus.detach())
        self._hold("nu", parameters.poissons_ratio.detach())
        for name in ("friction_coefficient", "grip_stiffness", "grip_damping"):
            value = getattr(parameters, name)
            field = "friction" if name == "friction_coefficient" else name
            setattr(self._frame, field, 0.0 if value is None else float(value.detach()))
        for name in ("plastic", "latent_elastic", "latent_plastic", "network_elastic", "network_plastic"):
            if name in self.shapes:
                self._hold(name, getattr(parameters, name).detach())
        self._load_inputs(parameters)

    def _load_inputs(self, parameters: Parameters) -> None:
        """Take over masses, constant forces and what the optional terms need."""
        if parameters.gravity is not None:
            self._frame.gravity[:] = parameters.gravity.tolist()
        mass = self._mass if parameters.density is None else parameters.density.detach() * self._held["volume"]
        load = self._loads if parameters.force is None else self._loads + parameters.force.detach()
        if self._inertia is not None:
            gravity = self._numbers(np.array(self._frame.gravity))
            mass, load = self._inertia.add(mass, load, gravity, parameters, self._frame.dt)
        self._hold("mass", mass)
        self._hold("load", load)
        memory = rate_memory(self._body, self.config, parameters)
        self._frame.remembered = memory / (memory + 1.0)
        if self._frame.terms:
            x = self._start if parameters.initial_position is None else parameters.initial_position.detach()
            self._frame.term_numbers[:] = fill(self._held["term_values"], parameters, x[:, 2])

    def start_frame(self, box: GridBox, controllers: torch.Tensor, keep: bool, kept: int | None = None) -> None:
        """Place the grid.

        Args:
            box: the nodes.
            controllers: controller points [m] at both ends of the frame, shape [2, C, 3].
            keep: whether `backward` is to follow.
            kept: number of the frame among those whose grids are kept; with `keep` it has run as such before.
        """
        frame = self._frame
        frame.keep_states, frame.keep_grids = int(keep), int(keep or kept is not None)
        frame.replay = int(keep and kept is not None)
        frame.origin[:], frame.count[:] = box.origin, box.count
        self._reserve_nodes(box.nodes)
        self._reserve_states(self.substeps + 1 if keep else 1)
        if kept is not None:
            grids = self._kept[kept] = self._roomy(self._kept[kept], box.nodes)
            frame.momentum = grids.data_ptr()
        elif keep:
            self._grids = self._roomy(self._grids, box.nodes)
            frame.momentum = self._grids.data_ptr()
        if self.gripped:
            self._hold("controllers", controllers[:, : frame.controller_points].detach())
            self._held["controllers_bar"].zero_()

    def set_state(self, x: torch.Tensor, v: torch.Tensor, F: torch.Tensor, C: torch.Tensor) -> None:
        """Put in the state at the frame's start."""
        for name, value in (("x", x), ("v", v), ("F", F), ("C", C[:, :3])):
            self._held[name].copy_(value)
        if self._viscous:
            self._held["rate"].copy_(C[:, 3:])
        self._hold("order", self._order(x))

    def _order(self, x: torch.Tensor) -> torch.Tensor:
        """Particles in the order of their cells, so that those of one cell follow each other."""
        base = torch.floor((x.detach() - self._numbers(self.offset)) / self.cell - 0.5).to(torch.int64)
        first = torch.tensor(list(self._frame.origin))
        i, j, k = (base - first).unbind(1)
        return torch.argsort((i * self._frame.count[1] + j) * self._frame.count[2] + k, stable=True).to(torch.int32)

    def _run(self, kernel: wp.Kernel) -> None:
        self._held["shared"].zero_()
        launch_on_threads(kernel, self.threads, ctypes.addressof(self._frame))

    def forward(self, keep: bool) -> None:
        """All substeps of the frame, as `start_frame` was told; with `keep` their states and grids stay for the adjoint."""
        self._held["status"].fill_(_NONE)
        self._run(self._kernels.forward)

    def failures(self) -> tuple[tuple[int, int] | None, tuple[int, int] | None]:
        """(substep, particle) of the first particle outside the grid and of the first non-finite one in this frame."""
        keys = self._held["status"].amin(0).tolist()
        return tuple(None if key == _NONE else divmod(key, self.particles) for key in keys)

    def state(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """x, v, F, C at the frame's end; valid until the next call."""
        held = self._held
        inner = torch.cat([held["C"], held["rate"]], 1) if self._viscous else held["C"]
        return held["x"], held["v"], held["F"], inner

    def backward(self) -> None:
        """Adjoint of the kept frame: the state's adjoints go from its end to its start; parameters' adjoints grow."""
        self._run(self._kernels.backward)

    def clear_adjoints(self) -> None:
        """Set all adjoints to zero."""
        for name, tensor in self._held.items():
            if name.endswith("_bar") or name == "sums":
                tensor.zero_()

    def add_adjoints(self, x_bar: torch.Tensor | None, v_bar: torch.Tensor | None, F_bar: torch.Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now."""
        for name, bar in (("x_bar", x_bar), ("v_bar", v_bar), ("F_bar", F_bar)):
            if bar is not None:
                self._held[name] += bar

    def gradients(self) -> dict[str, torch.Tensor]:
        """Adjoints of the parameters in use, by name."""
        held = self._held
        sums = held["sums"].sum(0)
        bars = {
            "youngs_modulus": held["E_bar"].clone(),
            "poissons_ratio": held["nu_bar"].clone(),
            "plastic": held["plastic_bar"].clone(),
            "initial_velocity": held["v_bar"].clone(),
            "initial_position": held["x_bar"].clone(),
            "initial_deformation": held["F_bar"].clone(),
            "gravity": sums[3:6].clone(),
            "density": held["volume"] * held["mass_bar"],
            "force": held["load_bar"].clone(),
            "friction_coefficient": sums[0],
            "grip_stiffness": sums[1],
            "grip_damping": sums[2],
        }
        for kind in ("elastic", "plastic"):
            if f"network_{kind}" in self.shapes:
                bars[f"latent_{kind}"] = held[f"latent_{kind}_bar"].clone()
                bars[f"network_{kind}"] = held[f"network_{kind}_bar"].sum(0)
        if self._inertia is not None:
            bars["gravity"] += self._inertia.gravity_adjoint(held["load_bar"])
        bars |= law_gradients(self.shapes, held["term_bar"], sums[6:])
        if "initial_position" in self.shapes:
            bars["initial_position"][:, 2] += start_height_adjoint(held["term_bar"])
        return {name: bars[name] for name in self.shapes}

    def controllers_adjoint(self) -> torch.Tensor:
        """Adjoint of the controller points at both ends of the frame that `backward` went through, shape [2, C, 3]."""
        return self._held["controllers_bar"].sum(0)
