"""Farthest points and patch weights against their defining properties."""

import numpy as np

from physreal_core.geometry.patches import farthest_points, patch_weights


def lattice(n=12):
    return np.stack(np.meshgrid(*[np.arange(n) / n] * 3, indexing="ij"), -1).reshape(-1, 3)


def test_farthest_points_spread_and_cover():
    points = lattice()
    chosen = points[farthest_points(points, 20)]
    apart = np.linalg.norm(chosen[:, None] - chosen[None], axis=2)
    separation = apart[~np.eye(20, dtype=bool)].min()
    cover = np.linalg.norm(points[:, None] - chosen[None], axis=2).min(axis=1).max()
    assert cover <= separation + 1e-12  # the defining property of farthest point sampling
    assert len(np.unique(chosen, axis=0)) == 20


def test_farthest_points_never_more_than_there_are():
    assert sorted(farthest_points(np.eye(3), 10)) == [0, 1, 2]


def test_weights_reproduce_constants_and_patch_values():
    points = lattice()
    patches = farthest_points(points, 12)
    nearest, weights = patch_weights(points, patches, 4)
    assert nearest.shape == weights.shape == (len(points), 4)
    np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-12)
    assert (weights >= 0).all()
    values = np.random.default_rng(0).normal(size=12)
    field = (weights * values[nearest]).sum(axis=1)
    np.testing.assert_allclose(field[patches], values, atol=1e-6)


def test_field_is_continuous():
    """Halving the step along a line halves the field's largest jump: no patch drops out with weight."""
    points = lattice(8)
    patches = farthest_points(points, 12)
    values = np.random.default_rng(0).normal(size=12)

    def largest_jump(samples):
        line = np.linspace([0, 0.1, 0.2], [0.9, 0.8, 0.6], samples)
        nearest, weights = patch_weights(np.vstack([points, line]), patches, 4)
        return np.abs(np.diff((weights * values[nearest]).sum(axis=1)[len(points) :])).max()

    assert largest_jump(4000) < 0.6 * largest_jump(2000)


def test_one_patch_gives_a_uniform_field():
    points = lattice(4)
    nearest, weights = patch_weights(points, farthest_points(points, 1), 4)
    assert (nearest == 0).all() and (weights == 1).all()
