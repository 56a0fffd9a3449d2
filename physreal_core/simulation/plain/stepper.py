"""One frame of substeps, forward and adjoint, as a fixed sequence of launches on arrays that stay where they are.

A substep is: grip, stress, p2g, nodes, g2p, plastic flow. Nothing in it waits for the device or depends on values the
host computes, so on a GPU a frame runs as one CUDA graph: box, time step and controller points are device arrays.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
import warp as wp

from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, load_forces
from physreal_core.simulation.box import GridBox, held_boxes, lattice_offset
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.constitutive import ResidualConfig
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.plain.friction import friction_kernels
from physreal_core.simulation.plain.grid import grid_kernels
from physreal_core.simulation.plain.grip import bond_functions, grip_kernels
from physreal_core.simulation.plain.laws import LawArrays, force_laws, rate_launches, stress_laws
from physreal_core.simulation.plain.material import flow_kernels, stress_kernels
from physreal_core.simulation.plain.terms import TermArrays
from physreal_core.simulation.plain.transfers import transfer_kernels
from physreal_core.simulation.scalars import scalar_types
from physreal_core.simulation.terms import inner_shape, term_shapes
from physreal_core.simulation.timestep import rate_memory

WEIGHT_ROWS = 64  # copies of a network's weight adjoint on a GPU, so that its threads do not queue for one address


@dataclass(frozen=True)
class NetworkArrays:
    """Latent codes [N, L] and weights [W] of one residual, and their adjoints [N, L] and [rows, W]."""

    latent: torch.Tensor
    weights: torch.Tensor
    latent_bar: torch.Tensor
    weights_bar: torch.Tensor

    def inputs(self) -> list[wp.array]:
        return [wp.from_torch(self.latent), wp.from_torch(self.weights)]

    def adjoints(self) -> list[wp.array]:
        return [wp.from_torch(self.latent_bar), wp.from_torch(self.weights_bar)]


class Phase:
    """A recorded launch whose leading integer arguments (substep and slots) change from call to call."""

    def __init__(
        self, kernel: wp.Kernel, count: int, indices: int, arguments: list, device: str, block: int = 256
    ) -> None:
        inputs = [0] * indices + arguments
        self._launch = wp.launch(kernel, dim=count, inputs=inputs, device=device, record_cmd=True, block_dim=block)

    def __call__(self, *indices: int) -> None:
        for position, index in enumerate(indices):
            self._launch.set_param_at_index_from_ctype(position, index)
        self._launch.launch()

    def resize(self, count: int) -> None:
        """Launch this many threads from now on."""
        self._launch.set_dim(count)


class PlainStepper:
    """Arrays and launches of one body; `Simulator` decides which frames run.

    State arrays are torch tensors shared with Warp, [slots, N, ...]: slot 0 is the current state; with `keep=True`
    slot s holds the state after s substeps, which the adjoint needs. `start` are the positions at frame 0, `rate` is the
    mean rate of deformation that viscosity acts on.
    """

    holder = None

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
    ) -> None:
        self.types = scalar_types(config.dtype)
        self.device, self.config = config.device, config
        self._body, self.particles, self.cell = body, len(body.x0), body.cell
        self.offset = lattice_offset(body, config.ground_height, clamps)
        self._viscous, self._slides = "viscosity" in config.terms, "friction_law" in config.terms
        self.inner_shape = inner_shape(config.terms)
        self._graphs: dict[str, wp.Graph] = {}
        self.substeps = self.slots = self._grid_slots = self._nodes = 0
        self._constants(body, grip, clamps, loads)
        self._parameter_arrays()

    # --- arrays -------------------------------------------------------------------------------------------------

    def _tensor(self, *shape: int, dtype: torch.dtype | None = None) -> torch.Tensor:
        return torch.zeros(shape, dtype=dtype or self.types.torch_dtype, device=self.device)

    def _upload(self, array: np.ndarray, warp_dtype: type) -> wp.array:
        return wp.array(array, dtype=warp_dtype, device=self.device)

    def _numbers(self, array: np.ndarray | tuple[float, ...]) -> torch.Tensor:
        numbers = torch.from_numpy(np.array(array, dtype=np.float64))
        return numbers.to(device=self.device, dtype=self.types.torch_dtype)

    def _constants(
        self, body: Body, grip: Grip | None, clamps: tuple[Clamp, ...], loads: tuple[PointLoad, ...]
    ) -> None:
        scalar, vec3 = self.types.scalar, self.types.vec3
        self._mass, self.volume = self._numbers(body.mass), self._numbers(body.volume)
        self.mass = self._mass.clone()
        rounding = torch.finfo(self.types.torch_dtype).eps
        self.mass_floor = scalar(rounding**2 * body.mass.min())
        self.gravity = self._numbers(self.config.gravity)[None].contiguous()
        self._loads = self._numbers(load_forces(body, loads))
        self.load, self.force = self._loads.clone(), self._loads.clone()
        self._x0 = self._numbers(body.x0)
        self.start = self._x0.clone()
        lower, upper = held_boxes(clamps, self.cell)
        self.clamp_lower, self.clamp_upper = self._upload(lower, vec3), self._upload(upper, vec3)
        self.timing = self._tensor(4)  # dt, 1 / substeps, 1 / frame time, share of the mean rate that a substep keeps
        self.box = self._tensor(6, dtype=torch.int32)
        self.status = self._tensor(2, dtype=torch.int64)
        self.gripped, self.controllers_bar, self._inertia = 0, self._tensor(2, 0, 3), None
        if grip is not None and len(grip.particles):
            self._inertia = GripInertia(body, grip, self.device)
            gripped, first, order = grip.by_particle()
            self.gripped = len(gripped)
            points = int(grip.controllers.max()) + 1
            self.controllers, self.controllers_bar = self._tensor(2, points, 3), self._tensor(2, points, 3)
            bonds = bond_functions(self.config.dtype).Bonds()
            bonds.controller = self._upload(grip.controllers[order], wp.int32)
            bonds.weight = self._upload(grip.weights[order], scalar)
            bonds.rest_length = self._upload(grip.rest_lengths[order], scalar)
            bonds.softening = scalar((1e-4 * body.spacing) ** 2)
            self.bonds = [self._upload(gripped, wp.int32), self._upload(first, wp.int32), bonds]

    def _parameter_arrays(self) -> None:
        n = self.particles
        self.shapes = {"youngs_modulus": (n,), "poissons_ratio": (n,), "initial_velocity": (n, 3)}
        if self.config.ground_height is not None:
            self.shapes["friction_coefficient"] = ()
        if self.gripped:
            self.shapes |= {"grip_stiffness": (), "grip_damping": ()}
        self.shapes |= term_shapes(self.config.terms, n)
        self.E, self.nu, self.friction, self.grip = self._tensor(n), self._tensor(n), self._tensor(1), self._tensor(2)
        self.E_bar, self.nu_bar = self._tensor(n), self._tensor(n)
        self.friction_bar, self.gravity_bar, self.friction_law_bar = (
            self._tensor(1),
            self._tensor(1, 3),
            self._tensor(1, 3),
        )
        self.plastic, self.plastic_bar = self._tensor(n, 2), self._tensor(n, 2)
        if self.config.plastic_law != "identity":
            self.shapes["plastic"] = (n, 2)
        self.networks = {}
        for kind, residual in (("elastic", self.config.elastic_residual), ("plastic", self.config.plastic_residual)):
            if residual is not None:
                self.shapes[f"network_{kind}"] = (residual.weight_count,)
                if residual.latent_size:
                    self.shapes[f"latent_{kind}"] = (n, residual.latent_size)
                self.networks[kind] = self._network_arrays(residual)
        self.stiffness_bar, self.damping_bar = self._tensor(max(1, self.gripped)), self._tensor(max(1, self.gripped))
        self.terms = TermArrays(self.config.terms, n, self._tensor)
        self.start_bar, self.rate_bar = self._tensor(n, 3), self._tensor(n, 3, 3)
        self.mass_bar, self.load_bar, self.force_bar = self._tensor(n), self._tensor(n, 3), self._tensor(n, 3)
        self.x_bar, self.v_bar = self._tensor(n, 3), self._tensor(n, 3)
        self.F_bar, self.C_bar, self.tau_bar = (self._tensor(n, 3, 3) for _ in range(3))

    def _network_arrays(self, residual: ResidualConfig) -> NetworkArrays:
        latent, weights = (self.particles, max(1, residual.latent_size)), residual.weight_count
        rows = 1 if self.device == "cpu" else WEIGHT_ROWS
        return NetworkArrays(
            self._tensor(*latent), self._tensor(weights), self._tensor(*latent), self._tensor(rows, weights)
        )

    def _reserve(self, keep: bool, nodes: int) -> None:
        """Make room for a frame and record the launches anew where arrays had to move."""
        particle_slots, grid_slots = (self.substeps + 1, self.substeps + 1) if keep else (1, 2)
        moved = False
        if particle_slots > self.slots:
            self.slots, n = particle_slots, self.particles
            self.x, self.v = self._tensor(particle_slots, n, 3), self._tensor(particle_slots, n, 3)
            self.F, self.C, self.L, self.tau = (self._tensor(particle_slots, n, 3, 3) for _ in range(4))
            self.rate = self._tensor(particle_slots if self._viscous else 1, n, 3, 3)
            moved = True
        if grid_slots > self._grid_slots or nodes > self._nodes:
            if nodes > self._nodes:
                self._nodes = int(1.2 * nodes)
            self._grid_slots = max(grid_slots, self._grid_slots)
            self.momentum = self._tensor(self._grid_slots, self._nodes, 4)
            self.velocity, self.node_bar = self._tensor(self._nodes, 4), self._tensor(1, self._nodes, 4)
            self.kind = self._tensor(self._nodes, dtype=torch.int32)
            for name in ("friction_bar", "gravity_bar", "friction_law_bar"):  # a backward pass may be under way
                summed = getattr(self, name).sum(0)
                setattr(self, name, self._tensor(self._nodes, *summed.shape))
                getattr(self, name)[0] = summed
            moved = True
        if moved:
            self._record()

    # --- launches -----------------------------------------------------------------------------------------------

    def _record(self) -> None:
        self._graphs.clear()
        scalar, vec3, vec4, mat33 = self.types.scalar, self.types.vec3, self.types.vec4, self.types.mat33
        wrap = wp.from_torch
        x, v = wrap(self.x, vec3), wrap(self.v, vec3)
        F, C, L, tau = (wrap(matrix, mat33) for matrix in (self.F, self.C, self.L, self.tau))
        x_bar, v_bar = wrap(self.x_bar, vec3), wrap(self.v_bar, vec3)
        F_bar, C_bar, tau_bar = wrap(self.F_bar, mat33), wrap(self.C_bar, mat33), wrap(self.tau_bar, mat33)
        momentum, velocity = wrap(self.momentum, vec4), wrap(self.velocity, vec4)
        node_bar_rows, node_bar = wrap(self.node_bar, vec4), wrap(self.node_bar[0], vec4)
        timing, box, status = wrap(self.timing), wrap(self.box), wrap(self.status)
        kind, friction, friction_bar = wrap(self.kind), wrap(self.friction), wrap(self.friction_bar)
        E, nu, E_bar, nu_bar = wrap(self.E), wrap(self.nu), wrap(self.E_bar), wrap(self.nu_bar)
        offset, cells_per_metre = vec3(*self.offset), scalar(1.0 / self.cell)
        place = [offset, cells_per_metre, timing, box]
        node_model = [timing, wrap(self.gravity, vec3), self.mass_floor, kind, friction]
        load, force, force_bar = wrap(self.load, vec3), wrap(self.force, vec3), wrap(self.force_bar, vec3)
        mass, volume = wrap(self.mass), wrap(self.volume)
        transfer, grid = transfer_kernels(self.config.dtype), grid_kernels(self.config.dtype)

        def phase(kernel, count, indices, *arguments):
            return Phase(kernel, count, indices, list(arguments), self.device)

        n, nodes = self.particles, self._nodes
        has_ground = int(self.config.ground_height is not None)
        self._mark = phase(
            grid.mark_nodes, nodes, 0, offset, scalar(self.cell), box, has_ground, self.clamp_lower, self.clamp_upper, kind,
            momentum,
        )  # fmt: skip
        config = self.config
        stress = stress_kernels(config.elastic_law, config.elastic_residual, config.dtype)
        inputs, adjoints = self._network_launch_arrays("elastic")
        self._stress = phase(stress.stress, n, 1, E, nu, *inputs, F, tau)
        self._stress_adjoint = phase(
            stress.stress_adjoint, n, 1, E, nu, *inputs, F, tau_bar, F_bar, E_bar, nu_bar, *adjoints
        )
        flow = flow_kernels(config.plastic_law, config.plastic_residual, config.dtype)
        self._flow = None
        if flow is not None:
            plastic, plastic_bar = wrap(self.plastic, self.types.vec2), wrap(self.plastic_bar, self.types.vec2)
            inputs, adjoints = self._network_launch_arrays("plastic")
            model = [E, nu, plastic, *inputs, timing]
            self._flow = phase(flow.flow, n, 1, *model, F)
            self._flow_adjoint = phase(
                flow.flow_adjoint, n, 2, *model, F, L, F_bar, E_bar, nu_bar, plastic_bar, *adjoints
            )
        self._record_laws()
        model = [mass, volume, *place]
        self._p2g = phase(transfer.p2g, n, 3, *model, x, v, C, tau, force, momentum, status)
        self._p2g_adjoint = phase(
            transfer.p2g_adjoint, n, 1, *model, x, v, C, tau, force, node_bar, x_bar, wrap(self.mass_bar),
            wrap(self.load_bar, vec3), v_bar, C_bar, tau_bar, force_bar,
        )  # fmt: skip
        bars = [friction_bar, wrap(self.gravity_bar, vec3)]
        if self._slides:
            grid = friction_kernels(self.config.dtype)
            node_model.append(wrap(self.terms.values["friction_law"][0]))
            bars.append(wrap(self.friction_law_bar, vec3))
        self._update = phase(grid.update_nodes, nodes, 2, *node_model, momentum, velocity, momentum)
        self._update_again = phase(grid.update_nodes, nodes, 2, *node_model, momentum, velocity, node_bar_rows)
        self._update_adjoint = phase(grid.update_nodes_adjoint, nodes, 1, *node_model, momentum, node_bar, *bars)
        self._g2p = phase(transfer.g2p, n, 2, *place, velocity, x, v, F, C, L)
        self._g2p_adjoint = phase(
            transfer.g2p_adjoint, n, 2, *place, velocity, x, F, L, v_bar, C_bar, x_bar, F_bar, node_bar
        )
        self._check = phase(transfer.check_state, n, 2, offset, cells_per_metre, box, x, v, F, status)
        if self.gripped:
            grips = grip_kernels(self.config.dtype)
            bonds = [*self.bonds, wrap(self.grip), timing]
            points = wrap(self.controllers, vec3)
            before = force if self._force_laws else load
            self._grip = phase(grips.grip_force, self.gripped, 2, *bonds, points, x, v, before, force)
            self._grip_adjoint = phase(
                grips.grip_force_adjoint, self.gripped, 2, *bonds, points, x, v, force_bar, x_bar, v_bar,
                wrap(self.stiffness_bar), wrap(self.damping_bar),
            )  # fmt: skip
            self._controllers_adjoint = phase(
                grips.controllers_adjoint, self.gripped, 2, *bonds, points, x, v, force_bar,
                wrap(self.controllers_bar, vec3),
            )  # fmt: skip

    def _record_laws(self) -> None:
        """Launches of the optional laws, on the arrays of `LawArrays`."""
        vectors = ("load", "force", "force_bar", "x", "v", "start", "x_bar", "v_bar", "start_bar")
        matrices = ("F", "C", "rate", "tau", "F_bar", "C_bar", "rate_bar", "tau_bar")
        arrays = LawArrays(
            **{name: wp.from_torch(getattr(self, name), self.types.vec3) for name in vectors},
            **{name: wp.from_torch(getattr(self, name), self.types.mat33) for name in matrices},
            timing=wp.from_torch(self.timing),
            mass=wp.from_torch(self.mass),
            mass_bar=wp.from_torch(self.mass_bar),
        )

        def record(kernel, indices, *arguments):
            return Phase(kernel, self.particles, indices, list(arguments), self.device)

        given = self.config.terms, self.types, self.terms, arrays, record
        self._force_laws, self._stress_laws = force_laws(*given), stress_laws(*given)
        if self._viscous:
            self._average_rate, self._average_rate_adjoint = rate_launches(self.types, arrays, record)

    def _network_launch_arrays(self, kind: str) -> tuple[list[wp.array], list[wp.array]]:
        arrays = self.networks.get(kind)
        return ([], []) if arrays is None else (arrays.inputs(), arrays.adjoints())

    # --- one rollout --------------------------------------------------------------------------------------------

    def load_parameters(self, parameters: Parameters, substeps: int) -> None:
        """Take over a rollout's parameters (complete, of this stepper's type) and its number of substeps."""
        if substeps != self.substeps:
            self._graphs.clear()
        self.substeps = substeps
        memory = rate_memory(self._body, self.config, parameters)
        timing = [1.0 / (self.config.fps * substeps), 1.0 / substeps, self.config.fps, memory / (memory + 1.0)]
        self.timing.copy_(torch.tensor(timing, dtype=torch.float64))
        self.E.copy_(parameters.youngs_modulus)
        self.nu.copy_(parameters.poissons_ratio)
        if parameters.friction_coefficient is not None:
            self.friction[0] = parameters.friction_coefficient
        if parameters.plastic is not None:
            self.plastic.copy_(parameters.plastic)
        for kind, arrays in self.networks.items():
            arrays.weights.copy_(getattr(parameters, f"network_{kind}"))
            if f"latent_{kind}" in self.shapes:
                arrays.latent.copy_(getattr(parameters, f"latent_{kind}"))
        if self.gripped:
            self.grip[0], self.grip[1] = parameters.grip_stiffness, parameters.grip_damping
        if parameters.gravity is not None:
            self.gravity[0] = parameters.gravity
        self._load_forces(parameters, timing[0])
        self.start.copy_(self._x0 if parameters.initial_position is None else parameters.initial_position)
        self.terms.load(parameters)

    def _load_forces(self, parameters: Parameters, dt: float) -> None:
        """Masses and constant forces."""
        mass = self._mass if parameters.density is None else parameters.density * self.volume
        load = self._loads if parameters.force is None else self._loads + parameters.force
        if self._inertia is not None:
            mass, load = self._inertia.add(mass, load, self.gravity[0], parameters, dt)
        self.mass.copy_(mass)
        self.load.copy_(load)
        self.force.copy_(load)

    def keep_frames(self, holder: object, frames: int, nodes: int) -> int:
        """None: every frame is computed again for its adjoint."""
        return 0

    def start_frame(self, box: GridBox, controllers: torch.Tensor, keep: bool, kept: int | None = None) -> None:
        """Place the grid; controllers [2, C, 3] are the controller points [m] at both ends of the frame."""
        self._reserve(keep, box.nodes)
        self.box.copy_(torch.tensor([*box.origin, *box.count], dtype=torch.int32))
        self.status.fill_(torch.iinfo(torch.int64).max)
        if self.gripped:
            self.controllers.copy_(controllers[:, : self.controllers.shape[1]])
            self.controllers_bar.zero_()
        if self.device == "cpu":  # a captured graph launches over all nodes there is room for
            for phase in (self._mark, self._update, self._update_again, self._update_adjoint):
                phase.resize(box.nodes)

    def set_state(self, x: torch.Tensor, v: torch.Tensor, F: torch.Tensor, C: torch.Tensor) -> None:
        """Put a state into slot 0."""
        for slots, value in ((self.x, x), (self.v, v), (self.F, F), (self.C, C[:, :3])):
            slots[0].copy_(value)
        if self._viscous:
            self.rate[0].copy_(C[:, 3:])
        self._mark()

    def _run(self, name: str, launches: Callable[[], None]) -> None:
        """Launch a frame's phases: one by one on the CPU, on a GPU as a CUDA graph captured when first needed."""
        if self.device == "cpu":
            launches()
            return
        if name not in self._graphs:
            with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
                launches()
            self._graphs[name] = capture.graph
        wp.capture_launch(self._graphs[name])

    def forward(self, keep: bool) -> None:
        """All substeps of a frame, from slot 0 to slot 0, or to slot `substeps` with every state and grid kept."""
        self._run(f"forward, keep={keep}", lambda: self._forward(keep))

    def backward(self) -> None:
        """Adjoint of the kept frame: x_bar, v_bar, F_bar, C_bar go from its end to its start; parameters' bars grow."""
        self._run("backward", self._backward)

    def _forward(self, keep: bool) -> None:
        following = 0
        for s in range(self.substeps):
            slot, following = (s, s + 1) if keep else (0, 0)
            grid_slot, next_grid = (s, s + 1) if keep else (s % 2, (s + 1) % 2)
            self._forces(s, slot)
            self._stress(slot)
            for law in self._stress_laws:
                law.forward(slot)
            self._p2g(s, slot, grid_slot)
            self._update(grid_slot, next_grid)
            self._g2p(slot, following)
            if self._viscous:
                self._average_rate(slot, following)
            if self._flow is not None:
                self._flow(following)
        self._check(self.substeps, following)

    def _forces(self, substep: int, slot: int) -> None:
        for law in self._force_laws:
            law.forward(slot)
        if self.gripped:
            self._grip(substep, slot)

    def _forces_adjoint(self, substep: int, slot: int) -> None:
        if self.gripped:
            self._grip_adjoint(substep, slot)
            self._controllers_adjoint(substep, slot)
        for law in self._force_laws:
            law.adjoint(slot)

    def state(self) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor, torch.Tensor]:
        """x, v, F, C in slot 0."""
        inner = torch.cat([self.C[0], self.rate[0]], 1) if self._viscous else self.C[0]
        return self.x[0], self.v[0], self.F[0], inner

    def failures(self) -> tuple[tuple[int, int] | None, tuple[int, int] | None]:
        """(substep, particle) of the first particle outside the grid and of the first non-finite one in this frame."""
        keys = self.status.tolist()
        none = torch.iinfo(torch.int64).max
        return tuple(None if key == none else divmod(key, self.particles) for key in keys)

    def _backward(self) -> None:
        for s in reversed(range(self.substeps)):
            if self._flow is not None:
                self._flow_adjoint(s, s + 1)
            if self._viscous:
                self._average_rate_adjoint()
            self._update_again(s, 0)
            self._g2p_adjoint(s, s + 1)
            self._update_adjoint(s)
            self._forces(s, s)
            self._p2g_adjoint(s)
            self._forces_adjoint(s, s)
            for law in self._stress_laws:
                law.adjoint(s)
            self._stress_adjoint(s)

    def clear_adjoints(self) -> None:
        """Set all adjoints to zero."""
        for bar in (self.x_bar, self.v_bar, self.F_bar, self.C_bar, self.E_bar, self.nu_bar):
            bar.zero_()
        for bar in (self.plastic_bar, self.stiffness_bar, self.damping_bar, self.friction_bar):
            bar.zero_()
        for bar in (
            self.gravity_bar,
            self.mass_bar,
            self.load_bar,
            self.start_bar,
            self.rate_bar,
            self.friction_law_bar,
        ):
            bar.zero_()
        self.terms.clear()
        for arrays in self.networks.values():
            arrays.latent_bar.zero_()
            arrays.weights_bar.zero_()

    def add_adjoints(self, x_bar: torch.Tensor | None, v_bar: torch.Tensor | None, F_bar: torch.Tensor | None) -> None:
        """Add derivatives of the loss by the state where the adjoint stands now."""
        for total, bar in ((self.x_bar, x_bar), (self.v_bar, v_bar), (self.F_bar, F_bar)):
            if bar is not None:
                total += bar

    def gradients(self) -> dict[str, torch.Tensor]:
        """Adjoints of the parameters in use, by name."""
        bars = {
            "youngs_modulus": self.E_bar.clone(),
            "poissons_ratio": self.nu_bar.clone(),
            "plastic": self.plastic_bar.clone(),
            "initial_velocity": self.v_bar.clone(),
            "initial_position": self.x_bar + self.start_bar,
            "initial_deformation": self.F_bar.clone(),
            "gravity": self.gravity_bar.sum(0),
            "density": self.volume * self.mass_bar,
            "force": self.load_bar.clone(),
            "friction_coefficient": self.friction_bar.sum(),
            "grip_stiffness": self.stiffness_bar.sum(),
            "grip_damping": self.damping_bar.sum(),
        }
        for kind, arrays in self.networks.items():
            bars[f"latent_{kind}"], bars[f"network_{kind}"] = arrays.latent_bar.clone(), arrays.weights_bar.sum(0)
        if self._inertia is not None:
            bars["gravity"] = bars["gravity"] + self._inertia.gravity_adjoint(self.load_bar)
        bars |= self.terms.gradients() | {"friction_law": self.friction_law_bar.sum(0)}
        return {name: bars[name] for name in self.shapes}

    def controllers_adjoint(self) -> torch.Tensor:
        """Adjoint of the controller points at both ends of the frame that `backward` went through, shape [2, C, 3]."""
        return self.controllers_bar
