"""Adjoints that are derived from a law's value: those of the laws that have one written."""

from pathlib import Path

import numpy as np
import pytest

from tests.simulation.laws.driver import elastic
from tests.simulation.laws.points import generic_points, special_points

FOLDER = Path(__file__).parent


@pytest.mark.parametrize(("dtype", "tolerance"), [("float64", 1e-12), ("float32", 2e-5)])
@pytest.mark.parametrize("law", ["neo_hookean", "fixed_corotated"])
def test_it_is_the_written_one(law, dtype, tolerance, form):
    rng = np.random.default_rng(1)
    F = np.concatenate([special_points(rng), generic_points(100, rng)])
    n = len(F)
    values = (F, np.linspace(3.0, 6.0, n), np.linspace(0.05, 0.45, n), rng.normal(size=F.shape))
    F, E, nu, seed = (value.astype(dtype).astype(np.float64) for value in values)
    derived = elastic(f"derived_{law}", form, dtype, folder=FOLDER)(F, E, nu, seed)
    written = elastic(law, "one")(F, E, nu, seed)
    for name in ("tau", "F_bar", "E_bar", "nu_bar"):
        a, b = (getattr(found, name).reshape(n, -1) for found in (derived, written))
        error = np.linalg.norm(a - b, axis=1) / (np.linalg.norm(b, axis=1) + E.max())
        assert error.max() < tolerance, f"{name}: {error.max():.1e}"
