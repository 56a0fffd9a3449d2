"""The expected information about which answer is right, against closed forms and quadrature."""

import numpy as np
import pytest
from scipy.integrate import dblquad, quad

from physreal_core.gap.next_motion.information import entropy, expected_information, separations
from physreal_core.gap.next_motion.prediction import products_beside

TOLERANCE = 1e-3  # nat, of the Sobol points


def information_of_two(distance: float, p: float) -> float:
    """Mutual information of a member and y ~ N(0 or distance, 1), by adaptive quadrature of h(y) - h(y | member)."""

    def minus_log(y):
        density = (p * np.exp(-0.5 * y**2) + (1 - p) * np.exp(-0.5 * (y - distance) ** 2)) / np.sqrt(2 * np.pi)
        return -density * np.log(density)

    return quad(minus_log, -9, distance + 9, limit=400, epsabs=1e-10)[0] - 0.5 * np.log(2 * np.pi * np.e)


@pytest.mark.parametrize("p", [0.5, 0.8, 0.97])
@pytest.mark.parametrize("distance", [0.05, 0.5, 1.0, 2.0, 4.0, 8.0])
def test_two_members_agree_with_quadrature(distance, p):
    means = np.array([[0.3], [0.3 + distance]])
    found = expected_information(np.array([p, 1 - p]), means @ means.T)
    assert found == pytest.approx(information_of_two(distance, p), abs=TOLERANCE)


def test_three_members_agree_with_quadrature():
    means, p = np.array([[0.0, 0.0], [1.5, 0.0], [0.5, 2.0]]), np.array([0.5, 0.3, 0.2])

    def minus_log(y, x):
        density = (p * np.exp(-0.5 * ((np.array([x, y]) - means) ** 2).sum(1))).sum() / (2 * np.pi)
        return -density * np.log(density)

    exact = dblquad(minus_log, -7, 9, -7, 9, epsabs=1e-5)[0] - np.log(2 * np.pi * np.e)
    assert expected_information(p, means @ means.T) == pytest.approx(exact, abs=TOLERANCE)


def test_a_motion_that_parts_nothing_tells_nothing():
    mean = np.random.default_rng(0).normal(size=40)
    same = np.stack([mean, mean, mean])
    assert expected_information(np.array([0.5, 0.3, 0.2]), same @ same.T) == pytest.approx(0.0, abs=1e-9)


def test_it_never_exceeds_the_entropy_and_reaches_it():
    random = np.random.default_rng(1)
    for size in (0.1, 1.0, 10.0, 1000.0):
        p, means = random.dirichlet(np.ones(4)), size * random.normal(size=(4, 30))
        found = expected_information(p, means @ means.T)
        assert 0.0 <= found <= entropy(p)
    assert found == pytest.approx(entropy(p), abs=1e-9)


def test_it_grows_with_the_distance_and_does_not_depend_on_the_origin():
    random, p = np.random.default_rng(2), np.array([0.6, 0.4])
    means = random.normal(size=(2, 5))
    found = [expected_information(p, (size * means) @ (size * means).T) for size in (0.2, 0.5, 1.0, 2.0)]
    assert found == sorted(found) and found[0] < 0.5 * found[-1]
    moved = means + 3.0
    assert expected_information(p, moved @ moved.T) == pytest.approx(found[2], abs=1e-6)


def test_a_separation_is_the_expected_log_evidence():
    """Of N(mu_i, S) against N(mu_j, S), which is their Kullback-Leibler divergence, by a dense inverse of S."""
    random, temperature = np.random.default_rng(3), 9.0
    changes, freedom = random.normal(size=(50, 3)), 2.0 * random.normal(size=(50, 7))
    inverse = np.linalg.inv(temperature * np.eye(50) + freedom @ freedom.T)
    found = separations(products_beside(changes, freedom, temperature))
    d = changes[:, 0] - changes[:, 2]
    assert found[0, 2] == pytest.approx(0.5 * d @ inverse @ d, rel=1e-9)
    assert np.all(found == found.T) and np.all(np.diag(found) == 0.0)


def test_what_other_numbers_could_imitate_does_not_count():
    random = np.random.default_rng(4)
    tangent, apart = random.normal(size=(2, 60))
    changes = np.stack([np.zeros(60), 3.0 * tangent, 3.0 * apart], axis=1)
    found = separations(products_beside(changes, 1e3 * tangent[:, None], 1.0))
    assert found[0, 1] < 1e-3 and found[0, 2] > 100.0
