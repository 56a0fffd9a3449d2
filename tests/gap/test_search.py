"""Which fits a search makes, in a linear world."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.gap import GapSettings, Search
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, LinearExperiment, register

SETTINGS = GapSettings(candidates=("drift", "sink"), shortlist=1, model_error=ModelError(rms=3e-4, moved=1e-4))
BOTH = {"sink": {"amount": 0.9}, "drift": {"east": 0.8}}


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def search(truth: dict, settings: GapSettings = SETTINGS) -> Search:
    return Search([LinearExperiment(ANSWERS, truth)], settings, lambda message: None)


def names(found: Search) -> list[tuple[str, ...]]:
    return [answer.names for answer in found.answers]


def test_an_effect_that_leaves_nothing_ends_the_search():
    assert names(search({"sink": {"amount": 0.6}})) == [(), ("sink",)]


def test_where_the_best_leaves_much_all_are_fitted_and_then_two():
    """`shortlist` hands on one alone."""
    found = search(BOTH)
    assert names(found)[0] == () and {*names(found)} == {(), ("drift",), ("sink",), ("sink", "drift")}
    gains = {answer.names: answer.gain for answer in found.answers}
    assert gains["sink", "drift"] > max(gains["sink",], gains["drift",]) + 20.0


@pytest.mark.parametrize(("temperature", "class_ratio", "two"), [(1.0, 1.0, True), (9.0, 1.0, False), (9.0, 0.1, True)])
def test_two_are_fitted_where_they_may_be_in_the_class_though_the_best_leaves_nothing_beyond_noise(
    temperature, class_ratio, two
):
    """A model error that has room for what the best leaves."""
    error = ModelError(rms=1e-3, moved=1e-4)
    wide = replace(SETTINGS, model_error=error, temperature=temperature, class_ratio=class_ratio)
    found = search(BOTH, wide)
    (best, *_) = found._ordered()
    assert best.unknowns.effects == ("sink",) and found.evidence.excess(best) < found.threshold
    assert (("sink", "drift") in names(found)) is two


def test_without_seconds_no_pair_is_fitted():
    found = search(BOTH, replace(SETTINGS, seconds=0))
    assert {*names(found)} == {(), ("drift",), ("sink",)}


def test_an_effect_caught_in_a_poor_minimum_is_replaced_by_the_one_from_a_pair():
    """A fit alone that ended badly: the pair's own part, fitted alone from there, is better and is kept."""
    found = search(BOTH)
    good = found._found["sink",]
    found._found["sink",] = replace(good, energy=good.energy + 50.0)
    found._keep(found.refits.alone(found._found["sink", "drift"]))
    assert np.isclose(found._found["sink",].energy, good.energy, atol=0.5)
