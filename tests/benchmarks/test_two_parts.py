"""Two levels of a field along an axis, where they are known."""

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.two_parts import parts_of


def test_a_step_is_found_where_it_is():
    x = np.random.default_rng(0).uniform(-0.1, 0.1, 500)
    parts = parts_of(x, np.where(x < 0.013, 2e4, 6e4))
    assert parts.border == pytest.approx(0.013, abs=1e-3)
    assert (parts.lower, parts.upper, parts.explained) == pytest.approx((2e4, 6e4, 1.0))


def test_a_step_that_is_smooth_and_noisy_is_found_in_its_middle():
    random = np.random.default_rng(1)
    x = random.uniform(-0.1, 0.1, 2000)
    log = np.log(2e4) + np.log(4.0) / (1 + np.exp(-(x - 0.02) / 0.005)) + 0.1 * random.normal(size=len(x))
    parts = parts_of(x, np.exp(log))
    assert parts.border == pytest.approx(0.02, abs=0.004)
    assert parts.upper / parts.lower == pytest.approx(4.0, rel=0.1)


def test_a_level_field_has_no_parts():
    x = np.linspace(0, 1, 50)
    parts = parts_of(x, np.full(50, 3e4))
    assert parts.lower == pytest.approx(parts.upper)
