"""Arrays of a body in many rollouts that no frame changes, and adjoints: constants, parameters, bonds, box, networks.

Arrays of particles exist twice: as the caller counts (`given`) and in the order of the kernels (`sorted`).
"""

import numpy as np
import torch
import warp as wp

from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, load_forces
from physreal_core.simulation.box import held_boxes
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.law_arrays import LawArrays
from physreal_core.simulation.cuda.nodes import node_kernels
from physreal_core.simulation.cuda.structs import particle_structs
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.plain.grip import bond_functions
from physreal_core.simulation.scalars import scalar_types
from physreal_core.simulation.terms import term_shapes
from physreal_core.simulation.timestep import rate_memory

WEIGHT_ROWS = 64  # copies of a network's weight adjoint on a GPU, so that its threads do not queue for one address


class BodyModel:
    """Model arrays and adjoints of `rollouts` copies of a body.

    Attributes:
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        box: origin and count of each rollout's nodes, shape [R, 6].
        controllers: controller points [m] at both ends of the frame, shape [R, 2, C, 3].
        controllers_bar: their adjoint, of one frame.
        laws: arrays of particles' optional laws.
        node_shapes: of what the nodes of a rollout share and has an adjoint, by name.
        inputs: of density and force, those whose adjoint is needed.
        bars: adjoints of the state and of particles' parameters by name, each [P, ...], in the order of the kernels.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        rollouts: int,
        offset: np.ndarray,
    ) -> None:
        self.types, self.config, self.rollouts = scalar_types(config.dtype), config, rollouts
        self.device, self.particles, self.offset = config.device, len(body.x0), offset
        self._body, self.cell = body, body.cell
        self.nodes = node_kernels(config.dtype, "friction_law" in config.terms, "gravity" in config.terms)
        self.mass_floor = torch.finfo(self.types.torch_dtype).eps ** 2 * body.mass.min()
        self.timing = self._zeros(4)  # dt, 1 / substeps, 1 / frame time, share of the mean rate that a substep keeps
        self.box = torch.zeros(rollouts, 6, dtype=torch.int32, device=self.device)
        self.friction, self.grip = self._zeros(rollouts), self._zeros(rollouts, 2)
        self.gravity = self._repeat(np.array([config.gravity], dtype=np.float64))
        self.clamps = [wp.array(c, dtype=self.types.vec3, device=self.device) for c in held_boxes(clamps, body.cell)]
        self.given = {
            "mass": self._repeat(body.mass),
            "volume": self._repeat(body.volume),
            "load": self._repeat(load_forces(body, loads)),
            "place": self._repeat(np.arange(self.particles, dtype=np.int32)),
        }
        self._loads, self._mass = self.given["load"].clone(), self.given["mass"].clone()
        self._bonds(body, grip)
        self._parameters()
        self._terms(body.x0)
        self.sorted = {name: given.clone() for name, given in self.given.items()}

    def _zeros(self, *shape: int) -> torch.Tensor:
        return torch.zeros(shape, dtype=self.types.torch_dtype, device=self.device)

    def _repeat(self, values: np.ndarray) -> torch.Tensor:
        """The same values for every rollout."""
        dtype = torch.int32 if values.dtype == np.int32 else self.types.torch_dtype
        tensor = torch.as_tensor(values, dtype=dtype, device=self.device)
        return tensor.repeat(self.rollouts, *[1] * (tensor.ndim - 1))

    def _bonds(self, body: Body, grip: Grip | None) -> None:
        self.gripped = grip is not None and len(grip.particles) > 0
        self._inertia = GripInertia(body, grip, self.device) if self.gripped else None
        self.bonds = bond_functions(self.config.dtype).Bonds()
        self.bonds.softening = self.types.scalar((1e-4 * body.spacing) ** 2)
        begin = end = np.zeros(self.particles, dtype=np.int32)
        count = 1
        if self.gripped:
            gripped, first, order = grip.by_particle()
            begin, end = begin.copy(), end.copy()
            begin[gripped], end[gripped] = first[:-1], first[1:]
            count = int(grip.controllers.max()) + 1
            for name, values, dtype in (
                ("controller", grip.controllers, wp.int32),
                ("weight", grip.weights, self.types.scalar),
                ("rest_length", grip.rest_lengths, self.types.scalar),
            ):
                setattr(self.bonds, name, wp.array(values[order], dtype=dtype, device=self.device))
        self.given |= {"bond_begin": self._repeat(begin), "bond_end": self._repeat(end)}
        self.controllers = self._zeros(self.rollouts, 2, count, 3)
        self.controllers_bar = torch.zeros_like(self.controllers)

    def _parameters(self) -> None:
        n, config = self.particles, self.config
        self.shapes = {"youngs_modulus": (n,), "poissons_ratio": (n,), "initial_velocity": (n, 3)}
        if config.ground_height is not None:
            self.shapes["friction_coefficient"] = ()
        if self.gripped:
            self.shapes |= {"grip_stiffness": (), "grip_damping": ()}
        if config.plastic_law != "identity":
            self.shapes["plastic"] = (n, 2)
        p = self.rollouts * n
        self.given |= {"E": self._zeros(p), "nu": self._zeros(p), "plastic": self._zeros(p, 2)}
        sizes = {"x": (3,), "v": (3,), "F": (3, 3), "C": (3, 3), "E": (), "nu": (), "plastic": (2,), "grip": (2,)}
        self.bars = {name: self._zeros(p, *size) for name, size in sizes.items()}
        self.weight_rows = 1 if self.device == "cpu" else WEIGHT_ROWS
        self.weights, self.weights_bar = {}, {}
        for kind, residual in (("elastic", config.elastic_residual), ("plastic", config.plastic_residual)):
            width, latent = 1, 1
            if residual is not None:
                width, latent = residual.weight_count, max(1, residual.latent_size)
                self.shapes[f"network_{kind}"] = (width,)
                if residual.latent_size:
                    self.shapes[f"latent_{kind}"] = (n, latent)
            self.given[f"latent_{kind}"] = self._zeros(p, latent)
            self.bars[f"latent_{kind}"] = self._zeros(p, latent)
            self.weights[kind] = self._zeros(self.rollouts, width)
            self.weights_bar[kind] = self._zeros(self.rollouts * self.weight_rows, width)

    def _terms(self, start: np.ndarray) -> None:
        """Arrays of the optional terms; `start` are the body's positions."""
        terms, p = self.config.terms, self.rollouts * self.particles
        self.shapes |= term_shapes(terms, self.particles)
        self.laws = LawArrays(terms, self.types, self.rollouts, self._repeat(start))
        self.given |= self.laws.given
        self.bars |= self.laws.bars
        self.friction_law = self._zeros(self.rollouts, 3)
        self.node_shapes = {"friction": ()} | {name: (3,) for name in ("gravity", "friction_law") if name in terms}
        lifted = self.gripped and "gravity" in terms  # a force that depends on gravity
        self.inputs = tuple(name for name in ("density", "force") if name in terms or (name == "force" and lifted))
        if "density" in self.inputs:
            self.bars["mass"] = self._zeros(p)
        if "force" in self.inputs:
            self.bars["load"] = self._zeros(p, 3)

    # --- Warp's view --------------------------------------------------------------------------------------------

    def particle_struct(self, nodes: int):
        """`structs.Model` over these arrays, for boxes with room for `nodes` nodes."""
        vec2, vec3 = self.types.vec2, self.types.vec3
        model = particle_structs(self.config.dtype).Model()
        model.particles, model.nodes = self.particles, nodes
        model.offset, model.cells_per_metre = vec3(*self.offset), self.types.scalar(1.0 / self.cell)
        for name, values in self.sorted.items():
            if name not in self.laws.given:
                setattr(model, name, wp.from_torch(values, {"load": vec3, "plastic": vec2}.get(name)))
        model.laws = self.laws.struct(self.sorted)
        for kind, weights in self.weights.items():
            setattr(model, f"weights_{kind}", wp.from_torch(weights))
        model.bonds, model.grip = self.bonds, wp.from_torch(self.grip)
        model.controllers = wp.from_torch(self.controllers, vec3)
        model.timing, model.box = wp.from_torch(self.timing), wp.from_torch(self.box)
        return model

    def node_struct(self, nodes: int):
        """`nodes.Nodes` over these arrays, for boxes with room for `nodes` nodes."""
        model, vec3, scalar = self.nodes.Nodes(), self.types.vec3, self.types.scalar
        model.nodes, model.offset, model.cell = nodes, vec3(*self.offset), scalar(self.cell)
        model.gravity, model.mass_floor = wp.from_torch(self.gravity, vec3), scalar(self.mass_floor)
        model.has_ground = int(self.config.ground_height is not None)
        model.clamp_lower, model.clamp_upper = self.clamps
        model.timing, model.box = wp.from_torch(self.timing), wp.from_torch(self.box)
        model.friction = wp.from_torch(self.friction)
        model.friction_law = wp.from_torch(self.friction_law)
        return model

    def bar_struct(self):
        """`structs.Bars` over the adjoints."""
        types = self.types
        dtypes = {"x": types.vec3, "v": types.vec3, "F": types.mat33, "C": types.mat33}
        dtypes |= {"plastic": types.vec2, "grip": types.vec2, "load": types.vec3}
        bars = particle_structs(self.config.dtype).Bars()
        bars.laws = self.laws.bar_struct()
        for name, values in self.bars.items():
            if name not in self.laws.bars:
                setattr(bars, name, wp.from_torch(values, dtypes.get(name)))
        for kind, values in self.weights_bar.items():
            setattr(bars, f"weights_{kind}", wp.from_torch(values))
        bars.weight_rows, bars.controllers = self.weight_rows, wp.from_torch(self.controllers_bar, types.vec3)
        return bars

    # --- values -------------------------------------------------------------------------------------------------

    def load(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters with an axis of rollouts; `sort` puts them in order."""
        fps = self.config.fps
        memory = rate_memory(self._body, self.config, parameters)
        timing = [1.0 / (fps * substeps), 1.0 / substeps, fps, memory / (memory + 1.0)]
        self.timing.copy_(torch.tensor(timing, dtype=torch.float64))
        self._give("E", parameters.youngs_modulus)
        self._give("nu", parameters.poissons_ratio)
        if parameters.friction_coefficient is not None:
            self.friction.copy_(parameters.friction_coefficient)
        if parameters.plastic is not None:
            self._give("plastic", parameters.plastic)
        for kind in ("elastic", "plastic"):
            if f"network_{kind}" in self.shapes:
                self.weights[kind].copy_(getattr(parameters, f"network_{kind}"))
            if f"latent_{kind}" in self.shapes:
                self._give(f"latent_{kind}", getattr(parameters, f"latent_{kind}"))
        if self.gripped:
            self.grip[:, 0], self.grip[:, 1] = parameters.grip_stiffness, parameters.grip_damping
        self._load_terms(parameters)
        self._load_forces(parameters, timing[0])

    def _load_forces(self, parameters: Parameters, dt: float) -> None:
        """Masses and constant forces, after gravity."""
        mass, load = (given.view(self.rollouts, self.particles, -1) for given in (self._mass, self._loads))
        mass = mass[..., 0]
        if parameters.density is not None:
            mass = parameters.density * self.given["volume"].view(mass.shape)
        if parameters.force is not None:
            load = load + parameters.force
        if self._inertia is not None:
            mass, load = self._inertia.add(mass, load, self.gravity, parameters, dt)
        self._give("mass", mass)
        self._give("load", load)

    def _load_terms(self, parameters: Parameters) -> None:
        if parameters.gravity is not None:
            self.gravity.copy_(parameters.gravity)
        if parameters.friction_law is not None:
            self.friction_law.copy_(parameters.friction_law)
        self.laws.load(parameters)

    def _give(self, name: str, values: torch.Tensor) -> None:
        self.given[name].copy_(values.reshape(self.given[name].shape))

    def sort(self, order: torch.Tensor) -> None:
        """Put the particles' constants and parameters in this order."""
        for name, given in self.given.items():
            torch.index_select(given, 0, order, out=self.sorted[name])

    def sort_bars(self, index: torch.Tensor) -> None:
        """Take the adjoints of particles from these places."""
        for bar in self.bars.values():
            bar.copy_(bar[index])

    def clear_bars(self) -> None:
        """Set the adjoints to zero."""
        for bar in (*self.bars.values(), *self.weights_bar.values()):
            bar.zero_()

    def gradients(self, order: torch.Tensor, node_bars: dict[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts, as the caller counts.

        Args:
            order: caller's number of each particle.
            node_bars: adjoints by name of what acts on nodes, each [R, ...].
        """
        own = {name: torch.empty_like(bar).index_copy_(0, order, bar) for name, bar in self.bars.items()}
        grip = own["grip"].view(self.rollouts, -1, 2).sum(1)
        found = {
            "youngs_modulus": own["E"],
            "poissons_ratio": own["nu"],
            "plastic": own["plastic"],
            "initial_velocity": own["v"],
            "friction_coefficient": node_bars["friction"],
            "initial_position": own["x"] + own.get("start", 0.0),
            "initial_deformation": own["F"],
            "grip_stiffness": grip[:, 0],
            "grip_damping": grip[:, 1],
        }
        found |= {name: node_bars[name] for name in ("gravity", "friction_law") if name in node_bars}
        if "gravity" in found and self._inertia is not None:
            pulled = own["load"].view(self.rollouts, self.particles, 3)
            found["gravity"] = found["gravity"] + self._inertia.gravity_adjoint(pulled)
        found |= self.laws.gradients(own)
        if "density" in self.shapes:
            found["density"] = self.given["volume"] * own["mass"]
        if "force" in self.shapes:
            found["force"] = own["load"]
        for kind, bar in self.weights_bar.items():
            found[f"latent_{kind}"] = own[f"latent_{kind}"]
            found[f"network_{kind}"] = bar.view(self.rollouts, self.weight_rows, -1).sum(1)
        return {name: found[name].reshape(self.rollouts, *shape) for name, shape in self.shapes.items()}
