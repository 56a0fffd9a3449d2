"""Ways of the hand: bounds at all times, where they begin and end, and what knots lead where."""

import numpy as np
import pytest
import torch
from scipy.interpolate import BSpline

from physreal_core.errors import InputError
from physreal_core.planning import Bounds, Grasps
from physreal_core.planning.path import DEGREE, Way

FPS, SPEED = 30.0, 0.4
GRASPS = Grasps(torch.tensor([[0.0, 0.0, 0.1], [0.02, 0.0, 0.1], [0.2, 0.0, 0.1]]), torch.tensor([0, 0, 1]))
BOUNDS = Bounds((-0.1, -0.1, 0.05), (0.3, 0.1, 0.2), SPEED)


def way(done: np.ndarray | None = None, frames: int = 20, knots: int = 4) -> Way:
    return Way.within(BOUNDS, GRASPS, FPS, np.zeros((1, 2, 3)) if done is None else done, frames, knots)


def wild(shape: tuple[int, ...], seed: int = 0) -> torch.Tensor:
    return 0.3 * torch.randn(*shape, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)


def test_bounds_hold_between_frames_for_any_knots():
    own = way()
    knots = wild((50, *own.shape))
    every = own._all(knots).numpy()
    times = np.linspace(0, own.frames, 400)
    for number in range(50):
        spline = BSpline(own._breaks, every[number], DEGREE)
        places = spline(times) + GRASPS.centres
        assert (places >= np.array(BOUNDS.lower) - 1e-9).all() and (places <= np.array(BOUNDS.upper) + 1e-9).all()
        speeds = FPS * np.linalg.norm(spline.derivative()(times), axis=-1)
        assert speeds.max() <= SPEED * (1 + 1e-9)
    assert speeds.max() > 0.5 * SPEED  # they are wild enough to be held back
    assert np.allclose(BSpline(own._breaks, every[0], DEGREE)(np.arange(21)), own.moved(knots)[0])


def test_a_way_goes_on_where_and_as_fast_as_the_hand_does_and_ends_at_rest():
    done = np.zeros((3, 2, 3))
    done[1:, 0, 0] = 0.005, 0.010
    own = way(done)
    spline = BSpline(own._breaks, own._all(wild(own.shape)).numpy(), DEGREE)
    assert np.allclose(spline(0), done[-1], atol=1e-12)
    assert np.allclose(spline.derivative()(0), done[-1] - done[-2], atol=1e-12)
    assert np.allclose(spline.derivative()(own.frames), 0.0, atol=1e-12)


def test_feasible_knots_stay_and_the_nearest_way_to_a_way_is_that_way():
    own = way()
    knots = own.feasible(wild(own.shape))
    assert torch.allclose(own.feasible(knots), knots, atol=1e-12)
    assert torch.allclose(own.nearest(own.moved(knots).numpy()), knots, atol=1e-9)


def test_modes_are_another_way_to_say_knots_and_the_first_leads_to_the_end():
    own = way()
    knots = wild(own.shape)
    assert torch.allclose(own.from_modes(own.to_modes(knots)), knots, atol=1e-12)
    modes = torch.zeros(own.shape, dtype=torch.float64)
    modes[0, 0, 0] = 0.02
    assert torch.allclose(
        own.from_modes(modes), own.straight(np.array([[0.02, 0.0, 0.0], [0.0, 0.0, 0.0]])), atol=1e-12
    )
    modes[1:] = 0.01
    assert torch.allclose(own.from_modes(modes)[-1, 0], torch.tensor([0.02, 0.0, 0.0]).double(), atol=1e-12)


def test_grasps_move_apart():
    moved = torch.zeros(2, 2, 3, dtype=torch.float64)
    moved[1, 1, 2] = 0.05
    points = GRASPS.controllers(moved)
    assert torch.allclose(points[1] - points[0], torch.tensor([[0, 0, 0], [0, 0, 0], [0, 0, 0.05]]).double())


def test_bounds_that_are_none_are_refused():
    with pytest.raises(InputError, match="lower below the upper"):
        Bounds((0.0, 0.0, 0.0), (1.0, 0.0, 1.0), 1.0)
    with pytest.raises(InputError, match="positive one"):
        Bounds((0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 0.0)
