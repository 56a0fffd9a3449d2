"""What a rollout is differentiated by, and what it returns: torch tensors in SI units."""

from dataclasses import dataclass, fields

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError


@dataclass
class Parameters:
    """Parameters of a rollout; any of them may require a gradient. None stands for zero, or for a part not in use.

    Args:
        youngs_modulus: [Pa], shape [N] (or one value for all).
        poissons_ratio: in [0, 1/2), shape [N] (or one value for all).
        friction_coefficient: Coulomb's mu_f of the ground, shape [].
        grip_stiffness: k_f [N] (force at unit strain of a bond of weight one), shape [].
        grip_damping: dashpot along the bond [N s/m], shape [].
        plastic: the plastic law's own two numbers (`constitutive.PLASTIC_PARAMETERS`), shape [N, 2] (or [2]): von Mises
            yield stress [Pa] and viscosity [Pa s]; Drucker-Prager friction angle [rad] and cohesion [Pa].
        latent_elastic, latent_plastic: latent codes of the neural residuals, shape [N, L].
        network_elastic, network_plastic: flat weights of the neural residuals, shape [W].
        initial_velocity: [m/s], shape [N, 3] (or [3]).
    """

    youngs_modulus: Float[Tensor, "..."]
    poissons_ratio: Float[Tensor, "..."]
    friction_coefficient: Float[Tensor, "..."] | None = None
    grip_stiffness: Float[Tensor, "..."] | None = None
    grip_damping: Float[Tensor, "..."] | None = None
    plastic: Float[Tensor, "... 2"] | None = None
    latent_elastic: Float[Tensor, "... particles latent"] | None = None
    latent_plastic: Float[Tensor, "... particles latent"] | None = None
    network_elastic: Float[Tensor, "... weights"] | None = None
    network_plastic: Float[Tensor, "... weights"] | None = None
    initial_velocity: Float[Tensor, "... 3"] | None = None


PARAMETER_NAMES = tuple(field.name for field in fields(Parameters))


@dataclass
class States:
    """Particle states at frame times, frame 0 first: x [T, N, 3] m, v [T, N, 3] m/s, F [T, N, 3, 3]."""

    x: Float[Tensor, "*rollouts frames particles 3"]
    v: Float[Tensor, "*rollouts frames particles 3"]
    F: Float[Tensor, "*rollouts frames particles 3 3"]


def complete(parameters: Parameters, shapes: dict[str, tuple[int, ...]], dtype: torch.dtype, device: str) -> Parameters:
    """Every parameter in use as a tensor of its full shape, type and device; differentiable.

    Args:
        parameters: as given by the caller.
        shapes: full shape of every parameter in use; parameters that are not a key become None.
        dtype: scalar type of the simulator.
        device: torch device of the simulator.

    Raises:
        InputError: for a value that is missing, of the wrong shape or outside its range.
    """
    tensors = {}
    for name, shape in shapes.items():
        value = getattr(parameters, name)
        where = f"Parameters.{name}"
        if value is None:
            if name in ("youngs_modulus", "poissons_ratio", "plastic", "network_elastic", "network_plastic"):
                raise InputError("missing", where=where, expected=f"a tensor of shape {shape}")
            value = torch.zeros(shape)
        try:
            tensors[name] = torch.as_tensor(value).to(device=device, dtype=dtype).expand(shape)
        except RuntimeError as error:
            raise InputError(f"shape {tuple(value.shape)}", where=where, expected=f"{shape}") from error
    _check_range("youngs_modulus", tensors, lambda E: E > 0, "positive values [Pa]")
    _check_range("poissons_ratio", tensors, lambda nu: (nu > -1) & (nu < 0.5), "values in (-1, 1/2)")
    for name in ("friction_coefficient", "grip_stiffness", "grip_damping"):
        _check_range(name, tensors, lambda value: value >= 0, "a value >= 0")
    return Parameters(**{name: tensors.get(name) for name in PARAMETER_NAMES})


def _check_range(name: str, tensors: dict[str, Tensor], valid, expected: str) -> None:
    if name not in tensors:
        return
    value = tensors[name].detach()
    good = valid(value) & torch.isfinite(value)
    if not bool(good.all()):
        raise InputError(f"{value[~good].flatten()[0].item():g}", where=f"Parameters.{name}", expected=expected)
