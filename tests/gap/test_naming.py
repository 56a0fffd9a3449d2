"""Probabilities of answers from their gains in evidence."""

import numpy as np

from physreal_core.gap import GapSettings
from physreal_core.gap.naming import chances, weighed

LIBRARY = 27


def test_a_second_effect_must_gain_more_than_the_models_misfit():
    """One per cent more evidence for two effects is what a simulator slightly off would find; a fifth more is not."""
    sizes = [0, 1, 2]
    little, much = ([0.0, 1000.0, gain] for gain in (1010.0, 1200.0))
    assert np.argmax(chances(sizes, np.array(little), GapSettings(), LIBRARY)) == 1
    assert np.argmax(chances(sizes, np.array(much), GapSettings(misfit=0.01), LIBRARY)) == 2
    assert np.argmax(chances(sizes, np.array(little), GapSettings(misfit=0.0, temperature=1.0), LIBRARY)) == 2


def test_nothing_gained_is_none():
    found = chances([0, 1, 1], np.array([0.0, -2.0, 1.0]), GapSettings(), LIBRARY)
    assert found[0] > 0.9 and found.sum() == 1.0


def test_held_out_frames_speak_against_a_gain_and_never_make_one():
    settings = GapSettings(held_out_share=0.5, held_out_loss=0.5)
    assert weighed(100.0, 40.0, settings) == 120.0
    assert weighed(100.0, 1000.0, settings) == 150.0  # a lucky late swing
    assert weighed(100.0, -20.0, settings) == 80.0
    assert weighed(100.0, -1000.0, settings) == 50.0  # a right effect whose contact comes a frame late
    assert weighed(-5.0, 1000.0, settings) == -5.0
