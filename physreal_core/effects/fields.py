"""A rollout's inputs at their full shapes, whatever the caller left out: what an effect reads and adds to."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.effects.effect import Inputs, Setting, Values

_DORMANT: dict[str, Callable[[Setting], Array | tuple]] = {
    "gravity": lambda setting: setting.gravity,
    "density": lambda setting: setting.body.density,
    "initial_position": lambda setting: setting.body.x0,
    "initial_deformation": lambda setting: np.broadcast_to(np.eye(3), (len(setting.body.x0), 3, 3)).copy(),
}


def field(inputs: Inputs, name: str, setting: Setting) -> Tensor:
    """A parameter that the caller may have left out, in SI units and of its full shape.

    Args:
        inputs: of the rollout.
        name: gravity [3], density [N], initial_position [N, 3] or initial_deformation [N, 3, 3].
        setting: has the dormant value.
    """
    value = getattr(inputs.parameters, name)
    return like(inputs, _DORMANT[name](setting)) if value is None else value


def youngs_modulus(inputs: Inputs, setting: Setting) -> Float[Tensor, " particles"]:
    """Of every particle [Pa], shape [N]."""
    return inputs.parameters.youngs_modulus.expand(len(setting.body.x0))


def lame(inputs: Inputs, setting: Setting) -> tuple[Float[Tensor, " particles"], Float[Tensor, " particles"]]:
    """Lame's mu and lambda of every particle [Pa], shapes [N]."""
    E, nu = youngs_modulus(inputs, setting), inputs.parameters.poissons_ratio
    return E / (2 * (1 + nu)), E * nu / ((1 + nu) * (1 - 2 * nu))


def changed(inputs: Inputs, **parameters: Tensor) -> Inputs:
    """The inputs with some parameters replaced."""
    return replace(inputs, parameters=replace(inputs.parameters, **parameters))


def added(inputs: Inputs, **amounts: Tensor) -> Inputs:
    """The inputs with amounts added to parameters whose dormant value is zero."""
    present = {name: getattr(inputs.parameters, name) for name in amounts}
    return changed(inputs, **{n: a if present[n] is None else present[n] + a for n, a in amounts.items()})


def like(inputs: Inputs, array: Array | tuple) -> Tensor:
    """An array as a tensor of the inputs' type and device."""
    return torch.as_tensor(np.asarray(array)).to(inputs.parameters.youngs_modulus)


def vector(values: Values, *names: str, like: Tensor) -> Float[Tensor, " names"]:
    """Coefficients side by side, of the type and device of a tensor."""
    return torch.stack([values[name].to(like) for name in names])
