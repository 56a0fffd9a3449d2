"""Arrays of a body in many rollouts that no frame changes, and adjoints, in what volumes and thin bodies share: constants,
parameters, bonds.

Constants of particles exist twice: as the caller counts and in the order of the kernels.
"""

import numpy as np
import torch

from physreal_core.array_types import Tensor
from physreal_core.simulation.body import Body, Clamp, Grip, PointLoad, Tool, load_forces
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.cuda.contacts import ContactModel
from physreal_core.simulation.cuda.hand_model import GRIPS, HandModel
from physreal_core.simulation.lattice import lattice_of, particle_order
from physreal_core.simulation.layout import Structure
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.particle_rows import NODE_SUMS, NUMBERS, PARTICLE_SUMS, ParticleRows
from physreal_core.simulation.solids import Solids
from physreal_core.simulation.stepper import Span, state_shapes
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
        hand: what the hand does.
        contact: of the body with itself; None where it does not touch itself.
        lattice: the grid of each rollout.
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
        tool: Tool | None,
        solids: Solids | None,
        rollouts: int,
    ) -> None:
        self.dtype, self.config, self.rollouts = config.torch_dtype, config, rollouts
        self.device, self.particles = config.device, len(body.x0)
        self.state_shapes = state_shapes(config, body.elements)
        self._body, self._tool, self._held = body, tool, {}
        self.frame = np.zeros((), self.layout.dtype(config.dtype))
        self._mass, self._volume = self._numbers(body.mass), self._numbers(body.volume)
        self._load, self._start = self._numbers(load_forces(body, loads)), self._numbers(body.x0)
        self.lattice = lattice_of(body, clamps)
        self._scene(clamps)
        if solids is not None:
            self._give("solid_distance", self._numbers(solids.distance))
            for name, value in solids.lattice.items():
                self.frame[name] = value
        given = self.frame, self._give, self.dtype, self.device
        self.hand = HandModel(body, grip, tool, rollouts, *given)
        self._rows = ParticleRows(config, self.particles, bool(self.hand.bits & GRIPS), tool is not None)
        self.shapes = self._rows.shapes
        self.contact = (
            ContactModel(body, particle_order(body, self.lattice), rollouts, *given) if config.self_contact else None
        )
        self._parameters()
        self._adjoints()
        self._settled = self._weight_bar = torch.zeros((), device=self.device)

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

    def _parameters(self) -> None:
        r = self.rollouts
        rows = self._zeros(self._rows.constant_count, r, self.particles)
        heights = self._numbers(touch_heights(self._body, self.config.ground_height))
        reach = self._numbers(self._body.reach if self._tool is None else self._tool.reach(self._body))
        place = self._numbers(self.lattice.place)
        self._rows.fill_body(rows.transpose(0, 1), place, reach, heights, self._volume)
        self._given, self._sorted = rows, self._give("constants", rows.flatten(1).clone())
        for name, shape in (
            ("friction", (r,)),
            ("friction_law", (r, 3)),
            ("grip_stiffness", (r,)),
            ("grip_damping", (r,)),
            ("tool_stiffness", (r,)),
            ("tool_friction", (r,)),
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
        hands = ("grip_stiffness", "grip_damping", "tool_stiffness", "tool_friction")
        for name in ("friction_coefficient", "gravity", "friction_law", *hands):
            value = getattr(parameters, name)
            if value is not None:
                held[name].copy_(value)
        self._held["numbers"].copy_(self._rows.numbers(parameters))
        if self.contact is not None:
            self.contact.load(parameters.youngs_modulus, parameters.layer_friction)
        self._now, self._dt = parameters, timing[0]
        self.hand.forget()
        self._load_constants()

    def hold(self, span: Span) -> bool:
        """Let those bonds act that do so in a frame; whether that has changed the masses, which are to be sorted again."""
        if not self.hand.changes(span):
            return False
        self._settle_weight()
        self.hand.hold(span)
        self._load_constants()
        return True

    def _load_constants(self) -> None:
        """Masses and constant forces, after gravity, and with them all constants."""
        parameters, dt = self._now, self._dt
        mass = self._mass if parameters.density is None else parameters.density * self._volume
        load = self._load if parameters.force is None else self._load + parameters.force
        mass, load = mass.expand(self.rollouts, -1), load.expand(self.rollouts, -1, -1)
        if self.hand.inertia is not None:
            mass, load = self.hand.inertia.add(mass, load, self._gravity, parameters, dt)
        self._rows.fill(self._given.transpose(0, 1), parameters, mass, load, self._start)

    def sort(self, order: Tensor) -> None:
        """Put the particles' constants in this order."""
        torch.index_select(self._given.flatten(1), 1, order, out=self._sorted)
        self.hand.sort(order)
        self._order = order

    # --- adjoints -----------------------------------------------------------------------------------------------

    def clear_bars(self) -> None:
        """Set the adjoints to zero."""
        for bar in (*self.state_bars.values(), self._bars, self._sums, self._node_sums, *self._own_bars()):
            bar.zero_()
        self.hand.lengths_bar.zero_()
        self._settled = self._weight_bar = torch.zeros((), device=self.device)

    def _settle_weight(self) -> None:
        """Count the adjoint of gravity through what takes the weight off the bonds' added mass, of the frames with these bonds."""
        if self.hand.inertia is None or "load" not in self._rows.bars:
            return
        load_bar = self._of_caller(self._bars[self._rows.bars["load"]], 1)
        load_bar = load_bar.unflatten(1, (self.rollouts, self.particles)).movedim(0, -1)
        self._weight_bar = self._weight_bar + self.hand.inertia.gravity_adjoint(load_bar - self._settled)
        self._settled = load_bar

    def _of_caller(self, values: Tensor, axis: int) -> Tensor:
        """Values of the particles along an axis, as the caller counts."""
        return torch.empty_like(values).index_copy_(axis, self._order, values)

    def _own_bars(self) -> list[Tensor]:
        """Adjoints that only this kind of body has."""
        return []

    def nodes_adjoint(self) -> Tensor:
        """Derivative of the loss by the nodes' velocities where the adjoint stands now, [R, nodes, 4]."""
        raise NotImplementedError

    def gradients(self) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts, as the caller counts."""
        size = (self.rollouts, self.particles)
        bars = self._of_caller(self._bars, 1).unflatten(1, size)
        state = {name: self._of_caller(bar, 0).unflatten(0, size) for name, bar in self.state_bars.items()}
        sums = self._sums.unflatten(1, size).sum(2).T
        node_sums = self._node_sums.unflatten(1, (self.rollouts, -1)).sum(2).T
        self._settle_weight()
        rows = bars.transpose(0, 1)
        given = rows, state, sums, node_sums, self._network_bars(), self._volume, self._weight_bar
        return self._rows.gradients(*given, self._element_bars())

    def _network_bars(self) -> dict[str, Tensor]:
        """Adjoints of networks' weights by "elastic" and "plastic", each [R, W]."""
        return {}

    def _element_bars(self) -> dict[str, Tensor]:
        """Adjoints of parameters through the elements of a thin body, by name."""
        return {}
