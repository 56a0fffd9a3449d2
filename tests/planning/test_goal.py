"""Cost terms against closed forms and against scipy's nearest neighbours."""

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree

from physreal_core.errors import InputError
from physreal_core.planning import Cost, PointsToPlaces, Silhouette, TargetShape
from physreal_core.planning.goal import effort, smoothness
from physreal_core.rendering import Camera

RANDOM = np.random.default_rng(0)
POINTS = RANDOM.normal(size=(40, 3)) * 0.03


def test_places_count_for_the_points_that_are_named():
    goal = PointsToPlaces(np.array([3, 7]), POINTS[[3, 7]] + [0.0, 0.03, 0.04])
    assert float(goal(torch.from_numpy(POINTS))) == pytest.approx(0.05**2)


def test_chamfer_is_that_of_the_nearest_neighbours():
    shape = RANDOM.normal(size=(60, 3)) * 0.03
    there, back = cKDTree(shape).query(POINTS)[0], cKDTree(POINTS).query(shape)[0]
    batch = torch.from_numpy(np.stack([POINTS, POINTS + 0.01]))
    found = TargetShape(shape)(batch)
    assert float(found[0]) == pytest.approx(0.5 * ((there**2).mean() + (back**2).mean()), rel=1e-6)
    assert found.shape == (2,)


def camera() -> Camera:
    """Looks along y from 1 m away; a pixel is 5 mm there."""
    T = np.array([[1.0, 0, 0, 0], [0, 0, 1, -1.0], [0, -1, 0, 0], [0, 0, 0, 1]])
    return Camera(np.array([[200.0, 0, 50], [0, 200.0, 50], [0, 0, 1]]), T, 101, 101)


def square(at: float) -> np.ndarray:
    """21 x 21 points, 0.1 m wide, in the plane y = 0, their middle at x = `at` [m]."""
    side = np.linspace(-0.05, 0.05, 21)
    x, z = np.meshgrid(side + at, side)
    return np.stack([x.ravel(), np.zeros(x.size), z.ravel()], 1)


def test_a_silhouette_is_reached_where_the_body_covers_the_mask():
    mask = np.zeros((101, 101), bool)
    mask[40:61, 60:81] = True  # x from 0.05 to 0.15 m
    goal = Silhouette(mask, camera(), square(0.0))
    costs = [float(goal(torch.from_numpy(square(at)))) for at in (0.0, 0.05, 0.1, 0.15)]
    assert costs[2] == pytest.approx(0.0, abs=1e-9)
    assert costs[0] > costs[1] > costs[2] < costs[3]


def test_a_silhouette_has_a_slope_where_body_and_mask_do_not_meet():
    mask = np.zeros((101, 101), bool)
    mask[40:61, 80:99] = True
    points = torch.from_numpy(square(-0.1)).requires_grad_(True)
    Silhouette(mask, camera(), square(0.0))(points).backward()
    slope = points.grad.sum(0)
    assert slope[0] < 0 and abs(slope[0]) > 10 * abs(slope[2])


def test_every_goal_says_by_how_much_the_body_has_to_go():
    way = np.array([0.05, 0.0, 0.02])
    mask = np.zeros((101, 101), bool)
    mask[36:57, 50:71] = True  # by 10 pixels to the right and 4 up
    for goal in (PointsToPlaces(np.array([0, 5]), square(0.0)[[0, 5]] + way), TargetShape(square(0.0) + way)):
        assert np.allclose(goal.shift(square(0.0)), way, atol=1e-9)
    assert np.allclose(Silhouette(mask, camera(), square(0.0)).shift(square(0.0)), way, atol=1e-3)


def test_a_mask_of_another_size_is_refused():
    with pytest.raises(InputError, match="camera's size"):
        Silhouette(np.ones((3, 4), bool), camera(), square(0.0))


def test_the_hand_costs_its_acceleration_and_its_speed():
    t = torch.arange(20, dtype=torch.float64) / 30.0
    moved = torch.zeros(20, 1, 3, dtype=torch.float64)
    moved[:, 0, 2] = t**2  # 2 m/s2
    assert float(smoothness(moved, 30.0)) == pytest.approx(4.0)
    moved[:, 0, 2] = 0.5 * t
    assert float(effort(moved, 30.0)) == pytest.approx(0.25)
    cost = Cost(PointsToPlaces(np.array([0]), np.zeros((1, 3))), smoothness=0.0, effort=2.0)
    assert float(cost.of_hand(moved, 30.0)) == pytest.approx(0.5)


def test_models_count_by_their_weights_or_the_dearest_alone():
    goal = PointsToPlaces(np.array([0]), np.zeros((1, 3)))
    points = torch.zeros(1, 3, 2, 1, 3, dtype=torch.float64)  # one way, three models, two frames
    points[0, 1, :, 0, 0] = 0.01
    weights = torch.tensor([0.5, 0.2, 0.3], dtype=torch.float64)
    assert float(Cost(goal).of_body(points, weights)[0]) == pytest.approx(0.2)
    for quantile, cost in ((1.0, 1.0), (0.9, 1.0), (0.7, 0.0)):
        assert float(Cost(goal, quantile=quantile).of_body(points, weights)[0]) == pytest.approx(cost)
