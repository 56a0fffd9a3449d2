"""The search on functions whose minima are known."""

import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.planning.search import SearchConfig, search

AIM = torch.tensor([[0.3, -0.2], [0.1, 0.4]], dtype=torch.float64)


def bowl(plans: torch.Tensor) -> torch.Tensor:
    return (plans - AIM).square().sum((1, 2))


def test_it_comes_near_the_minimum_and_never_back():
    found = search(bowl, torch.zeros(2, 2), torch.full((2, 2), 0.3), SearchConfig(samples=40, elites=8, rounds=12))
    assert found.cost < 1e-3 < bowl(torch.zeros(1, 2, 2))[0]
    assert list(found.history) == sorted(found.history, reverse=True)
    assert found.cost == pytest.approx(float(bowl(found.plan[None])[0]))


def test_a_seed_gives_one_plan():
    run = lambda seed: search(bowl, torch.zeros(2, 2), torch.ones(2, 2), SearchConfig(rounds=3, seed=seed)).plan
    assert torch.equal(run(1), run(1)) and not torch.equal(run(1), run(2))


def test_bounds_hold_and_plans_that_fail_are_left_out():
    def failing(plans):
        assert float(plans.max()) <= 0.2 + 1e-12
        return torch.where(plans[:, 0, 0] < 0.0, torch.nan, bowl(plans))

    config = SearchConfig(samples=40, elites=8, rounds=8)
    found = search(failing, torch.zeros(2, 2), torch.ones(2, 2), config, lambda plans: plans.clamp_max(0.2))
    assert found.plan[0, 0] >= 0.0
    assert found.cost == pytest.approx(0.1**2 + 0.2**2, rel=0.2)


def test_it_says_where_no_plan_can_be_done():
    with pytest.raises(InputError, match="can be simulated"):
        search(lambda plans: torch.full((len(plans),), torch.inf), torch.zeros(2, 2), torch.ones(2, 2), SearchConfig())
