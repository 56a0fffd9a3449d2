"""The vector functions of lanes.h against numpy in higher precision, and what they do beyond the numbers."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from physreal_core.native import launch_on_threads, native_module

WIDTHS = {"float": (wp.float32, np.float32), "double": (wp.float64, np.float64)}


@cache
def _kernel(scalar: str) -> wp.Kernel:
    array = wp.array(dtype=WIDTHS[scalar][0])
    header = Path(__file__).parent / "lanes_probe.h"

    @wp.func_native("physreal::probe(x.data, exps.data, powers.data, logs.data, totals.data, count);")
    def probe(x: array, exps: array, powers: array, logs: array, totals: array, count: int): ...

    @wp.kernel(module=native_module(f"physreal_test_lanes_{scalar}", header))
    def kernel(x: array, exps: array, powers: array, logs: array, totals: array, count: int, thread: int):
        probe(x, exps, powers, logs, totals, count)

    return kernel


def _functions(scalar: str, x: np.ndarray) -> list[np.ndarray]:
    wp.init()
    arrays = [wp.array(x, device="cpu")] + [wp.zeros(len(x), dtype=WIDTHS[scalar][0], device="cpu") for _ in range(4)]
    launch_on_threads(_kernel(scalar), 1, *arrays, len(x))
    return [a.numpy() for a in arrays[1:]]


@pytest.mark.parametrize("scalar", WIDTHS)
def test_within_two_units_in_the_last_place(scalar: str) -> None:
    dtype = WIDTHS[scalar][1]
    generator = np.random.default_rng(0)
    x = np.concatenate(
        [generator.uniform(-86, 87, 1600), generator.uniform(-1, 1, 1600), np.exp2(generator.uniform(-99, 99, 1600))]
    )
    x = np.concatenate([x, 1 + 2.0 ** -np.arange(1, 17)]).astype(dtype)
    exps, powers, logs, _ = _functions(scalar, x)
    exact = x.astype(np.longdouble)
    unit = np.finfo(dtype).eps
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        for got, expected, valid in (
            (exps, np.exp(exact), np.abs(x) <= 87),
            (powers, np.exp2(exact), np.abs(x) <= 125),
            (logs, np.log(exact), x > 0),
        ):
            assert valid.sum() > 1000
            assert (np.abs(got - expected)[valid] <= 2 * unit * np.abs(expected[valid])).all()


@pytest.mark.parametrize("scalar", WIDTHS)
def test_beyond_the_numbers(scalar: str) -> None:
    """NaN stays NaN, in exp and log; the logarithm of what has none is NaN; the ends of the line are where they belong."""
    x = np.array([np.nan, np.inf, -np.inf, 0.0, -1.0, *np.ones(11)], dtype=WIDTHS[scalar][1])
    exps, _, logs, _ = _functions(scalar, x)
    assert np.isnan(exps[0]) and np.isnan(logs[[0, 2, 4]]).all()
    assert list(exps[1:4]) == [np.inf, 0.0, 1.0]
    assert list(logs[[1, 3]]) == [np.inf, -np.inf]


@pytest.mark.parametrize("scalar", WIDTHS)
def test_sums_stand_in_their_lanes(scalar: str) -> None:
    x = np.arange(16, dtype=WIDTHS[scalar][1])
    assert np.array_equal(_functions(scalar, x)[3], 120.0 * np.arange(16))
