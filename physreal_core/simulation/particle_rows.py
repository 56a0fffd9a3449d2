"""What a body's particles are given in every form of the step, as rows of an array, and the adjoints that come back.

Rows of the constants: those of `CONSTANTS`, then with optional terms those of `TERM_ROWS`, then the latent codes. Rows of their
adjoints: `BARS`, with optional terms `INPUTS` and `TERM_ROWS`, then the latent codes. What particles or nodes share has
its adjoint among `SUMS`.
"""

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.layout import Rows
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.terms import FORCE_TERMS, PARTICLES, STRESS_TERMS, TERMS, term_shapes

CONSTANTS = Rows(
    "constant",
    (
        ("place", 3),  # on the grid [m]
        ("reach", 1),  # half of the particle's size [m]
        ("touch_height", 1),  # z below which the particle touches the ground [m]
        ("mass", 1),
        ("volume", 1),
        ("load", 3),
        ("youngs_modulus", 1),
        ("poissons_ratio", 1),
        ("plastic", 2),
    ),
)
BARS = Rows("bar", (("youngs_modulus", 1), ("poissons_ratio", 1), ("plastic", 2)))
INPUTS = Rows("input", (("mass", 1), ("load", 3)))
_PARTICLE_LAWS = [item for term in FORCE_TERMS + STRESS_TERMS for item in TERMS[term].items()]
TERM_ROWS = Rows(
    "row",
    (
        *((name, p.size) for name, p in _PARTICLE_LAWS if PARTICLES in p.shape),
        ("start_height", 1),  # z of the particle where the rollout starts [m]
    ),
)
"""Parameters of optional laws that each particle has."""
NUMBERS = Rows("number", tuple((name, p.size) for name, p in _PARTICLE_LAWS if PARTICLES not in p.shape))
"""Parameters of optional laws that all particles share."""
PARTICLE_SUMS = Rows(
    "particle_sum",
    (
        ("grip_stiffness", 1),
        ("grip_damping", 1),
        ("tool_stiffness", 1),
        ("tool_friction", 1),
        ("numbers", NUMBERS.count),
    ),
)
NODE_SUMS = Rows("node_sum", (("friction_coefficient", 1), ("gravity", 3), ("friction_law", 3), ("layer_friction", 1)))


