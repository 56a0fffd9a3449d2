"""The benchmark of fits runs the stages' own numbers, and its fits find what made the sequence."""

import json

import pytest

from benchmarks.fit import RECIPES, RESIDUAL, SCAN, STAGES, capture_table, fit, table
from benchmarks.fit_case import make_case
from physreal_core.fitting import DescentConfig, LossConfig, ScanConfig


def test_the_recipes_are_the_defaults_of_the_stages():
    from pipeline.config.fit_global import FitGlobal
    from pipeline.config.fit_patches import FitPatches
    from pipeline.config.fit_residual import FitResidual
    from stages._fit import variables_of
    from stages.fit_residual import blocks_of, residual_of

    params = dict(zip(STAGES, (FitGlobal(), FitPatches(), FitResidual()), strict=True))
    blocks = {
        "fit_global": params["fit_global"].variables("volumetric"),
        "fit_patches": {name: getattr(params["fit_patches"], name) for name in ("youngs_modulus", "poissons_ratio")},
        "fit_residual": blocks_of(params["fit_residual"], residual_of(params["fit_residual"], thin=False)),
    }
    for stage, given in params.items():
        recipe = RECIPES[stage]
        assert recipe.variables() == variables_of(blocks[stage])
        assert recipe.descent == DescentConfig(**given.descent.model_dump())
        assert LossConfig() == LossConfig(**given.losses.model_dump())
    assert ScanConfig(**params["fit_global"].scan.model_dump()) == SCAN
    assert residual_of(params["fit_residual"], thin=False) == RESIDUAL


@pytest.mark.slow
def test_every_stage_comes_nearer_to_the_hidden_material():
    rows = fit(make_case(400, 16, "cpu"), "cpu", shorten=2)
    assert [row["stage"] for row in rows] == ["start", *STAGES]
    factors = [row["modulus_factor"] for row in rows]
    assert factors[0] > 2.0 and factors[1] > factors[2] and factors[2] < 1.6
    errors = [row["track_error_observed"] for row in rows]
    assert errors[1] < 0.3 * errors[0] and errors[3] < errors[2] < errors[1]
    assert all(row["parts"]["simulation, backward"] > 0.0 for row in rows[1:])
    assert table(rows).count("\n") == 12


def test_the_stages_records_are_shown(tmp_path):
    for stage in STAGES:
        (tmp_path / stage).mkdir()
        record = {"seconds": 12.34, "phases": {"fit": 10.0, "fit: masks": 1.25, "rollout": 0.5}}
        (tmp_path / stage / "toy.json").write_text(json.dumps(record))
    shown = capture_table("toy", tmp_path).splitlines()
    assert len(shown) == 5 and shown[2].startswith("| fit_global |") and "1.25" in shown[2] and "12.3" in shown[2]
