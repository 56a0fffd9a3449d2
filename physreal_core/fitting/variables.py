"""What a fit may move: each variable's range, its map to the unconstrained coordinate Adam moves, and its step.

Young's modulus, friction and stiffness are moved in the logarithm, Poisson's ratio in the logit of its range, latent codes
and network weights as they are.
"""

import math
from dataclasses import dataclass
from typing import Literal

import torch
from torch import Tensor

from physreal_core.errors import InputError

Transform = Literal["log", "logit", "identity"]

TRANSFORMS: dict[str, Transform] = {
    "youngs_modulus": "log",
    "poissons_ratio": "logit",
    "friction_coefficient": "log",
    "grip_stiffness": "log",
    "grip_damping": "log",
    "tool_stiffness": "log",
    "tool_friction": "log",
    "layer_friction": "log",
    "bending_ratio": "log",
    "weft_ratio": "log",
    "shear_ratio": "log",
    "latent_elastic": "identity",
    "latent_plastic": "identity",
    "network_elastic": "identity",
    "network_plastic": "identity",
}
"""How the stages move each field of a model."""

RATIOS = {"bending_ratio": "youngs_modulus"}
"""Fields that are ratios to another one, and which: the free coordinate of such a field is that of its product with the other over where the
other starts. So a step of Young's modulus changes how a thin body stretches and leaves how it bends, which shows far more."""

_EDGE = 1e-6
"""A value on the edge of its range starts this fraction of the range inside, where the logit is finite."""

_ROUNDING = 1e-9
"""By which a value at the end of its range may be off after it went through a logarithm."""


@dataclass(frozen=True)
class Variable:
    """One group of numbers a fit may move.

    Args:
        name: field of `Model`, e.g. `youngs_modulus`.
        transform: map to the free coordinate: `log`, `logit` (within the range) or `identity`.
        rate: Adam's step in the free coordinate, per iteration.
        lower, upper: range of the value, in its own unit.
        anchor: weight of mean((free - free at the start)²) in the objective; keeps what the data do not see where it was.
    """

    name: str
    transform: Transform
    rate: float
    lower: float = -math.inf
    upper: float = math.inf
    anchor: float = 0.0

    def __post_init__(self) -> None:
        bounded = math.isfinite(self.lower) and math.isfinite(self.upper) and self.lower < self.upper
        if self.transform != "identity" and not bounded or self.transform == "log" and self.lower <= 0.0:
            raise InputError(
                f"range [{self.lower}, {self.upper}] of {self.name}",
                expected="two finite bounds in ascending order, above zero for a logarithm",
                remedy=f"change the range of {self.name} in params.yaml",
            )

    def free(self, value: Tensor) -> Tensor:
        """The unconstrained coordinate of `value` (same shape). Raises InputError outside the range by more than rounding."""
        lower, upper = (bound - side * _ROUNDING * abs(bound) for bound, side in ((self.lower, 1), (self.upper, -1)))
        if not bool(torch.isfinite(value).all()) or bool((value < lower).any() | (value > upper).any()):
            raise InputError(
                f"{self.name} starts at {value.min().item():g} ... {value.max().item():g}",
                expected=f"a value in [{self.lower:g}, {self.upper:g}]",
                remedy=f"change the initial {self.name} or its range in params.yaml",
            )
        value = value.clamp(self.lower, self.upper)
        if self.transform == "log":
            return value.log()
        if self.transform == "logit":
            fraction = (value - self.lower) / (self.upper - self.lower)
            return torch.logit(fraction.clamp(_EDGE, 1.0 - _EDGE))
        return value.clone()

    def value(self, free: Tensor) -> Tensor:
        """The value at an unconstrained coordinate; differentiable."""
        if self.transform == "log":
            return free.exp()
        if self.transform == "logit":
            return self.lower + (self.upper - self.lower) * torch.sigmoid(free)
        return free

    def of(self, values: dict[str, Tensor], starts: dict[str, Tensor]) -> Tensor:
        """The field's value among those of all variables, `value` of each; another than its own of `RATIOS` alone.

        Args:
            values, starts: of all variables by name, now and where they started.
        """
        other = RATIOS.get(self.name)
        if other not in values:
            return values[self.name]
        return (values[self.name] * (starts[other] / values[other])).clamp(self.lower, self.upper)

    def project(self, free: Tensor) -> Tensor:
        """`free` moved back into the range; only the logarithm and the identity can leave it."""
        if self.transform == "logit":
            return free
        bounds = (math.log(self.lower), math.log(self.upper)) if self.transform == "log" else (self.lower, self.upper)
        return free.clamp(*bounds)
