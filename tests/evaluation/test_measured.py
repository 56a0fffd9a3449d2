"""Measured points from masked depth, and which simulated points the camera sees."""

from __future__ import annotations

import numpy as np

from physreal_core.evaluation import lift_object, seen_points

K = np.array([[100.0, 0, 31.5], [0, 100.0, 23.5], [0, 0, 1]])
ABOVE = np.diag([1.0, -1.0, -1.0, 1.0])  # looking straight down
ABOVE[2, 3] = 1.0


def test_lifted_points_lie_on_the_plane() -> None:
    """Depth 1 m everywhere from 1 m above: z = 0, one point per unmasked pixel but for the rim; x = (u - cx) / f."""
    depth, mask = np.ones((48, 64)), np.zeros((48, 64), bool)
    mask[10:20, 30:40] = True
    points = lift_object(depth, mask, K, ABOVE)
    assert points.shape == (64, 3)
    np.testing.assert_allclose(points[:, 2], 0, atol=1e-15)
    np.testing.assert_allclose(points[:, 0].min(), (31 - 31.5) / 100)
    np.testing.assert_allclose(points[:, 1].max(), (23.5 - 11) / 100)


def test_no_points_at_depth_edges_and_holes() -> None:
    depth, mask = np.ones((48, 64)), np.ones((48, 64), bool)
    depth[:, 32:] = 1.1
    depth[5, 5] = 0.0
    points = lift_object(depth, mask, K, ABOVE, margin=0)
    assert len(points) == 48 * 62 - 1
    assert len(lift_object(0 * depth, mask, K, ABOVE)) == 0


def test_only_the_upper_side_is_seen() -> None:
    """A plate 6 cm thick with a hole in view of its lower side: top seen, bottom hidden, except through the hole."""
    grid = np.stack(np.meshgrid(np.arange(-0.2, 0.2, 0.01), np.arange(-0.15, 0.15, 0.01)), -1).reshape(-1, 2)
    hole = np.abs(grid).max(axis=1) < 0.06
    top = np.column_stack([grid[~hole], np.full(np.count_nonzero(~hole), 0.06)])
    bottom = np.column_stack([grid, np.zeros(len(grid))])
    points = np.concatenate([top, bottom])
    hand = np.zeros((48, 64), bool)
    seen = seen_points(points, 0.01, hand, K, ABOVE)
    assert seen[: len(top)].all()
    middle = np.abs(grid).max(axis=1) < 0.035
    outside = np.abs(grid).max(axis=1) > 0.08
    assert seen[len(top) :][middle].all()
    assert not seen[len(top) :][outside].any()
    hand[:, :32] = True  # covers x < 0
    seen = seen_points(points, 0.01, hand, K, ABOVE)
    assert not seen[points[:, 0] < -0.01].any()
    assert seen[: len(top)][top[:, 0] > 0.01].all()
