"""Which fits a search makes, in a linear world."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.gap import GapSettings, Search, add_effect
from physreal_core.gap.fits.least_squares import SMALL_GAIN
from physreal_core.gap.fits.strategy import PAIRS, Strategy
from physreal_core.gap.noise.model import ModelError
from physreal_core.gap.search import SearchResult
from tests.gap.linear import ANSWERS, FRAMES, LinearExperiment, register

SETTINGS = GapSettings(candidates=("drift", "sink"), shortlist=1, model_error=ModelError(rms=3e-4, moved=1e-4))
BOTH = {"sink": {"amount": 0.9}, "drift": {"east": 0.8}}


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def strategy(truth: dict, settings: GapSettings = SETTINGS) -> Strategy:
    found = Search([LinearExperiment(ANSWERS, truth)], settings).begin()
    found.run()
    return found


def search(truth: dict, settings: GapSettings = SETTINGS) -> SearchResult:
    return Search([LinearExperiment(ANSWERS, truth)], settings).run()


def names(found: SearchResult) -> list[tuple[str, ...]]:
    return [answer.names for answer in found.answers]


def test_an_effect_that_leaves_nothing_ends_the_search():
    assert names(search({"sink": {"amount": 0.6}})) == [(), ("sink",)]


def test_where_the_best_leaves_much_all_are_fitted_and_then_two():
    """`shortlist` hands on one alone."""
    found = search(BOTH)
    assert names(found)[0] == () and {*names(found)} == {(), ("drift",), ("sink",), ("sink", "drift")}
    gains = {answer.names: answer.gain for answer in found.answers}
    assert gains["sink", "drift"] > max(gains["sink",], gains["drift",]) + 10.0


@pytest.mark.parametrize(("temperature", "class_ratio", "two"), [(1.0, 1.0, True), (9.0, 1.0, False), (9.0, 0.1, True)])
def test_two_are_fitted_where_they_may_be_in_the_class_though_the_best_leaves_nothing_beyond_noise(
    temperature, class_ratio, two
):
    """A model error that has room for what the best leaves."""
    error = ModelError(rms=1e-3, moved=1e-4)
    wide = replace(SETTINGS, model_error=error, temperature=temperature, class_ratio=class_ratio)
    found = search(BOTH, wide)
    (best, *_) = found.strategy.ordered()
    assert best.unknowns.effects == ("sink",)
    assert found.strategy.evidences.of(best).size < wide.error_prior.exceeded_by(PAIRS)
    assert (("sink", "drift") in names(found)) is two


def test_without_seconds_no_pair_is_fitted():
    found = search(BOTH, replace(SETTINGS, seconds=0))
    assert {*names(found)} == {(), ("drift",), ("sink",)}


def test_an_effect_caught_in_a_poor_minimum_is_replaced_by_the_one_from_a_pair():
    """A fit alone that ended badly: the pair's own part, fitted alone from there, is better and is kept."""
    own = strategy(BOTH)
    good = own.found["sink",]
    own.found["sink",] = replace(good, energy=good.energy + 50.0)
    own.keep(own.candidate_fits.alone(own.found["sink", "drift"]))
    assert np.isclose(own.found["sink",].energy, good.energy, atol=SMALL_GAIN)


def test_a_search_that_is_constructed_has_run_nothing(monkeypatch):
    experiment = LinearExperiment(ANSWERS, {})
    for method in ("predict", "predict_with_start_sensitivity", "motion"):
        monkeypatch.setattr(experiment, method, _fail)
    waiting = Search([experiment], SETTINGS)
    with pytest.raises(AssertionError, match="was rolled out"):
        waiting.begin()


def test_no_motion_is_proposed_where_there_is_no_hand_to_move():
    """Then the verdict on a class keeps saying what shows each effect."""
    found = search(BOTH)
    assert found.next_motions([("sink",), ("drift",)]) == () and found.report().next_motions == ()


def _fail(*arguments, **options):
    raise AssertionError("something was rolled out")


class Breaking(LinearExperiment):
    """Once it is measured, no rollout comes to the last two frames, which are held out."""

    broken = False

    def _one(self, trial) -> np.ndarray:
        points = super()._one(trial)
        if self.broken:
            points[FRAMES - 2 :] = np.nan
        return points


@pytest.mark.parametrize(("amount", "named"), [(0.0, ()), (0.9, ("sink",))])
def test_a_model_that_breaks_off_in_held_out_frames_is_judged_by_those_before(amount, named):
    world = Breaking(ANSWERS, {"sink": {"amount": amount}})
    world.broken = True
    settings = replace(SETTINGS, temperature=3.0)
    report = Search([world], settings).run().report()
    assert report.verdict.names == named
    assert len(report.where[0]["frames"]["gap"]) == FRAMES - 2
    assert np.isfinite([c.held_out for c in report.candidates if c.gain is not None]).all()
    assert not add_effect([world], report, settings).adopted
