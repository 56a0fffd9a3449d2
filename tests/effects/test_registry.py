"""The registry as a whole: complete entries, bounds, places that move with the object, the documentation."""

import inspect
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS, Effect, configured, fits
from physreal_core.effects.page import FAMILIES, effects_page
from physreal_core.errors import InputError
from physreal_core.simulation import SimulationConfig
from physreal_core.simulation.terms import TERMS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("name", EFFECTS)
def test_entries_are_complete(name):
    effect = EFFECTS[name]
    assert effect.name == name
    assert effect.family in FAMILIES
    home = Path(inspect.getfile(type(effect)))
    assert home == ROOT / "physreal_core" / "effects" / effect.family / f"{name}.py"
    assert all((effect.words, effect.formula, effect.shows, effect.distinguished_by))
    assert set(effect.terms) <= set(TERMS)
    assert any(c.kind == "amplitude" for c in effect.coefficients)
    for c in effect.coefficients:
        assert c.unit and c.meaning
        assert c.lower <= c.dormant <= c.upper
        assert 0 < c.scale <= c.upper - c.lower


@pytest.mark.parametrize("name", [name for name, e in EFFECTS.items() if e.family == "measurement"])
def test_measurement_acts_on_observations_and_the_hand_alone(name):
    effect = EFFECTS[name]
    assert type(effect).observe is not Effect.observe
    assert effect.terms == () and effect.laws == {}


def test_places_and_directions_move_with_the_object():
    rotation, shift = Rotation.from_euler("zx", [0.7, 0.2]).as_matrix(), np.array([0.1, -0.2, 0.3])
    place = {"x": 0.1, "y": 0.2, "z": 0.3, "radius": 0.02}
    for name in ("soft_spot", "payload"):
        moved = EFFECTS[name].carried(place, rotation, shift)
        np.testing.assert_allclose([moved[axis] for axis in "xyz"], rotation @ [0.1, 0.2, 0.3] + shift)
        assert moved["radius"] == 0.02
    moved = EFFECTS["density_gradient"].carried({"x": 1.0, "y": 2.0, "z": 3.0}, rotation, shift)
    np.testing.assert_allclose([moved[axis] for axis in "xyz"], rotation @ [1.0, 2.0, 3.0])
    moved = EFFECTS["fibres"].carried({"ratio": 2.0, "azimuth": 0.4, "elevation": 0.3}, rotation, shift)
    along = Rotation.from_euler("yz", [-0.3, 0.4]).apply([1.0, 0.0, 0.0])
    found = Rotation.from_euler("yz", [-moved["elevation"], moved["azimuth"]]).apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(found, rotation @ along, atol=1e-6)
    assert moved["ratio"] == 2.0


def test_effects_bring_their_terms_and_laws():
    plain = SimulationConfig(30.0, terms=("drag",))
    config = configured(plain, (EFFECTS["maxwell_creep"], EFFECTS["rest_shape"], EFFECTS["linear_drag"]))
    assert config.plastic_law == "von_mises"
    assert config.terms == ("drag", "initial_deformation")


def test_an_effect_does_not_take_the_place_of_another_plastic_law():
    sand = SimulationConfig(30.0, plastic_law="drucker_prager")
    assert not fits(EFFECTS["plastic_yield"], sand)
    assert fits(EFFECTS["linear_drag"], sand)
    with pytest.raises(InputError, match="plastic_yield"):
        configured(sand, (EFFECTS["plastic_yield"],))


def test_the_page_is_fresh():
    page = (ROOT / "docs" / "effects.md").read_text()
    assert page == effects_page(), "run: python -m physreal_core.effects.page > docs/effects.md"
