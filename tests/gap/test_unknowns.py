"""The vector of unknowns: which of a model's numbers stand in it, within which bounds."""

import numpy as np
import pytest
import torch

from physreal_core.gap.fits.unknowns import SCALARS, Unknowns

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
