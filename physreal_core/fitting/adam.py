"""Adam's step (Kingma and Ba 2015, algorithm 1). torch.optim is not used because importing it costs every stage a second."""

import math

import torch
from torch import Tensor

BETAS = (0.5, 0.9)
"""Short memories: the objective has no noise and the runs few steps, so old gradients only make them overshoot."""
EPSILON = 1e-8
LONGEST = 4.0
"""How long a gradient may be, in root mean squares of those before it."""


@torch.no_grad()
def adam_step(value: Tensor, gradient: Tensor, first: Tensor, second: Tensor, rate: float, count: int) -> None:
    """Moves `value` against `gradient` and updates both moments, all in place.

    Args:
        value, gradient, first, second: of one shape; the moments are zero before the first step.
        rate: the step that a gradient of steady sign takes in each entry.
        count: steps taken with this one, from 1.
    """
    gradient = _clipped(gradient, second, count)
    first.lerp_(gradient, 1.0 - BETAS[0])
    second.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1.0 - BETAS[1])
    deviation = second.sqrt().div_(math.sqrt(1.0 - BETAS[1] ** count)).add_(EPSILON)
    value.addcdiv_(first, deviation, value=-rate / (1.0 - BETAS[0] ** count))


def _clipped(gradient: Tensor, second: Tensor, count: int) -> Tensor:
    """The gradient, no longer than `LONGEST` times the root mean square of those before it.

    Through contact over many thousand substeps a gradient can be 1e9 times too long at a single point. In the second moment one
    such gradient would stand in the way of hundreds of steps.
    """
    if count == 1:
        return gradient
    usual = float(second.mean().sqrt()) / math.sqrt(1.0 - BETAS[1] ** (count - 1))
    length = float(gradient.square().mean().sqrt())
    return gradient * (LONGEST * usual / length) if 0.0 < LONGEST * usual < length else gradient
