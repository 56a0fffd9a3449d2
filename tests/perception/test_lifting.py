"""Depth at sub-pixels, depth edges, missing depth, and tracks whose depth jumps."""

import numpy as np

from physreal_core.perception.lifting import DepthNoise, depth_at, lift_tracks, project
from tests.perception.scene import HAND, OBJECT, T_WORLD_CAMERA, K, film


def _tilted_plane(height: int = 40, width: int = 50) -> np.ndarray:
    v, u = np.mgrid[:height, :width]
    return 0.5 + 0.002 * u - 0.001 * v


def test_depth_of_a_plane_is_exact_between_pixels():
    points = np.random.default_rng(0).uniform([2, 2], [47, 37], (50, 2))
    assert np.allclose(depth_at(_tilted_plane(), points, 0.02), 0.5 + 0.002 * points[:, 0] - 0.001 * points[:, 1])


def test_depth_is_averaged_over_the_window():
    noisy = 0.5 + np.random.default_rng(0).normal(0, 0.001, (200, 200))
    points = np.random.default_rng(1).integers(5, 195, (2000, 2)).astype(float)
    # Nine readings: a third of the noise.
    assert np.std(depth_at(noisy, points, 0.05)) < 0.0004


def test_depth_edges_and_missing_readings_give_nothing():
    depth = np.full((20, 20), 0.5)
    depth[:, 10:] = 0.56
    depth[5, 3] = 0
    points = np.array([[9.0, 10], [9.9, 10], [7.0, 10], [3.0, 5.0], [4.0, 5.0], [0.0, 3], [np.nan, 3], [50.0, 3]])
    found = depth_at(depth, points, 0.02)
    assert found[[0, 1, 3, 5, 6, 7]].tolist() == [0] * 6  # at the edge, without a reading, off the image's inside
    assert np.allclose(found[[2, 4]], 0.5)  # two pixels from the edge; beside a single missing reading


def test_lifted_points_project_back_and_lie_where_they_should():
    scene = film(4)
    queries = np.array([[60.0, 45], [50, 40], [66, 55]])
    points = queries[None] + scene.motion[:, None]
    lifted = lift_tracks(
        points, np.ones((4, 3), bool), scene.depth, K, T_WORLD_CAMERA, noise=DepthNoise(0.001, 0.01, 0.5)
    )
    assert lifted.valid.all()
    assert np.allclose(project(lifted.points, K, T_WORLD_CAMERA), points, atol=1e-3)
    assert np.allclose(lifted.points[..., 2], T_WORLD_CAMERA[2, 3] - OBJECT, atol=1e-6)
    expected = np.hypot(0.001 + 0.01 * OBJECT**2, np.sqrt(2) * 0.5 * OBJECT / 140)
    assert np.allclose(lifted.sigma, expected, rtol=1e-5)


def test_invisible_points_are_unknown_not_invented():
    scene = film(3)
    points = np.tile(np.array([60.0, 45]), (3, 1, 1)) + scene.motion[:, None]
    visible = np.array([[True], [False], [True]])
    lifted = lift_tracks(points, visible, scene.depth, K, T_WORLD_CAMERA)
    assert lifted.valid[:, 0].tolist() == [True, False, True]
    assert np.isnan(lifted.points[1]).all() and np.isnan(lifted.sigma[1]).all()


def test_a_depth_unlike_the_neighbours_is_dropped():
    scene = film(3)
    grid = np.array([[u, v] for u in range(48, 70, 4) for v in range(35, 55, 4)], float)
    points = grid[None] + scene.motion[:, None]
    depth = scene.depth.copy()
    u, v = np.rint(points[1, 7]).astype(int)
    depth[1, v - 1 : v + 2, u - 1 : u + 2] = HAND  # something in front, flat and with clean depth
    lifted = lift_tracks(points, np.ones(points.shape[:2], bool), depth, K, T_WORLD_CAMERA)
    assert not lifted.valid[1, 7]
    assert lifted.valid[[0, 2]].all() and lifted.valid[1].sum() >= len(grid) - 9


def test_a_reading_of_another_thing_is_dropped_where_its_neighbours_are_not_seen():
    """The nearest tracks that are seen judge it, however far away."""
    scene = film(2)
    grid = np.array([[u, v] for u in range(48, 70, 4) for v in range(35, 55, 4)], float)
    points = grid[None] + scene.motion[:, None]
    depth, visible = scene.depth.copy(), np.ones(points.shape[:2], bool)
    u, v = np.rint(points[1, 7]).astype(int)
    depth[1, v - 1 : v + 2, u - 1 : u + 2] = HAND
    visible[1, np.argsort(np.linalg.norm(grid - grid[7], axis=1))[1:14]] = False
    lifted = lift_tracks(points, visible, depth, K, T_WORLD_CAMERA)
    assert not lifted.valid[1, 7] and lifted.valid[1].sum() >= visible[1].sum() - 5
