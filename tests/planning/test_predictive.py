"""Plans that are followed by another body than they were made for."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.planning import Cost, Forecast, Planner, PointsToPlaces, execute
from physreal_core.planning.holding import grasps_at, quick_form, with_grip
from physreal_core.planning.planner import completed
from tests.planning.scene import BOUNDS, CONFIG, finer, forecast, given, hidden_way

GOAL = (0.02, 0.04, 0.06)


class Followed:
    """A body that a plan is tried on, rolled out anew from frame 0 at every call; it is seen `beside` [m] where it is, along x."""

    def __init__(self, own: Forecast, beside: float = 0.0) -> None:
        self._own, self._way, self._beside = own, None, beside
        self.calls = 0

    def advance(self, controllers):
        self.calls += 1
        if self._way is None:
            self._way = controllers[:1]
        assert torch.allclose(self._way[-1], controllers[0])  # it goes on from where the hand is
        self._way = torch.cat([self._way, controllers[1:-1]])
        with torch.no_grad():
            seen = self._own(torch.cat([self._way, controllers[-1:]])[None]).points[0, 0]
        return seen[:-1][-(len(controllers) - 2) :].double().numpy() + [self._beside, 0.0, 0.0]


@pytest.fixture(scope="module")
def bars():
    """The body, its model, the hand, and where a bar of a third of the stiffness comes to be on a hidden way."""
    problem, model, grasps = given()
    true = stiffened(model, 0.3)
    with torch.no_grad():
        moved = torch.from_numpy(hidden_way(CONFIG.frames, CONFIG.rest, GOAL))
        end = forecast(problem, true)(grasps.controllers(moved)[None], 3).points[0, 0].mean(0).double().numpy()
    return problem, model, true, grasps, end


def stiffened(model, share: float):
    return model.with_fields(youngs_modulus=share * model.fields["youngs_modulus"])


def planner(bars, own: Forecast | None = None, stays: float = 0.5, **further) -> Planner:
    problem, model, _, grasps, end = bars
    cost = Cost(PointsToPlaces(np.arange(len(end)), end), settled=3)
    config = dataclasses.replace(CONFIG, stays=stays)
    return Planner(own or forecast(problem, model), cost, grasps, BOUNDS, config, **further)


def error(bars, seen: np.ndarray) -> float:
    """Mean distance of the points from the goal in the last frames [m]."""
    return float(np.linalg.norm(seen[-3:].mean(0) - bars[-1], axis=1).mean())


def test_a_plan_for_the_right_body_reaches_the_goal_as_it_says(bars):
    problem, _, true, *_ = bars
    own = planner(bars, forecast(problem, true))
    body = Followed(forecast(problem, true))
    done = execute(own, body)
    start = error(bars, problem.body.x0[None])
    assert error(bars, done.seen) < 0.05 * start
    assert done.replans == 0 and body.calls == 1
    assert done.seen.shape == done.planned.shape == (CONFIG.frames + 1, len(problem.body.x0), 3)
    assert done.apart.max() < 1e-4  # the same simulator; what differs is the rounding of single and many rollouts
    assert done.seconds > 0 and done.plans[0].rollouts > 0


def test_several_models_and_a_look_make_up_for_a_wrong_fit(bars):
    """The fit is three times as stiff as the body; one of its neighbours is nearly as soft."""
    problem, model, true, *_ = bars
    alone = execute(planner(bars), Followed(forecast(problem, true)))
    members = [stiffened(model, share).fields for share in (1.0, 0.25, 0.5, 1.6)]
    several = forecast(problem, model, members=members)
    done = execute(planner(bars, several), Followed(forecast(problem, true)), every=8)
    assert done.begun == (0, 8) and done.moved.shape == (CONFIG.frames + 1, 1, 3)
    assert np.allclose(done.plans[0].weights, 0.25) and done.plans[1].weights.argmax() == 1
    assert done.apart[-1] < 0.3 * alone.apart[-1]
    assert error(bars, done.seen) < 0.05 * error(bars, problem.body.x0[None])


def test_what_stays_wrong_is_taken_off(bars):
    """The body is seen 1 cm beside where it is, as by a camera that was moved."""
    problem, _, true, *_ = bars
    errors = []
    for stays in (0.0, 1.0):
        done = execute(planner(bars, forecast(problem, true), stays), Followed(forecast(problem, true), 0.01), every=8)
        errors.append(error(bars, done.seen))
    assert errors[0] > 0.008 and errors[1] < 0.3 * errors[0]


def test_the_same_seed_gives_the_same_plan(bars):
    plans = [planner(bars).plan() for _ in range(2)]
    assert np.array_equal(plans[0].moved, plans[1].moved) and plans[0].cost == plans[1].cost


def test_a_body_of_two_layers_has_no_coarser_form(bars):
    assert quick_form(*bars[:2], 2.0) is None


def test_a_coarser_body_is_searched_on_and_corrected():
    problem, model, grasps = finer()
    coarse, share = quick_form(problem, model, 2.0)
    assert len(coarse.body.x0) == len(problem.body.x0) / 8 and share == 8
    points0 = problem.body.x0[::7]
    own, quick = Forecast(problem, model, points0), Forecast(coarse, model, points0, [with_grip(model.fields, share)])
    with torch.no_grad():
        moved = torch.from_numpy(hidden_way(CONFIG.frames, CONFIG.rest, GOAL))
        end = own(grasps.controllers(moved)[None], 3).points[0, 0].mean(0).double().numpy()
    cost = Cost(PointsToPlaces(np.arange(len(end)), end), settled=3)
    plan = Planner(own, cost, grasps, BOUNDS, CONFIG, quick).plan()
    reached = np.linalg.norm(plan.points[-3:].mean(0) - end, axis=1).mean()
    assert quick.count > 10 * own.count
    assert reached < 0.08 * np.linalg.norm(points0 - end, axis=1).mean()


def test_two_hands_take_it_where_they_are_told(bars):
    problem, model, *_ = bars
    x0 = problem.body.x0
    ends = x0[x0[:, 0].argmin()], x0[x0[:, 0].argmax()]
    held, grasps = grasps_at(problem, model, ends, keep=False)
    assert grasps.count == 2
    moved = torch.zeros(13, 2, 3, dtype=torch.float64)
    moved[:, :, 2] = 0.06 * torch.linspace(0, 1, 13, dtype=torch.float64)[:, None].clamp_max(1.0)
    with torch.no_grad():
        points = Forecast(held, model, np.stack(ends))(grasps.controllers(moved)[None]).points[0, 0]
    assert (points[-1, :, 2] - points[0, :, 2]).min() > 0.03  # both ends have left the ground
    both, three = grasps_at(problem, model, ends, keep=True)
    assert three.count == 3 and len(both.grip.particles) == len(problem.grip.particles) + len(held.grip.particles)
    with pytest.raises(InputError, match="no grasp"):
        grasps_at(problem, model, (), keep=False)


def test_a_grasp_holds_however_far_the_recorded_hand_reaches(bars):
    """A cloth's reach may be negative, a rope's less than a handle is wide; of the recorded hand only what it holds in the model stays."""
    problem, model, *_ = bars
    beyond = np.where(problem.grip.particles == problem.grip.particles.min(), -0.004, 0.0)
    near = dataclasses.replace(problem, grip=dataclasses.replace(problem.grip, reach=beyond))
    short = dataclasses.replace(model, grip_reach=-0.004)
    place = problem.body.x0[problem.body.x0[:, 0].argmin()]
    alone, _ = grasps_at(near, short, [place], keep=False)
    both, _ = grasps_at(near, short, [place], keep=True)
    kept = np.unique(near.grip.within(-0.004).particles)
    assert 0 < len(kept) < len(np.unique(near.grip.particles))
    for made, expected in ((alone, alone.grip.particles), (both, np.concatenate([kept, alone.grip.particles]))):
        assert set(made.held_within(short.grip_reach).grip.particles) == set(expected)


def test_errors_of_points_out_of_sight_are_those_of_their_neighbours():
    points0 = np.array([[0.0, 0, 0], [1.0, 0, 0], [2.0, 0, 0]])
    bias = np.array([[[0.1, 0, 0], [np.nan] * 3, [0.3, 0, 0]]])
    assert np.allclose(completed(bias, points0)[0, :, 0], [0.1, 0.2, 0.3])
    assert not completed(np.full((1, 3, 3), np.nan), points0).any()


def test_no_plan_is_made_when_nothing_is_left_to_move(bars):
    with pytest.raises(InputError, match="for rest"):
        planner(bars).plan(done=np.zeros((17, 1, 3)))
