"""Adam's step (Kingma and Ba 2015, algorithm 1). torch.optim is not used because importing it costs every stage a second."""

import math

import torch
from torch import Tensor

BETAS = (0.5, 0.9)
"""Short memories: the objective has no noise and the runs few steps, so old gradients only make them overshoot."""
EPSILON = 1e-8


@torch.no_grad()
def adam_step(value: Tensor, gradient: Tensor, first: Tensor, second: Tensor, rate: float, count: int) -> None:
    """Moves `value` against `gradient` and updates both moments, all in place.

    Args:
        value, gradient, first, second: of one shape; the moments are zero before the first step.
        rate: the step that a gradient of steady sign takes in each entry.
        count: steps taken with this one, from 1.
    """
    first.lerp_(gradient, 1.0 - BETAS[0])
    second.mul_(BETAS[1]).addcmul_(gradient, gradient, value=1.0 - BETAS[1])
    deviation = second.sqrt().div_(math.sqrt(1.0 - BETAS[1] ** count)).add_(EPSILON)
    value.addcdiv_(first, deviation, value=-rate / (1.0 - BETAS[0] ** count))
