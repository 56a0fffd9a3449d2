"""The cross-entropy method: a Gaussian over plans is drawn from, and fitted to the cheapest of what was drawn, again and again.

Rubinstein, "The cross-entropy method for combinatorial and continuous optimization", 1999; with the smoothing of de Boer et al., "A
tutorial on the cross-entropy method", 2005, sec. 3.2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from physreal_core.array_types import Float
from physreal_core.errors import InputError


@dataclass(frozen=True)
class SearchConfig:
    """How long and how widely is searched.

    Args:
        samples: plans drawn in a round.
        elites: cheapest of them, to which the Gaussian is fitted.
        rounds: how often.
        smoothing: share of the Gaussian before that is kept in a round.
        narrowest: standard deviation that the Gaussian keeps, as a share of that at the start.
        seed: of the draws; the same seed gives the same plan.
    """

    samples: int = 32
    elites: int = 6
    rounds: int = 6
    smoothing: float = 0.1
    narrowest: float = 0.02
    seed: int = 0

    def __post_init__(self) -> None:
        if not (1 < self.elites <= self.samples and self.rounds >= 1):
            raise InputError(
                f"{self.elites} elites of {self.samples} samples in {self.rounds} rounds",
                where="SearchConfig",
                expected="at least two elites, no more than samples, and a round",
            )


@dataclass(frozen=True)
class Found:
    """The cheapest plan.

    Attributes:
        plan: of the given shape.
        cost: of it.
        history: least cost after every round.
    """

    plan: Float[Tensor, "*plan"]
    cost: float
    history: tuple[float, ...]


def search(
    cost: Callable[[Tensor], Tensor],
    start: Float[Tensor, "*plan"],
    spread: Float[Tensor, "*plan"],
    config: SearchConfig,
    feasible: Callable[[Tensor], Tensor] = lambda plans: plans,
) -> Found:
    """The cheapest plan that is drawn.

    Args:
        cost: of plans [samples, ...], shape [samples]; infinite or not a number for those that cannot be done.
        start: a first guess, which is tried itself.
        spread: standard deviation of each number around it.
        config: how long and how widely.
        feasible: draws plans into their bounds.

    Raises:
        InputError: no plan that was tried has a finite cost.
    """
    random = torch.Generator().manual_seed(config.seed)
    mean, deviation = start.double(), spread.double().expand(start.shape).clone()
    narrowest = config.narrowest * deviation
    best, least, history = start.double(), float("inf"), []
    for _ in range(config.rounds):
        drawn = mean + deviation * torch.randn(config.samples, *start.shape, generator=random, dtype=torch.float64)
        drawn[0] = best
        drawn = feasible(drawn)
        with torch.no_grad():
            costs = cost(drawn).detach().cpu().double()
        costs = torch.where(torch.isfinite(costs), costs, torch.inf)
        order = torch.argsort(costs, stable=True)
        if costs[order[0]] < least:
            best, least = drawn[order[0]], float(costs[order[0]])
        history.append(least)
        elite = drawn[order[: config.elites]][torch.isfinite(costs[order[: config.elites]])]
        if len(elite) > 1:
            keep = config.smoothing
            mean = keep * mean + (1 - keep) * elite.mean(0)
            deviation = torch.maximum(keep * deviation + (1 - keep) * elite.std(0, correction=0), narrowest)
    if least == float("inf"):
        raise InputError(
            f"none of {config.rounds * config.samples} plans can be simulated",
            where="planning.search",
            expected="ways of the hand that the body bears",
            remedy="narrow the hand's bounds or slow it down",
        )
    return Found(best, least, tuple(history))
