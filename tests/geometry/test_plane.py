"""The support plane against planes known by construction, with noise and outliers."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry.plane import fit_plane, world_frame


def tilted_scene(rng, outliers=0.5):
    """A camera 0.8 m above a plane, looking down at 35 degrees; half the points belong to a heap on it."""
    up = np.array([0.05, -0.8, -0.6])
    up /= np.linalg.norm(up)
    x = np.cross(up, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    y = np.cross(up, x)
    flat = rng.uniform(-1, 1, (4000, 2)) @ np.stack([x, y]) - 0.8 * up
    flat += rng.normal(0, 0.001, (4000, 1)) * up
    heap = rng.uniform(-0.2, 0.2, (int(4000 * outliers), 3)) - 0.6 * up
    return up, np.concatenate([flat, heap])


def test_plane_with_outliers_and_missing_points():
    rng = np.random.default_rng(0)
    up, points = tilted_scene(rng)
    points[::17] = np.nan
    plane = fit_plane(points)
    assert np.degrees(np.arccos(plane.normal @ up)) < 0.1
    assert abs(plane.offset - 0.8) < 2e-4  # 1 mm noise over 4000 points
    assert plane.inliers[:4000].sum() > 3700 and not plane.inliers[::17].any()


def test_world_frame_puts_the_plane_at_zero_and_the_camera_above():
    rng = np.random.default_rng(1)
    _, points = tilted_scene(rng, outliers=0)
    T = world_frame(fit_plane(points))
    world = points @ T[:3, :3].T + T[:3, 3]
    assert abs(world[:, 2]).max() < 0.006
    assert T[2, 3] == pytest.approx(0.8, abs=1e-3)
    np.testing.assert_allclose(T[:3, :3] @ T[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    axis = T[:3, :3] @ [0, 0, 1]  # the optical axis meets the plane at the world's origin
    np.testing.assert_allclose(np.cross(T[:3, 3], axis), 0, atol=1e-9)


def test_no_plane_is_an_error():
    rng = np.random.default_rng(2)
    with pytest.raises(InputError, match="T_world_camera"):
        fit_plane(rng.uniform(-1, 1, (5000, 3)), tolerance=0.001)
    with pytest.raises(InputError, match="support plane"):
        fit_plane(np.full((100, 3), np.nan))
