"""Arrays of a body in many rollouts that no frame changes, and adjoints, in what volumes and thin bodies share: constants,
parameters, bonds.

Constants of particles exist twice: as the caller counts and in the order of the kernels.
"""

import numpy as np
import torch

from physreal_core.array_types import Tensor
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, load_forces
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.grip_inertia import GripInertia
from physreal_core.simulation.lattice import lattice_of
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.particle_rows import NODE_SUMS, NUMBERS, PARTICLE_SUMS, ParticleRows
from physreal_core.simulation.stepper import state_shapes
from physreal_core.simulation.timestep import rate_memory
from physreal_core.simulation.touch import NEARLY, TOUCHING, touch_heights


def point(record: np.ndarray, name: str, values: Tensor) -> None:
    """Give a frame's record the address of an array."""
    assert values.is_contiguous(), name
    record[name] = values.data_ptr()


class BodyModel:
    """Model arrays and adjoints of `rollouts` copies of a body.

    Attributes:
        layout: of the frame's record.
        frame: record with all that is here.
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        state_shapes: of what a state has of every particle, by name.
        gripped: whether there are bonds.
        lattice: the grid of each rollout.
        controllers: controller points [m] around the frame, shape [R, 4, C, 3].
        controllers_bar: their adjoint, of one frame.
        state_bars: adjoints of the state by name, each [P, ...], in the order of the kernels.
    """

    layout: Structure

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
        self.state_shapes = state_shapes(config, thin=body.elements is not None)
        self._body, self._held = body, {}
        self.frame = np.zeros((), self.layout.dtype(config.dtype))
        self._mass, self._volume = self._numbers(body.mass), self._numbers(body.volume)
        self._load, self._start = self._numbers(load_forces(body, loads)), self._numbers(body.x0)
        self.lattice = lattice_of(body, clamps)
        self._scene(clamps)
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

    def _scene(self, clamps: tuple[Clamp, ...]) -> None:
        """What is around the body."""
        frame, config, body = self.frame, self.config, self._body
        frame["particles"], frame["rollouts"] = self.particles, self.rollouts
        frame["stride"], frame["nodes"] = self.rollouts * self.particles, self.lattice.nodes
        frame["touching"], frame["touch_slope"] = TOUCHING, 1.0 / (NEARLY * body.spacing)
        frame["mass_floor"] = torch.finfo(self.dtype).eps ** 2 * body.mass.min()
        self._around = self._give("around", self._zeros(self.rollouts * self.lattice.nodes, 2))
        self._timing = self._give("timing", self._zeros(4))
        self._gravity = self._give("gravity", self._numbers(np.array([config.gravity] * self.rollouts)))

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
        r = self.rollouts
        rows = self._zeros(self._rows.constant_count, r, self.particles)
        heights = self._numbers(touch_heights(self._body, self.config.ground_height))
        self._rows.fill_body(rows.transpose(0, 1), self._start, heights, self._volume)
        self._given, self._sorted = rows, self._give("constants", rows.flatten(1).clone())
        for name, shape in (
            ("friction", (r,)),
            ("friction_law", (r, 3)),
            ("grip_stiffness", (r,)),
            ("grip_damping", (r,)),
            ("numbers", (r, NUMBERS.count)),
        ):
            self._give(name, self._zeros(*shape))

    def _adjoints(self) -> None:
        count, nodes = self.rollouts * self.particles, self.rollouts * self.lattice.nodes
        sizes = self.state_shapes.items()
        self.state_bars = {name: self._give(f"{name}_bar", self._zeros(count, *size)) for name, size in sizes}
        self._give("node_bar", self._zeros(nodes, 4))
        self._node_sums = self._give("node_sums", self._zeros(NODE_SUMS.count, nodes))
        self._bars = self._give("bars", self._zeros(self._rows.bar_count, count))
        self._sums = self._give("particle_sums", self._zeros(PARTICLE_SUMS.count, count))

    # --- values -------------------------------------------------------------------------------------------------

    def load(self, parameters: Parameters, substeps: int) -> None:
        """Take over parameters with an axis of rollouts; `sort` puts them in order."""
        fps = self.config.fps
        memory = rate_memory(self._body, self.config, parameters)
        timing = [1.0 / (fps * substeps), 1.0 / substeps, fps, memory / (memory + 1.0)]
        self._timing.copy_(torch.tensor(timing, dtype=torch.float64))
        held = self._held | {"friction_coefficient": self._held["friction"]}
        for name in ("friction_coefficient", "gravity", "friction_law", "grip_stiffness", "grip_damping"):
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
        for bar in (*self.state_bars.values(), self._bars, self._sums, self._node_sums, *self._own_bars()):
            bar.zero_()

    def _own_bars(self) -> list[Tensor]:
        """Adjoints that only this kind of body has."""
        return []

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]."""
        raise NotImplementedError

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
        given = bars.transpose(0, 1), state, sums, node_sums, self._network_bars(), self._volume, self._inertia
        return self._rows.gradients(*given, self._element_bars())

    def _network_bars(self) -> dict[str, Tensor]:
        """Adjoints of networks' weights by "elastic" and "plastic", each [R, W]."""
        return {}

    def _element_bars(self) -> dict[str, Tensor]:
        """Adjoints of parameters through the elements of a thin body, by name."""
        return {}
