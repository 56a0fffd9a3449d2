"""What a rollout is differentiated by, and what it returns: torch tensors in SI units."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from functools import cached_property

import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError, SimulationError
from physreal_core.simulation.terms import TERM_OF


@dataclass
class Parameters:
    """Parameters of a rollout; any of them may require a gradient. None stands for zero, or for a part not in use.

    Those of an optional term (`terms.TERMS`) are for a configuration that names it; None is then the term's dormant value.

    Args:
        youngs_modulus: [Pa], shape [N] (or one value for all).
        poissons_ratio: in [0, 1/2), shape [N] (or one value for all).
        friction_coefficient: Coulomb's mu_f of the ground, shape [].
        grip_stiffness: k_f [N] (force at unit strain of a bond of weight one), shape [].
        grip_damping: dashpot along the bond [N s/m], shape [].
        tool_stiffness: of the push of a tool, per mass and depth [1/s2], shape [].
        tool_friction: Coulomb's mu of a tool, shape [].
        plastic: the plastic law's own two numbers (`laws.PLASTIC_LAWS`), shape [N, 2] (or [2]): von Mises
            yield stress [Pa] and viscosity [Pa s]; Drucker-Prager friction angle [rad] and cohesion [Pa].
        latent_elastic, latent_plastic: latent codes of the neural residuals, shape [N, L].
        network_elastic, network_plastic: flat weights of the neural residuals, shape [W].
        initial_velocity: [m/s], shape [N, 3] (or [3]).
        gravity: acceleration [m/s2], shape [3]; instead of the configuration's.
        density: [kg/m3], shape [N]; instead of the body's, for inertia and weight.
        force: constant force on every particle [N], shape [N, 3]; besides the loads.
        initial_position: where the rollout starts [m], shape [N, 3]; instead of the body's x0.
        initial_deformation: deformation gradient at the start, shape [N, 3, 3]; instead of 1, for a body under stress.
        linear_drag, quadratic_drag: c1 [N s/m] and c2 [N s2/m2] of the force -(c1 + c2 |v|) v, shape [N].
        adhesion: largest pull of the place that a particle starts from [N], shape [N].
        adhesion_range: height at which it is reached [m], shape [].
        obstacle: a capsule's centre [m], half axis [m] (0 for a ball), radius [m] and stiffness [1/s2], shape [8].
        solid_reach: how far from a solid's surface a particle is pushed [m], shape [N]; half of its size by default.
        solid_stiffness: of the push of solids, per mass and depth [1/s2], shape []; 1e6 by default.
        solid_friction: Coulomb's mu of solids, shape []; 0.5 by default.
        viscosity: Kelvin-Voigt shear and volume (lambda) viscosity [Pa s], shape [N, 2].
        stiffening: Yeoh's second coefficient c of c (I1_bar - 3)^2 [Pa], shape [N].
        fibre_modulus: k of k / 8 (|F a|^2 - 1)^2 [Pa], shape [N].
        fibre_direction: unit vector a of the undeformed body, shape [N, 3].
        friction_law: static excess of mu_f, the speed over which it fades [m/s], rise with speed [s/m], shape [3].
        relaxation_modulus: shear modulus of one Maxwell branch [Pa], shape [N]. Young's modulus is the one of slow motion.
        relaxation_time: of that branch [s], shape [].
        bending_ratio: bending stiffness of a thin body over that of a homogeneous one, shape [N].
        weft_ratio: a fabric's Young's modulus across `Shell.warp` over that along it, shape [N].
        shear_ratio: its shear modulus over that of an isotropic sheet, shape [N].
        layer_friction: Coulomb's coefficient where the body touches itself (`SimulationConfig.self_contact`), shape [].
        twisting_ratio: twisting stiffness of a framed rod over that of a homogeneous round one, G J with G = E / (2 (1 + nu)),
            shape [N].
        rest_curvature: curvature without stress of a framed rod by its two directors (`thin.rod`) [1/m], shape [N, 2].
        initial_director: directors of its segments where the rollout starts, shape [N, 3]; instead of the body's.
        retardation_time: Kelvin-Voigt's, by which its bending and its twisting lag behind their moments [s], shape [N, 2].
        surface_drag: of the surroundings on a thin body, rho C_d / 2 [kg/m3]: on its area by the square of the speed along its normal
            or across its segments, shape [N].
        hysteresis_modulus: shear moduli of three Maxwell branches [Pa], shape [N, 3].
        hysteresis_time: of these branches [s], shape [3].
    """

    youngs_modulus: Float[Tensor, "..."]
    poissons_ratio: Float[Tensor, "..."]
    friction_coefficient: Float[Tensor, "..."] | None = None
    grip_stiffness: Float[Tensor, "..."] | None = None
    grip_damping: Float[Tensor, "..."] | None = None
    tool_stiffness: Float[Tensor, "..."] | None = None
    tool_friction: Float[Tensor, "..."] | None = None
    plastic: Float[Tensor, "... 2"] | None = None
    latent_elastic: Float[Tensor, "... particles latent"] | None = None
    latent_plastic: Float[Tensor, "... particles latent"] | None = None
    network_elastic: Float[Tensor, "... weights"] | None = None
    network_plastic: Float[Tensor, "... weights"] | None = None
    initial_velocity: Float[Tensor, "... 3"] | None = None
    gravity: Float[Tensor, "... 3"] | None = None
    density: Float[Tensor, "..."] | None = None
    force: Float[Tensor, "... 3"] | None = None
    initial_position: Float[Tensor, "... 3"] | None = None
    initial_deformation: Float[Tensor, "... 3 3"] | None = None
    linear_drag: Float[Tensor, "..."] | None = None
    quadratic_drag: Float[Tensor, "..."] | None = None
    adhesion: Float[Tensor, "..."] | None = None
    adhesion_range: Float[Tensor, "..."] | None = None
    obstacle: Float[Tensor, "... 8"] | None = None
    solid_reach: Float[Tensor, "..."] | None = None
    solid_stiffness: Float[Tensor, "..."] | None = None
    solid_friction: Float[Tensor, "..."] | None = None
    viscosity: Float[Tensor, "... 2"] | None = None
    stiffening: Float[Tensor, "..."] | None = None
    fibre_modulus: Float[Tensor, "..."] | None = None
    fibre_direction: Float[Tensor, "... 3"] | None = None
    friction_law: Float[Tensor, "... 3"] | None = None
    relaxation_modulus: Float[Tensor, "..."] | None = None
    relaxation_time: Float[Tensor, "..."] | None = None
    hysteresis_modulus: Float[Tensor, "... 3"] | None = None
    hysteresis_time: Float[Tensor, "... 3"] | None = None
    bending_ratio: Float[Tensor, "..."] | None = None
    weft_ratio: Float[Tensor, "..."] | None = None
    shear_ratio: Float[Tensor, "..."] | None = None
    twisting_ratio: Float[Tensor, "..."] | None = None
    rest_curvature: Float[Tensor, "... 2"] | None = None
    initial_director: Float[Tensor, "... 3"] | None = None
    retardation_time: Float[Tensor, "... 2"] | None = None
    surface_drag: Float[Tensor, "..."] | None = None
    layer_friction: Float[Tensor, "..."] | None = None


PARAMETER_NAMES = tuple(field.name for field in fields(Parameters))


@dataclass
class States:
    """Particle states at frame times, frame 0 first: x [T, N, 3] m, v [T, N, 3] m/s, F [T, N, 3, 3]."""

    x: Float[Tensor, "*rollouts frames particles 3"]
    v: Float[Tensor, "*rollouts frames particles 3"]
    F: Float[Tensor, "*rollouts frames particles 3 3"]

    @classmethod
    def of(cls, x: Tensor, v: Tensor, F: Tensor | Callable[[], Tensor]) -> "States":
        """States of a body; F may be computed where it is asked for first."""
        return ThinStates(x, v, F) if callable(F) else cls(x, v, F)


@dataclass
class BatchStates(States):
    """States of R rollouts, x [R, T, N, 3] and so on, and what ended each of them early.

    Attributes:
        failures: per rollout None, or the error that `Simulator.rollout` would raise; from the end of the frame it
            names on, that rollout's states are not numbers and give no gradient. The other rollouts are untouched.
    """

    failures: tuple[SimulationError | None, ...] = ()

    @classmethod
    def of(
        cls,
        x: Tensor,
        v: Tensor,
        F: Tensor | Callable[[], Tensor],
        failures: tuple[SimulationError | None, ...] = (),
    ) -> "BatchStates":
        """As of `States`."""
        return ThinBatchStates(x, v, F, failures) if callable(F) else cls(x, v, F, failures)


class _OfPlaces:
    """F of a thin body, which follows from the rest of the state: computed where it is asked for first, differentiable as x is."""

    @cached_property
    def F(self) -> Float[Tensor, "*rollouts frames particles 3 3"]:
        """Deformation gradients of the vertices."""
        if not callable(self._F):
            return self._F
        with torch.set_grad_enabled(self.x.requires_grad):
            return self._F()


class ThinStates(_OfPlaces, States):
    """States of a thin body."""

    def __init__(self, x: Tensor, v: Tensor, F: Tensor | Callable[[], Tensor]) -> None:
        self.x, self.v, self._F = x, v, F


class ThinBatchStates(_OfPlaces, BatchStates):
    """States of rollouts of a thin body."""

    def __init__(
        self, x: Tensor, v: Tensor, F: Tensor | Callable[[], Tensor], failures: tuple[SimulationError | None, ...]
    ) -> None:
        self.x, self.v, self._F, self.failures = x, v, F, failures


REQUIRED = ("youngs_modulus", "poissons_ratio", "plastic", "network_elastic", "network_plastic")


def complete(
    parameters: Parameters,
    shapes: Mapping[str, tuple[int, ...]],
    dormant: Mapping[str, Float[Array, "..."]],
    dtype: torch.dtype,
    device: str,
) -> Parameters:
    """Every parameter in use as a tensor of its full shape, type and device; differentiable.

    Args:
        parameters: as given by the caller.
        shapes: full shape of every parameter in use; parameters that are not a key become None.
        dormant: what those are that the caller leaves out, by name; zero for a name that is not a key.
        dtype: scalar type of the simulator.
        device: torch device of the simulator.

    Raises:
        InputError: for a value that is missing, of the wrong shape, outside its range or of a term not in use.
    """
    _check_terms(parameters, shapes)
    tensors = {}
    for name, shape in shapes.items():
        value = getattr(parameters, name)
        where = f"Parameters.{name}"
        if value is None:
            if name in REQUIRED:
                raise InputError("missing", where=where, expected=f"a tensor of shape {shape}")
            value = dormant.get(name, 0.0)
        value = torch.as_tensor(value)
        try:
            tensors[name] = value.to(device=device, dtype=dtype).expand(shape)
        except RuntimeError as error:
            raise InputError(f"shape {tuple(value.shape)}", where=where, expected=f"{shape}") from error
    _check_ranges(tensors)
    return Parameters(**{name: tensors.get(name) for name in PARAMETER_NAMES})


def _check_terms(parameters: Parameters, shapes: Mapping[str, tuple[int, ...]]) -> None:
    for name, term in TERM_OF.items():
        if name not in shapes and getattr(parameters, name) is not None:
            raise InputError(
                f"given, but the term {term!r} is not in use",
                where=f"Parameters.{name}",
                expected=f"None, or {term!r} in SimulationConfig.terms",
            )


def _check_ranges(tensors: dict[str, Tensor]) -> None:
    _check_range("youngs_modulus", tensors, lambda E: E > 0, "positive values [Pa]")
    _check_range("poissons_ratio", tensors, lambda nu: (nu > -1) & (nu < 0.5), "values in (-1, 1/2)")
    own = (
        "friction_coefficient",
        "layer_friction",
        "grip_stiffness",
        "grip_damping",
        "tool_stiffness",
        "tool_friction",
        "solid_stiffness",
        "solid_friction",
        "retardation_time",
        "surface_drag",
    )
    for name in own:
        _check_range(name, tensors, lambda value: value >= 0, "a value >= 0")
    positive = {"density", "adhesion_range", "relaxation_time", "hysteresis_time"}
    positive |= {"bending_ratio", "weft_ratio", "shear_ratio", "twisting_ratio"}
    for name in sorted(positive):
        _check_range(name, tensors, lambda value: value > 0, "positive values")
    for name in TERM_OF.keys() - positive:
        _check_range(name, tensors, torch.isfinite, "finite values")
    _check_range("friction_law", tensors, lambda law: law[..., 1:2] > 0, "a positive static speed, the second number")


def _check_range(name: str, tensors: dict[str, Tensor], valid, expected: str) -> None:
    if name not in tensors:
        return
    value = tensors[name].detach()
    good = valid(value) & torch.isfinite(value)
    if not bool(good.all()):
        raise InputError(f"{value[~good].flatten()[0].item():g}", where=f"Parameters.{name}", expected=expected)


def row_of(parameters: Parameters, rollout: int) -> Parameters:
    """Those of one rollout, without the axis."""
    values = {f.name: getattr(parameters, f.name) for f in fields(Parameters)}
    return Parameters(**{name: None if value is None else value[rollout] for name, value in values.items()})
