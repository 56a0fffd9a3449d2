"""Probabilities of answers from their gains in evidence."""

import numpy as np
import pytest

from physreal_core.gap import GapSettings
from physreal_core.gap.answers.probabilities import confirmed, tempered, worth_of_a_second

LIBRARY = 27


NONE, WIND, PAYLOAD, DRAG, TWO, OTHER_TWO = (
    (),
    ("wind",),
    ("payload",),
    ("drag",),
    ("payload", "wind"),
    ("drag", "wind"),
)


def best_of(gains: dict[tuple[str, ...], float], settings: GapSettings | None = None) -> tuple[str, ...]:
    found = tempered(np.array([*gains.values()]), [*map(len, gains)], settings or GapSettings(), LIBRARY)
    return list(gains)[int(np.argmax(found))]


@pytest.mark.parametrize("size", [100.0, 10_000.0])
def test_a_second_effect_must_gain_more_than_its_prior_costs(size):
    settings = GapSettings(temperature=3.0)
    costs = 3.0 * np.log(0.9 / LIBRARY / (0.1 / (LIBRARY * (LIBRARY - 1) / 2)))
    little, much = ({NONE: 0.0, WIND: size, PAYLOAD: 0.2 * size, TWO: size + share * costs} for share in (0.9, 1.1))
    assert best_of(little, settings) == WIND
    assert best_of(much, settings) == TWO


def test_of_two_pairs_that_gains_more_is_the_better_however_little_its_members_gain_alone():
    gains = {NONE: 0.0, WIND: 900.0, PAYLOAD: 10.0, DRAG: 20.0, TWO: 1200.0, ("drag", "payload"): 1150.0}
    assert best_of(gains) == TWO
    assert best_of({**gains, OTHER_TWO: 1300.0}) == OTHER_TWO


@pytest.mark.parametrize("class_ratio", [1.0, 0.1])
def test_a_second_is_worth_looking_for_from_where_two_belong_to_the_class(class_ratio):
    settings = GapSettings(class_ratio=class_ratio)
    more = worth_of_a_second(settings, LIBRARY)
    found = tempered(np.array([0.0, 100.0, 100.0 + more]), [0, 1, 2], settings, LIBRARY)
    assert found[2] == pytest.approx(class_ratio * found[1])


def test_among_two_candidates_any_second_may_be_in_the_class():
    assert worth_of_a_second(GapSettings(class_ratio=0.1), 2) == 0.0


def test_a_single_is_divided_as_if_there_were_no_pairs():
    singles = {NONE: 0.0, WIND: 1000.0, PAYLOAD: 900.0}
    alone = tempered(np.array([*singles.values()]), [*map(len, singles)], GapSettings(), LIBRARY)
    among = tempered(np.array([*singles.values(), 500.0]), [*map(len, singles), 2], GapSettings(), LIBRARY)
    assert among[:3] == pytest.approx(alone, rel=1e-3) and among[3] < 1e-3


def test_nothing_gained_is_none():
    found = tempered(np.array([0.0, -2.0, 1.0]), [0, 1, 1], GapSettings(), LIBRARY)
    assert found[0] > 0.9 and found.sum() == pytest.approx(1.0)


def test_of_two_effects_counts_what_held_out_frames_confirm_beyond_the_better_one_alone():
    names, gains = [NONE, WIND, PAYLOAD, TWO], np.array([0.0, 1000.0, 100.0, 1300.0])
    for held_out, counts in ((0.0, 1000.0), (-50.0, 1000.0), (100.0, 1100.0), (300.0, 1300.0), (np.inf, 1300.0)):
        found = confirmed(names, gains, [0.0, 200.0, 500.0, 200.0 + held_out])
        np.testing.assert_allclose(found, [0.0, 1000.0, 100.0, counts])
    assert confirmed(names, gains, [0.0, -np.inf, 0.0, -np.inf])[3] == 1000.0  # both run away there
    np.testing.assert_array_equal(confirmed(names, gains, [0.0] * 4), gains)  # nothing is held out
    np.testing.assert_array_equal(confirmed([NONE, TWO], gains[[0, 3]], [0.0, -9.0]), gains[[0, 3]])
