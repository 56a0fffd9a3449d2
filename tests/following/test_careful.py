"""A follower that learns only where it helps: a modulus that is off, and a wind that no modulus makes up for."""

import numpy as np
import pytest

from physreal_core.errors import SimulationError
from physreal_core.following import CarefulFollower, FollowConfig, Follower, follower_of
from tests.fitting import scene
from tests.following.test_follower import FRAMES, distance, followed, places_under, stiffer, windy

LEARNS = FollowConfig(learns={"youngs_modulus": 0.5})


@pytest.fixture(scope="module")
def problem():
    return scene.problem(scene.model(), frames=FRAMES, observed=FRAMES, with_masks=False)


def late_error(found, places) -> float:
    late = slice(FRAMES // 2, None)
    return distance(np.array([f.forecast for f in found])[late], places[1:][late])


def test_a_modulus_that_is_off_is_taken(problem):
    places = places_under(problem, stiffer(0.6))
    careful = CarefulFollower(problem, scene.model(), LEARNS)
    error = late_error(followed(problem, places, follower=careful), places)
    assert careful.learnt
    assert error < 0.7 * late_error(followed(problem, places), places)


def test_what_is_no_matter_of_the_modulus_is_followed_as_well_as_without(problem):
    places = places_under(problem, windy())
    error = late_error(followed(problem, places, follower=CarefulFollower(problem, scene.model(), LEARNS)), places)
    assert error < 1.1 * late_error(followed(problem, places), places)


def test_it_goes_on_without_a_simulation_that_breaks_off(problem):
    places = places_under(problem, stiffer(0.6))
    careful = CarefulFollower(problem, scene.model(), LEARNS)

    def broken(_):
        raise SimulationError("the state is not finite", frame=1, substep=0, particle=0)

    careful._learning.step = broken
    found, plain = followed(problem, places, follower=careful), followed(problem, places)
    assert not careful.learnt
    assert np.array_equal(found[-1].forecast, plain[-1].forecast)


def test_who_asks_for_nothing_to_be_learnt_has_a_plain_follower(problem):
    assert type(follower_of(problem, scene.model())) is Follower
    assert type(follower_of(problem, scene.model(), LEARNS)) is CarefulFollower
