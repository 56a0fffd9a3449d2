"""The gradient of a plan's cost through controller points and simulator, against finite differences; and what it is good for."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.planning import Cost, Planner, PointsToPlaces, TargetShape
from physreal_core.planning.refine import refine
from tests.planning.scene import BOUNDS, CONFIG, forecast, given, hidden_way

GOALS = {
    "places": lambda end: PointsToPlaces(np.arange(len(end)), end),
    "shape": TargetShape,
}


def costs(kind: str):
    """A plan's cost as a function of its knots in float64, by two models; and knots."""
    problem, model, grasps = given("float64")
    model = dataclasses.replace(model, simulation={**model.simulation, "ground_height": None})
    softer = model.with_fields(youngs_modulus=0.7 * model.fields["youngs_modulus"])
    own = forecast(problem, model, members=(model.fields, softer.fields))
    end = problem.body.x0 + np.array([0.02, 0.03, 0.05])
    planner = Planner(own, Cost(GOALS[kind](end)), grasps, BOUNDS, CONFIG)
    done = np.zeros((1, 1, 3))
    way, known = planner._way(done), planner._known(done, None)
    random = torch.Generator().manual_seed(0)
    knots = 0.02 * torch.randn(way.shape, generator=random, dtype=torch.float64) + torch.tensor([0.01, 0.02, 0.05])
    assert torch.allclose(way.feasible(knots), knots, atol=1e-12)  # no bound holds it, where there would be a corner
    return lambda plan: planner._costs(own, way, done, plan[None], known)[0], knots


@pytest.mark.parametrize("kind", GOALS)
def test_the_gradient_is_that_of_finite_differences(kind):
    """In float64, along three directions, in the air: contact has corners, across which a difference is none of the slope (the simulator's own
    tests hold its slope there). So has a shape where the nearest point changes."""
    cost, knots = costs(kind)
    plan = knots.clone().requires_grad_(True)
    (slope,) = torch.autograd.grad(cost(plan), plan)
    random = torch.Generator().manual_seed(1)
    for _ in range(3):
        direction = torch.randn(knots.shape, generator=random, dtype=torch.float64)
        step = 1e-6
        with torch.no_grad():
            difference = float(cost(knots + step * direction) - cost(knots - step * direction)) / (2 * step)
        assert float((slope * direction).sum()) == pytest.approx(difference, rel=1e-6)


def test_it_lowers_the_cost_of_a_plan_and_keeps_the_best():
    problem, model, grasps = given()
    own = forecast(problem, model)
    with torch.no_grad():
        moved = torch.from_numpy(hidden_way(CONFIG.frames, CONFIG.rest, (0.02, 0.03, 0.05)))
        end = own(grasps.controllers(moved)[None], 5).points[0, 0].mean(0).double().numpy()
    planner = Planner(own, Cost(PointsToPlaces(np.arange(len(end)), end)), grasps, BOUNDS, CONFIG)
    done = np.zeros((1, 1, 3))
    way = planner._way(done)
    known = planner._known(done, None)
    cost = lambda plan: planner._costs(own, way, done, plan[None], known)[0]
    better = refine(cost, way.straight(np.zeros((1, 3))), 0.01, 12)
    assert better.before == pytest.approx(float(cost(way.straight(np.zeros((1, 3))))), rel=1e-6)
    assert better.cost < 0.05 * better.before
    assert better.cost == pytest.approx(float(cost(better.plan)), rel=1e-6)


def test_it_turns_back_where_the_cost_is_not_finite():
    def walled(plan):
        return (plan - 1.0).square().sum() * (torch.nan if plan[0] > 0.5 else 1.0)

    better = refine(walled, torch.zeros(2, dtype=torch.float64), 0.1, 20)
    assert np.isfinite(better.cost) and better.cost <= better.before == 2.0
