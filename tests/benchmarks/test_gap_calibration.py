"""The temperature that calibration finds is the one that made the gains."""

import numpy as np
import pytest

from benchmarks.gap.calibration import Gained, Searched, best_temperature, chances, searched_of, surprise
from benchmarks.gap.cases import GapCase
from physreal_core.gap import GapSettings

NAMES = [(), ("a",), ("b",), ("c",)]


@pytest.mark.parametrize("temperature", [2.0, 6.0])
def test_the_temperature_under_which_truths_are_drawn_is_found(temperature):
    """Gains at random, the truth drawn with the probabilities that this temperature gives them: honest by construction."""
    random, searched = np.random.default_rng(0), []
    settings = GapSettings(temperature=temperature)
    for _ in range(1500):
        gains = random.normal(0.0, 4.0 * temperature, (2, len(NAMES)))
        answers = tuple(Gained(n, g, h) for n, g, h in zip(NAMES, *gains, strict=True))
        true = NAMES[random.choice(len(NAMES), p=chances(answers, settings, 3))]
        searched.append(Searched(answers, true))
    found, least = best_temperature(searched, 3)
    assert found == temperature
    assert least < surprise(searched, GapSettings(temperature=8 * temperature), 3)


def test_a_truth_that_was_not_fitted_is_left_out():
    report = {
        "candidates": [
            {"effects": [{"name": "wind"}], "gain": 3.0, "held_out": 1.0},
            {"effects": [{"name": "lag"}], "gain": None, "held_out": None},
            {"effects": [], "gain": 0.0, "held_out": 0.0},
        ]
    }
    true = [searched_of(GapCase(name, "high", 1), report).true for name in ("wind", "lag", "none", "outside:tether")]
    assert true == [0, None, 1, 1]
