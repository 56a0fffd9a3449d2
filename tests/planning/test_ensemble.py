"""What a fit leaves open: much where nothing tells, little where the motion does."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.planning.ensemble import LARGEST_RATIO, LEAST, PRIOR, members, spread_of
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


def test_members_are_drawn_around_the_fit_and_a_seed_gives_the_same():
    problem, model = measured()
    spread = spread_of(problem, model)
    drawn, again, other = (members(model.fields, spread, 200, seed) for seed in (0, 0, 1))
    assert all(torch.equal(one["youngs_modulus"], two["youngs_modulus"]) for one, two in zip(drawn, again, strict=True))
    assert not torch.equal(drawn[1]["youngs_modulus"], other[1]["youngs_modulus"])
    assert torch.equal(drawn[0]["youngs_modulus"], model.fields["youngs_modulus"])
    logs = [float((one["youngs_modulus"] / model.fields["youngs_modulus"]).log()[0]) for one in drawn[1:]]
    assert np.std(logs) == pytest.approx(spread.deviations["youngs_modulus"], rel=0.2)
    assert max(float(one["poissons_ratio"].max()) for one in drawn) <= LARGEST_RATIO


def test_without_tracks_nothing_is_told():
    problem, model = measured()
    tracks = dataclasses.replace(problem.tracks, valid3d=torch.zeros_like(problem.tracks.valid3d))
    with pytest.raises(InputError, match="no tracks in 3D"):
        spread_of(dataclasses.replace(problem, tracks=tracks), model)