class ParticleRows:
    """The rows of one body under one configuration.

    Args:
        config: of the simulation.
        particles: N.
        gripped: whether there are bonds to controller points.
        pushed: whether there is a tool.

    Attributes:
        shapes: full shape of every parameter in use by name, without the axis of rollouts.
        constants, bars: rows by name.
        constant_count, bar_count: all rows.
    """

    def __init__(self, config: SimulationConfig, particles: int, gripped: bool, pushed: bool = False) -> None:
        self._terms = config.terms
        latent = {kind: 0 if r is None or r.thin else r.latent_size for kind, r in _residuals(config)}
        codes = tuple((f"latent_{kind}", size) for kind, size in latent.items() if size)
        optional = TERM_ROWS.sizes if config.terms else ()
        inputs = INPUTS.sizes if config.terms else ()
        constants = Rows("", CONSTANTS.sizes + optional + codes)
        bars = Rows("", BARS.sizes + inputs + optional + codes)
        self.constants, self.constant_count = constants.places(), constants.count
        self.bars, self.bar_count = bars.places(), bars.count
        self.shapes = _shapes(config, particles, gripped, pushed)

    def fill_body(
        self,
        rows: Float[Tensor, "rollouts rows particles"],
        place: Float[Tensor, "particles 3"],
        reach: Float[Tensor, " particles"],
        touch_height: Float[Tensor, " particles"],
        volume: Float[Tensor, " particles"],
    ) -> None:
        """Put what the body alone gives into the rows.

        Args:
            rows: constants of R rollouts.
            place: of the particles on the grid [m].
            reach: half of a particle's size [m].
            touch_height: z below which a particle touches the ground [m].
            volume: [m3].
        """
        for name, value in (("place", place), ("reach", reach), ("touch_height", touch_height), ("volume", volume)):
            self._put(rows, name, value.expand(len(rows), *value.shape))

    def fill(
        self,
        rows: Float[Tensor, "rollouts rows particles"],
        parameters: Parameters,
        mass: Float[Tensor, "rollouts particles"],
        load: Float[Tensor, "rollouts particles 3"],
        start: Float[Tensor, "particles 3"],
    ) -> None:
        """Put a rollout's parameters into the rows; what the body alone gives stands there already.

        Args:
            rows: constants of R rollouts.
            parameters: complete, with an axis of rollouts.
            mass, load: mass [kg] and constant force [N] of the particles.
            start: the body's positions [m], where a rollout has none of its own.
        """
        self._put(rows, "mass", mass)
        self._put(rows, "load", load)
        names = self.constants.keys() & (self.shapes.keys() - {"density", "force"})
        for name in names:
            self._put(rows, name, getattr(parameters, name).detach())
        if self._terms:
            x = parameters.initial_position
            self._put(rows, "start_height", (start if x is None else x.detach())[..., 2])

    def _put(self, rows: Tensor, name: str, value: Tensor) -> None:
        """value: [R, N] or [R, N, rows of it]."""
        target = rows[:, self.constants[name]]
        target.copy_(value.movedim(-1, 1) if value.ndim == 3 else value[..., None, :])

    def numbers(self, parameters: Parameters) -> Float[Tensor, "rollouts numbers"]:
        """Values of `NUMBERS`, zero where a law is not in use."""
        E = parameters.youngs_modulus
        values = E.new_zeros(len(E), NUMBERS.count)
        for name, place in NUMBERS.places().items():
            value = getattr(parameters, name)
            if value is not None:
                values[:, place] = value.detach().reshape(len(E), -1)
        return values

    def gradients(
        self,
        bars: Float[Tensor, "rollouts rows particles"],
        state_bars: dict[str, Tensor],
        particle_sums: Float[Tensor, "rollouts particle_sums"],
        node_sums: Float[Tensor, "rollouts node_sums"],
        networks: dict[str, Tensor],
        volume: Float[Tensor, " particles"],
        weight_bar: Float[Tensor, "..."],
        elements: dict[str, Tensor] | None = None,
    ) -> dict[str, Tensor]:
        """Adjoints of the parameters in use by name, with an axis of rollouts.

        Args:
            bars: adjoints of the rows.
            state_bars: of the state at the start by name, each [R, N, ...].
            particle_sums, node_sums: of what particles or nodes share.
            networks: weights' adjoints by "elastic" and "plastic", each [R, W].
            volume: of the particles [m3].
            weight_bar: of gravity through what takes the weight off added mass, shape [R, 3] or one zero.
            elements: adjoints of parameters through the elements of a thin body, by name.
        """
        found = {"initial_velocity": state_bars["v"], "initial_position": state_bars["x"].clone()}
        if "mean_velocity" in state_bars:
            found["initial_velocity"] = state_bars["v"] + state_bars["mean_velocity"]
        if "initial_director" in self.shapes:
            found["initial_director"] = torch.zeros_like(state_bars["x"])  # the elements' to add to
        if "shape" in state_bars:
            found["initial_deformation"] = state_bars["F"] + state_bars["shape"]
        found |= {name: bars[:, place].movedim(1, -1) for name, place in self.bars.items()}
        found |= _split(PARTICLE_SUMS, particle_sums) | _split(NODE_SUMS, node_sums)
        found |= _split(NUMBERS, found.pop("numbers"))
        found |= {f"network_{kind}": bar for kind, bar in networks.items()}
        if self._terms:
            found["density"], found["force"] = volume * found["mass"][..., 0], found["load"]
            found["initial_position"][..., 2] += found["start_height"][..., 0]
            found["gravity"] = found["gravity"] + weight_bar
        for name, bar in (elements or {}).items():
            found[name] = found[name].reshape(bar.shape) + bar if name in found else bar
        return {name: found[name].reshape(len(bars), *shape).clone() for name, shape in self.shapes.items()}


def _split(rows: Rows, values: Tensor) -> dict[str, Tensor]:
    return {name: values[:, place] for name, place in rows.places().items()}


def _residuals(config: SimulationConfig) -> list[tuple]:
    return [("elastic", config.elastic_residual), ("plastic", config.plastic_residual)]


def _shapes(config: SimulationConfig, particles: int, gripped: bool, pushed: bool) -> dict[str, tuple[int, ...]]:
    n = particles
    shapes = {"youngs_modulus": (n,), "poissons_ratio": (n,), "initial_velocity": (n, 3)}
    if config.ground_height is not None:
        shapes["friction_coefficient"] = ()
    if config.self_contact:
        shapes["layer_friction"] = ()
    if gripped:
        shapes |= {"grip_stiffness": (), "grip_damping": ()}
    if pushed:
        shapes |= {"tool_stiffness": (), "tool_friction": ()}
    if config.plastic_law != "identity":
        shapes["plastic"] = (n, 2)
    for kind, residual in _residuals(config):
        if residual is not None:
            shapes[f"network_{kind}"] = (residual.weight_count,)
            if residual.latent_size:
                shapes[f"latent_{kind}"] = (n, residual.latent_size)
    return shapes | term_shapes(config.terms, n)
