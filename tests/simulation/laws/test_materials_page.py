"""docs/materials.md: the law that it adds as an example compiles in both number types, and its adjoint is right."""

import re
from pathlib import Path

import numpy as np
import pytest
import torch

from physreal_core.simulation.laws import ELASTIC_LAWS, PLASTIC_LAWS, reference
from physreal_core.simulation.step_layout import LAWS_FOLDER
from tests.simulation.laws.driver import elastic
from tests.simulation.laws.points import directional, generic_points, inner

PAGE = Path(__file__).resolve().parents[3] / "docs" / "materials.md"
LAW = "simo_miehe"


def simo_miehe(F: np.ndarray, E: float, nu: float) -> np.ndarray:
    mu, lam = (float(a) for a in reference.lame(*torch.tensor([E, nu], dtype=torch.float64)))
    volume = lam / 2 * (np.linalg.det(F) ** 2 - 1)
    return mu * (F @ F.transpose(0, 2, 1) - np.eye(3)) + volume[:, None, None] * np.eye(3)


def headers() -> list[str]:
    """The page's headers of the law: with its adjoint written, and from its value alone."""
    return re.findall(r"```cpp\n(.*?)```", PAGE.read_text(), re.DOTALL)


@pytest.fixture(params=range(2), ids=["adjoint written", "adjoint derived"])
def folder(request, tmp_path: Path) -> Path:
    """Where the page's law stands, as in the folder of the laws."""
    (tmp_path / "elastic").mkdir()
    (tmp_path / "elastic" / f"{LAW}.h").write_text(headers()[request.param])
    return tmp_path


def test_the_page_names_every_law_and_no_file_that_is_not_there():
    text = PAGE.read_text()
    assert all(f"`{law}`" in text for law in (*ELASTIC_LAWS, *PLASTIC_LAWS))
    named = set(re.findall(r"`(?:laws/)?((?:\w+/)*\w+\.(?:h|py))`", text)) - {f"elastic/{LAW}.h"}
    assert {"residual.h", "reference.py", "return_map.h", "derived_adjoint.h", "plastic/von_mises.h"} <= named
    assert all((LAWS_FOLDER / name).exists() or (PAGE.parents[1] / name).exists() for name in named)


def test_the_example_law_is_right(folder, form):
    rng = np.random.default_rng(1)
    F = generic_points(20, rng)
    E, nu = np.full(20, 3.0), np.full(20, 0.3)
    seed, direction = rng.normal(size=(2, 20, 3, 3))
    evaluate = elastic(LAW, form, folder=folder)
    out = evaluate(F, E, nu, seed)
    np.testing.assert_allclose(out.tau, simo_miehe(F, 3.0, 0.3), rtol=1e-12, atol=1e-12)
    assert np.isnan(evaluate(F @ np.diag([1.0, 1.0, -1.0]), E, nu, seed).tau).all()  # inverted
    ones = np.ones(20)
    for measured, exact in (
        (directional(lambda x: evaluate(x, E, nu, seed).tau, F, direction, seed, 1e-3), inner(out.F_bar, direction)),
        (directional(lambda x: evaluate(F, x, nu, seed).tau, E, ones, seed, 1e-3), out.E_bar),
        (directional(lambda x: evaluate(F, E, x, seed).tau, nu, ones, seed, 1e-4), out.nu_bar),
    ):
        np.testing.assert_allclose(measured, exact, rtol=1e-6, atol=1e-6)
