"""The vector of unknowns: which of a model's numbers stand in it, within which bounds."""

import numpy as np
import pytest
import torch

from physreal_core.effects import EFFECTS
from physreal_core.gap.fits.unknowns import SCALARS, Unknowns
from tests.gap.test_predictions import experiment

FIELDS = {
    name: torch.tensor(value, dtype=torch.float64)
    for name, value in {
        "youngs_modulus": [1e5, 2e5],
        "poissons_ratio": [0.3, 0.3],
        "friction_coefficient": 0.4,
        "grip_stiffness": 12.0,
    }.items()
}


@pytest.mark.parametrize(
    "scalars", [(), ("friction_coefficient",), ("friction_coefficient", "grip_stiffness"), ("grip_stiffness",)]
)
def test_what_is_unknown_moves_and_the_rest_stays(scalars):
    unknowns = Unknowns(FIELDS, (), scalars=scalars)
    start = unknowns.start()
    assert len(start) == 3 + len(scalars)
    for name, tensor in FIELDS.items():
        assert torch.allclose(unknowns.baseline_fields(start)[name], tensor)
    for name in scalars:
        moved = start.copy()
        moved[unknowns.place(name)] += np.log(2.0)
        found = unknowns.baseline_fields(moved)
        assert {key for key in FIELDS if not torch.allclose(found[key], FIELDS[key])} == {name}
        assert found[name].item() == pytest.approx(2 * FIELDS[name].item())


def test_a_grip_moves_within_a_range_of_where_it_starts():
    unknowns = Unknowns(FIELDS, (), scalars=("grip_stiffness",))
    place = unknowns.place("grip_stiffness")
    assert np.exp(unknowns.block.upper[place]) == pytest.approx(12.0 * SCALARS["grip_stiffness"].factor)
    assert np.exp(unknowns.block.lower[place]) == pytest.approx(12.0 / SCALARS["grip_stiffness"].factor)


@pytest.mark.parametrize("name", ["payload", "soft_spot"])
def test_what_is_in_the_body_stays_in_the_box_around_it(name):
    own = experiment()
    limits = {name: EFFECTS[name].limits(own.setting)}
    unknowns = Unknowns(FIELDS, limits=limits).beside((name,), {}).under("hencky").without_contrast()
    far = unknowns.vector_of(FIELDS)
    far[unknowns.places[name]] = 1e3
    found = unknowns.values(np.clip(far, unknowns.block.lower, unknowns.block.upper))[name]
    assert [found[axis] for axis in "xyz"] == pytest.approx(own.setting.body.x0.max(0))
    lower = unknowns.values(unknowns.block.lower)[name]
    assert [lower[axis] for axis in "xyz"] == pytest.approx(own.setting.body.x0.min(0))
