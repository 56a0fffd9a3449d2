"""The lead on an unknown force: terms, numbers and places that were put into a chain of springs by another integrator."""

import builtins
import json

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.gap.lead.departure import force_field
from physreal_core.gap.lead.force_library import _swelling
from physreal_core.gap.lead.lead import find_lead
from physreal_core.gap.lead.responses import free_responses
from tests.gap import chain

PLACE = np.array([0.3, -0.12, -0.1])


def linear_drag(x, v, t):
    return -0.5 * v


def quadratic_drag(x, v, t):
    return -3.0 * np.linalg.norm(v, axis=-1, keepdims=True) * v


def turning_frame(x, v, t):
    return -2.0 * np.cross([0.0, 0.0, 1.0], v)


def magnet(x, v, t):
    way = PLACE - x
    return 0.02 * way / np.linalg.norm(way, axis=-1, keepdims=True) ** 3


def wind(x, v, t):
    return np.broadcast_to([0.3, 0.5, 0.0], x.shape)


def pulse(x, v, t):
    return np.broadcast_to(np.array([0.0, 1.5, 0.0]) * np.sin(7 * t), x.shape)


@pytest.mark.parametrize(
    ("force", "formula", "value"),
    [(linear_drag, "-v", 0.5), (quadratic_drag, "-|v| v", 3.0), (turning_frame, "ez × v", -2.0)],
)
def test_a_force_of_velocity_is_found_with_its_number(force, formula, value):
    lead = find_lead([chain.departure(force)])
    assert [fitted.term.formula for fitted in lead.terms] == [formula]
    # the measured velocity is smoothed over 0.2 s of a swing of 0.8 s
    assert lead.terms[0].coefficient == pytest.approx(value, rel=0.1)
    assert lead.explained_held_out > 0.95 and "it looks like" in lead.sentence


def test_a_magnet_is_found_at_its_place():
    lead = find_lead([chain.departure(magnet)])
    (fitted,) = lead.terms
    np.testing.assert_allclose(fitted.term.place, PLACE, atol=0.03)  # a tenth of its distance from the chain
    # softened at a centimetre, and every mass stands for four centimetres of the chain
    assert fitted.coefficient == pytest.approx(0.02, rel=0.25)
    assert lead.explained_held_out > 0.9


def test_a_steady_force_needs_no_place():
    lead = find_lead([chain.departure(wind)])
    found = {fitted.term.formula: fitted.coefficient for fitted in lead.terms}
    assert found == {"ey": pytest.approx(0.5, rel=0.05), "ex": pytest.approx(0.3, rel=0.05)}


def test_two_interactions_share_one_formula():
    departures = [
        chain.departure(linear_drag, seed, axis) for seed, axis in enumerate([(0.0, 1.0, 0.5), (0.0, -0.5, 1.0)])
    ]
    lead = find_lead(departures)
    assert [fitted.term.formula for fitted in lead.terms] == ["-v"] and len(lead.fields) == 2


def test_a_force_of_time_alone_has_no_formula_but_a_field():
    departure = chain.departure(pulse)
    lead = find_lead([departure])
    assert lead.explained_held_out < 0.5 and "No short formula" in lead.sentence
    field = force_field(departure)
    true = 1.5 * np.sin(7 * field.frames / chain.FPS)
    early = field.frames < chain.TRAIN - 12  # what comes late has moved little yet
    assert field.explained > 0.95
    assert np.corrcoef(field.acceleration[early].mean(1)[:, 1], true[early])[0, 1] > 0.9


def test_noise_has_no_formula():
    lead = find_lead([chain.departure(lambda x, v, t: 0.0)])
    assert lead.terms == () and lead.formula == "f/m = 0"


def test_the_record_is_json():
    record = json.loads(json.dumps(find_lead([chain.departure(magnet)]).as_record(), allow_nan=False))
    assert record["terms"][0]["term"]["unit"] == "m3/s2" and record["formula"].startswith("f/m = +0.0")
    assert np.shape(record["fields"][0]["acceleration"]) == (10, chain.MASSES, 3)


def test_free_points_fall_by_half_the_square_of_time():
    free = free_responses(np.eye(2), 40, 20.0)
    moved = free.displacement(np.broadcast_to([0.0, 0.0, -2.0], (1, 40, 2, 3)))
    fall = -((np.arange(40) / 20.0) ** 2)
    # what acts in a frame acts from half a frame before it on
    np.testing.assert_allclose(moved[0, :, 1, 2], fall, atol=2.0 * 0.5 * 2.0 / 20.0)
    later = np.zeros((1, 40, 2, 3))
    later[0, 25, 0, 0] = 1.0
    assert np.abs(free.displacement(later)[0, :25]).max() < 1e-15  # rounding of the Fourier transform


def test_without_scikit_learn_it_says_what_to_install(monkeypatch):
    original = builtins.__import__

    def refuse(name, *args, **kwargs):
        if name.startswith("sklearn"):
            raise ImportError(name)
        return original(name, *args, **kwargs)

    departure = chain.departure(linear_drag)
    monkeypatch.setattr(builtins, "__import__", refuse)
    with pytest.raises(InputError, match=r"physreal\[gap\]"):
        find_lead([departure])


def test_a_region_of_a_single_point_does_not_swell():
    path = np.cumsum(np.random.default_rng(0).normal(0, 0.01, (5, 2, 3)), axis=0)
    np.testing.assert_allclose(_swelling(path, np.eye(2)), 0.0, atol=1e-9)
