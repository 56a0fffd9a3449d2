"""What is fitted anew to show what a named effect does, in a linear world."""

import numpy as np
import pytest

from physreal_core.gap import GapSettings, add_effect, find_gap
from physreal_core.gap.adding import EffectFits
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, LinearExperiment, register

SETTINGS = GapSettings(
    candidates=("drift", "sink"), shortlist=2, model_error=ModelError(rms=3e-4, moved=1e-4), temperature=1.0
)
TRUTH = {"sink": {"amount": 0.6}}


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


@pytest.mark.parametrize("interactions", [1, 2])
def test_the_searchs_own_fits_are_shown_if_it_knew_one_interaction(interactions):
    experiments, said = [LinearExperiment(ANSWERS, TRUTH, seed) for seed in range(interactions)], []
    report = find_gap(experiments, SETTINGS)
    assert report.verdict.names == ("sink",)
    added = add_effect(experiments, report, SETTINGS, said.append)
    assert added.adopted and added.closed > 0.9
    assert added.effects == report.best.effects
    assert bool(said) == (interactions == 2)  # no baseline is fitted again
    if interactions == 1:
        assert [d.rms for d in added.before] == pytest.approx([d.rms for d in report.baseline])


def test_what_was_not_searched_for_is_fitted():
    experiments = [LinearExperiment(ANSWERS, TRUTH)]
    report = find_gap(experiments, GapSettings(candidates=("drift",), model_error=SETTINGS.model_error))
    added = add_effect(experiments, report, SETTINGS, names=["sink"])
    assert added.adopted and added.effects[0].values["amount"] == pytest.approx(0.6, rel=0.1)


def test_a_fit_to_another_interaction_keeps_nothing_of_where_it_began():
    """It begins at the numbers of an answer, and ends where one ends that is made there alone."""
    other = LinearExperiment(ANSWERS, {"sink": {"amount": 0.9}}, seed=1)
    report = find_gap([LinearExperiment(ANSWERS, TRUTH)], SETTINGS)
    begun = EffectFits.begin([other], SETTINGS, lambda message: None, report.fields)
    alone = EffectFits.begin([other], SETTINGS, lambda message: None)
    found, anew = begun.from_answer(report.best), alone.with_effects(["sink"])
    np.testing.assert_allclose(found.vector, anew.vector, atol=0.1)
    assert abs(anew.vector[-1] - report.best.effects[0].values["amount"]) > 0.2
    assert begun.baseline.energy == pytest.approx(alone.baseline.energy, abs=0.5)
