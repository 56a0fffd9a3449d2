"""The elastic law is found, not given: by the baseline, by every answer at the end of its fit, and in rollouts."""

import dataclasses

import numpy as np
import pytest

from physreal_core.effects import EFFECTS
from physreal_core.gap import Experiment, GapSettings, Search, Trial, add_effect
from physreal_core.gap.fits.baseline import fit_baseline
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import Finish
from physreal_core.gap.fits.least_squares import fit, together
from physreal_core.gap.noise.measurements import possible_laws
from physreal_core.gap.noise.model import ModelError
from tests.fitting import scene
from tests.gap.linear import ANSWERS, LinearExperiment, ramp, register

SETTINGS = GapSettings(model_error=ModelError(rms=3e-4, moved=1e-4))
LAW = "saint_venant_kirchhoff"


class Lawful(LinearExperiment):
    """A world that obeys `law`; under another one tracks go astray by as much as no modulus imitates."""

    law = LAW

    def _one(self, trial) -> np.ndarray:
        own = getattr(trial, "elastic_law", self.law) or self.config.elastic_law
        return super()._one(trial) + (own != self.law) * ramp((1, -1, 1), 3.0)


@pytest.fixture
def world(monkeypatch) -> Lawful:
    register(monkeypatch)
    return Lawful(ANSWERS, {"sink": {"amount": 0.9}})


def test_the_baseline_has_the_law_that_fits_best(world):
    baseline, measurements = fit_baseline([world], SETTINGS)
    assert baseline.unknowns.elastic_law == LAW
    assert measurements.elastic_laws == ("fixed_corotated", "neo_hookean", LAW)
    given, _ = fit_baseline([world], dataclasses.replace(SETTINGS, elastic_laws=()))
    assert given.unknowns.elastic_law == "fixed_corotated"
    assert baseline.energy < given.energy


def test_a_fit_ends_under_the_law_that_gives_it_the_most_evidence(world):
    baseline, measurements = fit_baseline([world], dataclasses.replace(SETTINGS, elastic_laws=()))
    measurements = dataclasses.replace(measurements, settings=SETTINGS)
    evidences = Evidences(measurements, SETTINGS)
    finish = Finish(measurements, evidences, 12)
    best, (end,) = finish.under_the_best_law(baseline, [baseline])
    assert best.unknowns.elastic_law == end.unknowns.elastic_law == LAW
    assert evidences.gain(end, baseline) > 10.0
    again, (same,) = finish.under_the_best_law(best, [end])
    assert again is best and same is end


def test_a_law_that_the_best_answer_rules_out_is_not_tried_beside_others(world, monkeypatch):
    """The best is tried under all laws, also under those that the baseline rules out."""
    baseline, measurements = fit_baseline([world], dataclasses.replace(SETTINGS, elastic_laws=()))
    measurements = dataclasses.replace(measurements, settings=SETTINGS)
    own = baseline.unknowns
    beside = [own.beside((name,), {name: EFFECTS[name].dormant}) for name in ("sink", "drift")]
    sink, drift = together([fit(u, measurements.train, u.start()[None], 12) for u in beside])
    evidences, tried = Evidences(measurements, SETTINGS), []
    finish, gone_on = Finish(measurements, evidences, 12), Finish._gone_on
    monkeypatch.setattr(Finish, "_gone_on", lambda own, asked: tried.append(asked) or gone_on(own, asked))
    monkeypatch.setattr("physreal_core.gap.fits.finishing.RULED_OUT", 1.0)
    monkeypatch.setattr(Evidences, "gain", lambda own, one, other, gain=Evidences.gain: max(gain(own, one, other), 0.0))
    _, (best, _) = finish.under_the_best_law(baseline, [sink, drift])
    assert best.unknowns.elastic_law == LAW
    first, second = tried
    laws = "neo_hookean", LAW
    assert [(found.unknowns.effects, law) for found, law in first] == [(("sink",), law) for law in laws]
    assert [(found.unknowns.effects, law) for found, law in second] == [*(((), law) for law in laws), (("drift",), LAW)]


def test_an_answer_says_its_law_and_is_added_with_it(world):
    settings = dataclasses.replace(SETTINGS, candidates=("sink", "drift"), temperature=3.0)
    report = Search([world], settings).run().report()
    assert report.verdict.names == ("sink",)
    assert (report.elastic_law, report.best.elastic_law) == (LAW, LAW)
    assert "saint venant kirchhoff fits best" in report.verdict.sentence
    added = add_effect([world], report, settings)
    assert added.adopted and added.elastic_law == LAW


def test_flow_and_networks_keep_the_law_that_they_were_fitted_with(world):
    world.config = dataclasses.replace(world.config, elastic_law="hencky", plastic_law="von_mises")
    assert possible_laws(world, SETTINGS) == ("hencky",)


def test_a_rollout_is_under_the_law_of_its_trial():
    model = scene.model()
    experiment = Experiment(scene.problem(model, frames=6, observed=4, with_masks=False), model)
    other = dataclasses.replace(model, elastic_law=LAW)
    alone = Experiment(experiment.problem, other).predict([Trial(model.fields)])[0]
    own, under, again = experiment.predict(
        [Trial(model.fields), Trial(model.fields, elastic_law=LAW), Trial(model.fields, elastic_law=model.elastic_law)]
    )
    np.testing.assert_allclose(under, alone, rtol=0, atol=1e-7)
    np.testing.assert_allclose(again, own, rtol=0, atol=1e-7)
    assert np.abs(under - own).max() > 1e-5
    dragged = experiment.predict([Trial(model.fields, {"linear_drag": {"rate": 5.0}}, elastic_law=LAW)])[0]
    assert np.abs(dragged - under).max() > 1e-5
