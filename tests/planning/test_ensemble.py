"""Models drawn around a fit."""

import numpy as np
import pytest
import torch

from physreal_core.fitting.spread import LARGEST_RATIO, spread_of
from physreal_core.planning.ensemble import members
from tests.fitting.test_spread import measured


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
