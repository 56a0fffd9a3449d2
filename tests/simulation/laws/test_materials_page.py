"""docs/materials.md: the law that it adds as an example compiles, and its adjoint is right."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import torch
from physreal_core.simulation.constitutive import ELASTIC_LAWS, PLASTIC_LAWS, reference

from tests.simulation.constitutive.kernels import elastic
from tests.simulation.constitutive.points import directional, generic_points, inner

PAGE = Path(__file__).resolve().parents[3] / "docs" / "materials.md"
LAW = "saint_venant_kirchhoff"


def test_the_page_names_every_law():
    text = PAGE.read_text()
    assert all(f"`{law}`" in text for law in (*ELASTIC_LAWS, *PLASTIC_LAWS))


def test_the_example_law_is_right(tmp_path, monkeypatch):
    source = tmp_path / f"{LAW}.py"  # Warp reads a function's source from its file
    source.write_text(re.search(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[1])
    spec = importlib.util.spec_from_file_location(LAW, source)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setitem(ELASTIC_LAWS, LAW, getattr(module, LAW))

    rng = np.random.default_rng(1)
    F = generic_points(20, rng)
    E, nu = np.full(20, 3.0), np.full(20, 0.3)
    seed, direction = rng.normal(size=(2, 20, 3, 3))
    evaluate = elastic(LAW)
    out = evaluate(F, E, nu, seed)
    mu, lam = reference.lame(*torch.tensor([3.0, 0.3], dtype=torch.float64))
    G = (F.transpose(0, 2, 1) @ F - np.eye(3)) / 2
    S = 2 * mu.item() * G + lam.item() * np.trace(G, axis1=1, axis2=2)[:, None, None] * np.eye(3)
    np.testing.assert_allclose(out.tau, F @ S @ F.transpose(0, 2, 1), rtol=1e-12, atol=1e-12)
    ones = np.ones(20)
    for measured, exact in (
        (directional(lambda x: evaluate(x, E, nu, seed).tau, F, direction, seed, 1e-3), inner(out.F_bar, direction)),
        (directional(lambda x: evaluate(F, x, nu, seed).tau, E, ones, seed, 1e-3), out.E_bar),
        (directional(lambda x: evaluate(F, E, x, seed).tau, nu, ones, seed, 1e-4), out.nu_bar),
    ):
        np.testing.assert_allclose(measured, exact, rtol=1e-6, atol=1e-6)
