"""Arrays of a body in many rollouts that no frame changes, and adjoints: constants, parameters, bonds, box, networks.

Constants of particles exist twice: as the caller counts and in the order of the kernels.
"""

import numpy as np
import torch

from physreal_core.array_types import Tensor
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, load_forces
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.frame import FRAME
from physreal_core.simulation.cuda.parts import Parts, threads_of
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.lattice import Lattice, base_nodes, held_boxes, lattice_of
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.particle_rows import NODE_SUMS, NUMBERS, PARTICLE_SUMS, ParticleRows
from physreal_core.simulation.stepper import state_shapes
from physreal_core.simulation.timestep import rate_memory
from physreal_core.simulation.touch import NEARLY, TOUCHING, touch_heights

WEIGHT_ROWS = 64  # copies of a network's weight adjoint on a GPU, so that its threads do not queue for one address


def point(record: np.ndarray, name: str, values: Tensor) -> None:
    """Give a frame's record the address of an array."""
    assert values.is_contiguous(), name
    record[name] = values.data_ptr()


class BodyModel:
    """Model arrays and adjoints of `rollouts` copies of a body.

    Attributes:
        frame: record of `frame.FRAME` with all that is here.
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        state_shapes: of what a state has of every particle, by name.
        gripped: whether there are bonds.
        lattice: the grid of each rollout.
        carry: adjoints of the nodes' velocities, shape [R * nodes, 4].
        velocity, first_velocity: of the nodes [m/s], now and at the frame's start, shape [R * nodes, 4].
        controllers: controller points [m] around the frame, shape [R, 4, C, 3].
        controllers_bar: their adjoint, of one frame.
        state_bars: adjoints of the state by name, each [P, ...], in the order of the kernels.
    """

    def __init__(
        self,
        body: Body,
        config: SimulationConfig,
        grip: Grip | None,
        clamps: tuple[Clamp, ...],
        loads: tuple[PointLoad, ...],
        rollouts: int,
    ) -> None:
        self.dtype, self.config, self.rollouts = config.torch_dtype, config, rollouts
        self.device, self.particles = config.device, len(body.x0)
        self.state_shapes = state_shapes(config)
        self._body, self._held = body, {}
        self.frame = np.zeros((), FRAME.dtype(config.dtype))
        self._mass, self._volume = self._numbers(body.mass), self._numbers(body.volume)
        self._load, self._start = self._numbers(load_forces(body, loads)), self._numbers(body.x0)
        self._scene(body, clamps)
        self._bonds(body, grip)
        self._rows = ParticleRows(config, self.particles, self.gripped)
        self.shapes = self._rows.shapes
        self._parameters()
        self._adjoints()

    def _numbers(self, values: np.ndarray) -> Tensor:
        return torch.as_tensor(values, dtype=self.dtype, device=self.device).contiguous()

    def _zeros(self, *shape: int, dtype: torch.dtype | None = None) -> Tensor:
        return torch.zeros(shape, dtype=dtype or self.dtype, device=self.device)

    def _give(self, name: str, values: Tensor) -> Tensor:
        """Keep an array alive and give the frame its address."""
        self._held[name] = values
        point(self.frame, name, values)
        return values

    def _scene(self, body: Body, clamps: tuple[Clamp, ...]) -> None:
        frame, config = self.frame, self.config
        frame["particles"], frame["rollouts"] = self.particles, self.rollouts
        frame["stride"] = self.rollouts * self.particles
        lattice = self.lattice = lattice_of(body, clamps)
        frame["offset"], frame["count"], frame["cell"] = lattice.offset, lattice.count, lattice.cell
        frame["nodes"], frame["touching"] = lattice.nodes, TOUCHING
        frame["touch_slope"] = 1.0 / (NEARLY * body.spacing)
        frame["mass_floor"] = torch.finfo(self.dtype).eps ** 2 * body.mass.min()
        boxes = held_boxes(clamps, lattice, thin=False)
        frame["clamps"] = len(boxes[0])
        for name, corner in zip(("clamp_lower", "clamp_upper"), boxes, strict=True):
            self._give(name, self._numbers(corner))
        rows = self.rollouts * lattice.nodes
        self.velocity = self._give("velocity", self._zeros(rows, 4))
        self.first_velocity = self._give("first_velocity", self._zeros(rows, 4))
        self._give("around", self._zeros(rows, 2))
        self._parts(lattice)
        self._timing = self._give("timing", self._zeros(4))
        self._gravity = self._give("gravity", self._numbers(np.array([config.gravity] * self.rollouts)))

    def _parts(self, lattice: Lattice) -> None:
        """What particles leave at their nodes."""
        lowest = base_nodes(lattice.place, lattice)[lattice.order(lattice.place)]
        parts = Parts.of(lowest, lattice)
        self.frame["threads"], self.frame["groups"] = threads_of(self.particles), parts.groups
        of_nodes = parts.which * self.rollouts * parts.groups + parts.of_nodes
        given = {"group": parts.group, "following": parts.following, "lowest_node": lowest.ravel()}
        for name, values in (given | {"parts_begin": parts.begin, "parts_of": of_nodes}).items():
            self._give(name, torch.as_tensor(values.astype(np.int32), device=self.device))
        self._give("parts", self._zeros(27, self.rollouts * parts.groups, 4))

    def _bonds(self, body: Body, grip: Grip | None) -> None:
        self.gripped = grip is not None and len(grip.particles) > 0
        self._inertia = GripInertia(body, grip, self.device) if self.gripped else None
        whole = np.zeros((3, self.particles), dtype=np.int32)  # caller's number, first bond and end
        whole[0] = np.arange(self.particles)
        count = 1
        if self.gripped:
            gripped, first, order = grip.by_particle()
            whole[1, gripped], whole[2, gripped] = first[:-1], first[1:]
            count = int(grip.controllers.max()) + 1
            self.frame["grip_softening"] = (1e-4 * body.spacing) ** 2
            controllers = np.ascontiguousarray(grip.controllers[order], dtype=np.int32)
            self._give("grip_controller", torch.as_tensor(controllers, device=self.device))
            self._give("grip_weight", self._numbers(grip.weights[order]))
            self._give("grip_rest_length", self._numbers(grip.rest_lengths[order]))
        self._whole = torch.as_tensor(whole, device=self.device).repeat(1, self.rollouts)
        self._sorted_whole = self._whole.clone()
        for name, row in zip(("caller", "bond_begin", "bond_end"), self._sorted_whole, strict=True):
            self._give(name, row)
        self.frame["controller_points"] = count
        self.controllers = self._give("controllers", self._zeros(self.rollouts, 4, count, 3))
        self.controllers_bar = self._give("controllers_bar", torch.zeros_like(self.controllers))

    def _parameters(self) -> None:
        r, config, frame = self.rollouts, self.config, self.frame
        rows = self._zeros(self._rows.constant_count, r, self.particles)
        heights = self._numbers(touch_heights(self._body, config.ground_height))
        place = self._numbers(self.lattice.place)
        self._rows.fill_body(rows.transpose(0, 1), place, heights, self._volume)
        self._given, self._sorted = rows, self._give("constants", rows.flatten(1).clone())
        for name, shape in (
            ("friction", (r,)),
            ("friction_law", (r, 3)),
            ("grip_stiffness", (r,)),
            ("grip_damping", (r,)),
            ("numbers", (r, NUMBERS.count)),
        ):
            self._give(name, self._zeros(*shape))
        self._weight_rows = frame["weight_rows"] = 1 if self.device == "cpu" else WEIGHT_ROWS
        self._weight_rows = int(self._weight_rows)
        self._weights_bar = {}
        for kind, residual in (("elastic", config.elastic_residual), ("plastic", config.plastic_residual)):
            if residual is not None:
                width = residual.weight_count
                frame[f"weights_{kind}"], frame[f"latent_{kind}_size"] = width, residual.latent_size
                frame[f"beta_{kind}"], frame["strain_scale"] = getattr(residual, f"beta_{kind}"), residual.strain_scale
                self._give(f"network_{kind}", self._zeros(r, width))
                self._weights_bar[kind] = self._give(f"network_{kind}_bar", self._zeros(r * self._weight_rows, width))

    def _adjoints(self) -> None:
        count = self.rollouts * self.particles
        sizes = self.state_shapes.items()
        self.state_bars = {name: self._give(f"{name}_bar", self._zeros(count, *size)) for name, size in sizes}
        self._give("node_bar", torch.zeros_like(self.velocity))
        self.carry = self._give("carry", torch.zeros_like(self.velocity))
        self._node_sums = self._give("node_sums", self._zeros(NODE_SUMS.count, len(self.velocity)))
        self._bars = self._give("bars", self._zeros(self._rows.bar_count, count))
        self._sums = self._give("particle_sums", self._zeros(PARTICLE_SUMS.count, count))

    # --- values -------------------------------------------------------------------------------------------------

    def load(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters with an axis of rollouts; `sort` puts them in order."""
        fps = self.config.fps
        memory = rate_memory(self._body, self.config, parameters)
        timing = [1.0 / (fps * substeps), 1.0 / substeps, fps, memory / (memory + 1.0)]
        self._timing.copy_(torch.tensor(timing, dtype=torch.float64))
        networks = [f"network_{kind}" for kind in self._weights_bar]
        held = self._held | {"friction_coefficient": self._held["friction"]}
        for name in ("friction_coefficient", "gravity", "friction_law", "grip_stiffness", "grip_damping", *networks):
            value = getattr(parameters, name)
            if value is not None:
                held[name].copy_(value)
        self._held["numbers"].copy_(self._rows.numbers(parameters))
        self._load_constants(parameters, timing[0])

    def _load_constants(self, parameters: Parameters, dt: float) -> None:
        """Masses and constant forces, after gravity, and with them all constants."""
        mass = self._mass if parameters.density is None else parameters.density * self._volume
        load = self._load if parameters.force is None else self._load + parameters.force
        mass, load = mass.expand(self.rollouts, -1), load.expand(self.rollouts, -1, -1)
        if self._inertia is not None:
            mass, load = self._inertia.add(mass, load, self._gravity, parameters, dt)
        self._rows.fill(self._given.transpose(0, 1), parameters, mass, load, self._start)

    def sort(self, order: Tensor) -> None:
        """Put the particles' constants in this order."""
        torch.index_select(self._given.flatten(1), 1, order, out=self._sorted)
        torch.index_select(self._whole, 1, order, out=self._sorted_whole)

    # --- adjoints -----------------------------------------------------------------------------------------------

    def clear_bars(self) -> None:
        """Set the adjoints to zero."""
        of_nodes = self.carry, self._node_sums
        for bar in (*self.state_bars.values(), self._bars, self._sums, *of_nodes, *self._weights_bar.values()):
            bar.zero_()

    def gradients(self, order: Tensor) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts, as the caller counts.

        Args:
            order: caller's number of each particle.
        """
        size = (self.rollouts, self.particles)
        bars = torch.empty_like(self._bars).index_copy_(1, order, self._bars).unflatten(1, size)
        state = {
            name: torch.empty_like(bar).index_copy_(0, order, bar).unflatten(0, size)
            for name, bar in self.state_bars.items()
        }
        sums = self._sums.unflatten(1, size).sum(2).T
        node_sums = self._node_sums.unflatten(1, (self.rollouts, -1)).sum(2).T
        networks = {
            kind: bar.unflatten(0, (self.rollouts, self._weight_rows)).sum(1) for kind, bar in self._weights_bar.items()
        }
        return self._rows.gradients(bars.transpose(0, 1), state, sums, node_sums, networks, self._volume, self._inertia)
