"""The elementary functions that the laws call: of vectors, and the machine's own of one number."""

import numpy as np
import pytest

from tests.simulation.laws.driver import DTYPES, MOST_LANES, elementary


@pytest.mark.parametrize("dtype", DTYPES)
def test_they_are_accurate_to_about_one_ulp(dtype, form):
    rng, evaluate = np.random.default_rng(7), elementary(form, dtype)
    info = np.finfo(dtype)
    lowest, highest = np.log(float(info.smallest_subnormal)), np.log(float(info.max))
    numbers = np.exp(np.concatenate([rng.uniform(-0.5, 0.5, 4096), rng.uniform(lowest, highest, 4096)]))
    normal = numbers[numbers > info.tiny]
    normal = normal[: len(normal) // MOST_LANES * MOST_LANES]
    for name, inputs, exact, bound in (
        ("log", numbers, np.log, 1.3),
        ("exp", rng.uniform(lowest, 0.999 * highest, 8192), np.exp, 1.3),
        ("sqrt", numbers, np.sqrt, 0.51),
        ("inverse_sqrt", normal, lambda x: 1 / np.sqrt(x), 2.0),
        ("abs", rng.normal(size=8192), np.abs, 0.0),
    ):
        x = inputs.astype(dtype)
        expected = exact(x.astype(np.longdouble))
        ulp = np.spacing(abs(expected).astype(dtype))
        assert np.max(abs(getattr(evaluate(x), name) - expected) / ulp) <= bound, name
    x = rng.uniform(-100.0, 100.0, 8192).astype(dtype)
    found = evaluate(x)
    np.testing.assert_allclose(found.sin, np.sin(x.astype(np.longdouble)), rtol=0, atol=info.eps)
    np.testing.assert_allclose(found.cos, np.cos(x.astype(np.longdouble)), rtol=0, atol=info.eps)


@pytest.mark.parametrize("dtype", DTYPES)
def test_at_the_ends_of_their_range(dtype, form):
    x = np.array([0.0, -0.0, -1.0, np.inf, -np.inf, np.nan, 1.0, 1000.0, -1000.0] + 7 * [1.0], dtype)
    found = elementary(form, dtype)(x)
    with np.errstate(all="ignore"):
        np.testing.assert_allclose(found.log, np.log(x), rtol=1e-7)
        np.testing.assert_allclose(found.exp, np.exp(x), rtol=1e-7)
        np.testing.assert_array_equal(found.sqrt, np.sqrt(x))
        np.testing.assert_array_equal(found.abs, np.abs(x))


def test_sum_is_that_of_all_lanes(form):
    x = 2.0 ** np.arange(MOST_LANES)
    sums = elementary(form, "float64")(x).sum
    lanes = MOST_LANES // len(set(sums))
    assert (lanes > 1) == (form == "lanes")
    np.testing.assert_array_equal(sums, np.repeat(x.reshape(-1, lanes).sum(1), lanes))
