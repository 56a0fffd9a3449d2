"""Depth of what lies on the plane, from its silhouette, against exact shapes."""

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry import mesh_from_balls
from physreal_core.resting import resting_balls, resting_depth

K = np.array([[500.0, 0.0, 160.0], [0.0, 500.0, 120.0], [0.0, 0.0, 1.0]])
SIZE = 240, 320


def camera(tilt=50.0, far=0.8):
    """Looks at the origin from `far` metres away, `tilt` degrees down."""
    down = np.radians(tilt)
    forward = np.array([np.cos(down), 0.0, -np.sin(down)])
    right = np.array([0.0, -1.0, 0.0])
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = -far * forward
    return T


def rays(T):
    v, u = np.indices(SIZE)
    return np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(SIZE)], -1) @ T[:3, :3].T


def seen_balls(centres, radius, T):
    """Exact depth of balls, zero off them."""
    depth = np.full(SIZE, np.inf)
    ray = rays(T)
    for centre in centres:
        off = centre - T[:3, 3]
        along, square = ray @ off, (ray**2).sum(-1)
        left = along**2 - square * (off @ off - radius**2)
        depth = np.minimum(depth, np.where(left >= 0, (along - np.sqrt(np.maximum(left, 0))) / square, np.inf))
    return np.where(np.isfinite(depth), depth, 0.0)


@pytest.mark.parametrize("tilt", [35.0, 60.0, 85.0])
@pytest.mark.parametrize("thickness", [None, 0.03])
def test_a_rope_on_the_table_is_where_it_is(tilt, thickness):
    T, along = camera(tilt), np.linspace(-0.12, 0.12, 200)
    true = seen_balls(np.stack([0.1 * along, along, np.full(200, 0.015)], 1), 0.015, T)
    found = resting_depth(true > 0, K, T, "linear", thickness)
    assert ((found > 0) == (true > 0)).all()
    off = np.abs(found - true)[true > 0]
    assert np.median(off) < 0.001 and np.quantile(off, 0.95) < 0.006


def test_a_body_of_balls_gets_its_volume_back():
    T = camera(60.0)
    true = seen_balls([np.array([0.0, 0.0, 0.04])], 0.04, T)
    centres, radii = resting_balls(true > 0, K, T)
    np.testing.assert_allclose(radii.max(), 0.04, rtol=0.05)
    np.testing.assert_allclose(centres[radii.argmax()], [0.0, 0.0, 0.04], atol=0.004)
    np.testing.assert_allclose(centres[:, 2], radii, rtol=1e-6)
    assert mesh_from_balls(centres, radii, voxel=0.002).volume == pytest.approx(4 / 3 * np.pi * 0.04**3, rel=0.15)


def test_a_mesh_around_two_balls_has_their_volume():
    centres, radii = np.array([[0.0, 0.0, 0.05], [0.06, 0.0, 0.03]]), np.array([0.05, 0.03])
    d = 0.0632455532  # of the centres; the lens that both share is taken off once
    lens = np.pi * (0.08 - d) ** 2 * (d**2 + 2 * d * 0.08 - 3 * 0.02**2) / (12 * d)
    true = 4 / 3 * np.pi * (0.05**3 + 0.03**3) - lens
    mesh = mesh_from_balls(centres, radii, voxel=0.002)
    assert mesh.volume == pytest.approx(true, rel=0.02)
    assert mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=0.002)


@pytest.mark.parametrize("thickness", [None, 0.004])
def test_the_upper_side_of_a_cloth_is_a_thickness_above_the_table(thickness):
    T, mask = camera(), np.zeros(SIZE, bool)
    mask[80:160, 100:220] = True
    depth = resting_depth(mask, K, T, "planar", thickness)
    height = (T[:3, 3] + depth[..., None] * rays(T))[..., 2]
    np.testing.assert_allclose(height[mask], thickness or 0.002, atol=1e-9)
    assert (depth[~mask] == 0).all()


def test_what_lies_above_the_horizon_lies_on_no_table():
    T, mask = camera(tilt=-10.0), np.zeros(SIZE, bool)
    mask[100:140, 100:200] = True
    with pytest.raises(InputError, match="below the horizon"):
        resting_depth(mask, K, T, "linear")
