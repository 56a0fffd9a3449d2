"""What a fit leaves open: much where nothing tells, little where the motion does."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.spread import LEAST, NINETY, PRIOR, Spread, spread_of
from stages._fit import summary, with_intervals
from tests.fitting import scene


def measured(noise: float = 1e-4):
    """The bar lifted, with the true model; tracks with noise [m]."""
    model = scene.model(youngs_modulus=3e4)
    problem = scene.problem(model, frames=12, observed=12, with_masks=False)
    random = torch.Generator().manual_seed(0)
    points = problem.tracks.points3d + noise * torch.randn(problem.tracks.points3d.shape, generator=random)
    return dataclasses.replace(problem, tracks=dataclasses.replace(problem.tracks, points3d=points)), model


def test_a_motion_that_bends_the_body_tells_its_stiffness():
    spread = spread_of(*measured())
    assert LEAST < spread.deviations["youngs_modulus"] < 0.3 * PRIOR["youngs_modulus"]
    assert spread_of(*measured(noise=3e-3)).deviations["youngs_modulus"] > 2 * spread.deviations["youngs_modulus"]


def test_one_does_not_get_surer_by_a_doubtful_measurement():
    deviations = spread_of(*measured(noise=10.0)).deviations
    for name, value in deviations.items():
        assert value == pytest.approx(np.hypot(PRIOR[name], LEAST), rel=1e-3)


def test_an_interval_is_a_factor_on_either_side_and_a_valley_lies_along_what_is_known_least():
    """A modulus known to 10 %, a hold to 50 %, and their product to 2 %: the valley keeps the product."""
    product, ratio = np.array([1.0, 1.0]) / np.sqrt(2), np.array([1.0, -1.0]) / np.sqrt(2)
    covariance = 0.02**2 * np.outer(product, product) + 0.5**2 * np.outer(ratio, ratio)
    spread = Spread(("youngs_modulus", "grip_stiffness"), covariance)
    low, high = spread.interval("youngs_modulus", 1e5)
    assert low * high == pytest.approx(1e10) and high == pytest.approx(
        1e5 * np.exp(NINETY * spread.deviations["youngs_modulus"])
    )
    assert spread.correlation("youngs_modulus", "grip_stiffness") == pytest.approx(-1.0, abs=0.01)
    ends = spread.ends("youngs_modulus", "grip_stiffness")
    np.testing.assert_allclose(ends.sum(1), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), NINETY * 0.5)


def test_along_one_number_the_others_go_as_they_are_expected():
    """At an end of the interval of a Gaussian's number the mean of the other is its covariance over the number's variance."""
    spread = Spread(("youngs_modulus", "grip_stiffness"), np.array([[0.04, -0.03], [-0.03, 0.09]]))
    ends = spread.along("youngs_modulus")
    assert ends[1] == pytest.approx(NINETY * np.array([0.2, -0.15])) and np.array_equal(ends[0], -ends[1])


def test_a_soft_body_in_a_firm_hold_is_hardly_told_from_a_firm_one_in_a_soft_hold():
    """Their logarithms go against each other."""
    spread = spread_of(*measured())
    assert spread.correlation("youngs_modulus", "grip_stiffness") < 0.0


def test_without_tracks_nothing_is_told():
    problem, model = measured()
    tracks = dataclasses.replace(problem.tracks, valid3d=torch.zeros_like(problem.tracks.valid3d))
    with pytest.raises(InputError, match="no tracks in 3D"):
        spread_of(dataclasses.replace(problem, tracks=tracks), model)


def test_a_stage_writes_intervals_and_the_valley_where_one_is_left(monkeypatch):
    problem, model = measured()
    values, _ = with_intervals(summary(model), problem, model, "cpu")
    for name in spread_of(problem, model).names:
        low, high = values[name]["interval"]
        assert low < values[name].get("value", values[name].get("mean")) < high
    assert "interval" not in values["grip_damping"]
    monkeypatch.setattr("stages._fit.TOLD_APART", 0.0)
    _, valley = with_intervals(summary(model), problem, model, "cpu")
    (soft, firm), (stiff, loose) = sorted(valley.ends)
    assert valley.names == ["youngs_modulus", "grip_stiffness"] and soft < 3e4 < stiff and firm > loose
    monkeypatch.setattr("stages._fit.TOLD_APART", 1.01)
    assert with_intervals(summary(model), problem, model, "cpu")[1] is None


def test_a_stage_without_tracks_in_3d_says_nothing_of_intervals():
    problem, model = measured()
    blind = dataclasses.replace(problem.tracks, valid3d=torch.zeros_like(problem.tracks.valid3d))
    values = summary(model)
    assert with_intervals(values, dataclasses.replace(problem, tracks=blind), model, "cpu") == (values, None)
