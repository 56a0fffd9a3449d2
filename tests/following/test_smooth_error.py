"""The forecast's error as a smooth field: exact at points without noise, honest about its deviation, and its sizes learnt from differences."""

import numpy as np
import pytest

from physreal_core.following.sizes import LearntSizes
from physreal_core.following.smooth_error import SmoothError, correlation

LENGTH, SIZE = 0.05, 2e-3


@pytest.fixture
def places():
    random = np.random.default_rng(0)
    return random.uniform(0.0, 0.2, (120, 3))


def drawn(places, random, size=SIZE):
    """A field of that size and length at some places."""
    K = correlation(places, places, LENGTH) + 1e-9 * np.eye(len(places))
    return size * np.linalg.cholesky(K) @ random.normal(size=(len(places), 3))


def test_a_field_is_found_where_nothing_is_seen_with_the_deviation_that_is_said(places):
    random, valid = np.random.default_rng(1), np.arange(len(places)) % 3 > 0
    sigma, error = np.full(len(places), 5e-4), SmoothError(places, places, LENGTH)
    standard = []
    for _ in range(60):
        field = drawn(places, random)
        seen = field + sigma[:, None] * random.normal(size=field.shape)
        found = error.analysis(np.where(valid[:, None], seen, 0.0), valid, sigma, SIZE)
        standard.append((found.at_points - field)[~valid] / found.deviation[~valid, None])
        np.testing.assert_allclose(found.at_points, found.at_particles)
    standard = np.concatenate(standard)
    assert 0.95 < standard.std() < 1.05
    assert 0.88 < (np.abs(standard) < 1.645).mean() < 0.92


def test_without_anything_seen_nothing_is_known(places):
    nothing = np.zeros(len(places), bool)
    found = SmoothError(places, places[:5], LENGTH).analysis(
        np.zeros((len(places), 3)), nothing, np.ones(len(places)), SIZE
    )
    assert not found.at_points.any() and found.at_particles.shape == (5, 3) and np.allclose(found.deviation, SIZE)


def test_sizes_of_error_and_noise_are_learnt(places):
    random, learnt = np.random.default_rng(2), LearntSizes(places, 1e-4, 20)
    valid, stated = np.ones(len(places), bool), np.full(len(places), 1e-3)
    dense = places * [0.15, 0.15, 0.15]  # neighbours nearer to each other than the field changes
    learnt = LearntSizes(dense, 1e-4, 20)
    for _ in range(120):
        difference = drawn(dense, random) + 4e-4 * random.normal(size=dense.shape)
        size, noise = learnt.update(difference, valid, stated)
    assert size == pytest.approx(SIZE, rel=0.3)
    assert noise == pytest.approx(0.4, rel=0.1)


def test_two_points_are_too_few_to_learn_from(places):
    learnt, few = LearntSizes(places, 1e-4, 5), np.arange(len(places)) < 2
    assert learnt.update(np.ones_like(places), few, np.ones(len(places))) == (1e-4, 1.0)
