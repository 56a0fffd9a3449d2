"""A plan improved along its gradient, which the simulator's adjoint gives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from physreal_core.array_types import Array, Float


@dataclass(frozen=True)
class Refined:
    """A plan that costs no more than the one before.

    Attributes:
        plan: the cheapest that was tried.
        cost: of it.
        before: of the plan that was given.
        evaluations: of cost and gradient.
    """

    plan: Float[Tensor, "*plan"]
    cost: float
    before: float
    evaluations: int


def refine(
    cost: Callable[[Tensor], Tensor],
    plan: Float[Tensor, "*plan"],
    scale: float,
    evaluations: int = 12,
) -> Refined:
    """L-BFGS (Liu and Nocedal 1989) from a plan on, for a number of evaluations.

    The cost is smooth but where the hand comes to a bound or the body makes or loses contact, so the line search may fail there; what is
    returned is the cheapest plan that was tried.

    Args:
        cost: of one plan, shape []; differentiable.
        plan: where it begins.
        scale: size of a change that matters, in the plan's unit: the first step is about as long.
        evaluations: at most about so many.
    """
    from scipy.optimize import minimize

    tried: list[tuple[float, Array]] = []

    def measured(numbers: Array) -> tuple[float, Array]:
        own = torch.from_numpy(scale * numbers).reshape(plan.shape).requires_grad_(True)
        value = cost(own)
        (slope,) = torch.autograd.grad(value, own)
        # Where the simulation fails the line search has to turn back.
        known = bool(torch.isfinite(value)) and bool(torch.isfinite(slope).all())
        tried.append((float(value.detach()) if known else np.inf, numbers.copy()))
        return (tried[-1][0], scale * slope.double().numpy().ravel()) if known else (1e9, np.zeros_like(numbers))

    start = plan.detach().double().numpy().ravel() / scale
    minimize(measured, start, jac=True, method="L-BFGS-B", options={"maxfun": evaluations, "maxiter": evaluations})
    value, numbers = min(tried, key=lambda one: one[0])
    best = torch.from_numpy(scale * numbers).reshape(plan.shape)
    return Refined(best, value, tried[0][0], len(tried))
