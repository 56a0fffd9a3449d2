"""Where fits of candidates begin and end, in a linear world."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings
from physreal_core.gap.adding import EffectFits
from physreal_core.gap.fits.candidate_fits import FEW, MODULI_WITHOUT, CandidateFits
from physreal_core.gap.fits.least_squares import Data
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, LinearExperiment, MadeUp, baseline, register

NAMES = ("drift", "sink")
FAR = 0.9
SETTINGS = GapSettings()


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def candidate_fits(truth: dict, iterations: int = 8) -> CandidateFits:
    experiment = LinearExperiment(ANSWERS, truth)
    data = Data([experiment], [experiment.noise()])
    return CandidateFits.beside(baseline(experiment, data, iterations), data, NAMES, SETTINGS)


def test_contrast_that_the_baseline_needs_is_screened_without_too():
    """The two moduli of the linear world differ by a third, which its tracks show."""
    found = candidate_fits({"sink": {"amount": 0.6}})
    level = found.screens[1].baseline
    patches = level.vector[: level.unknowns.patches]
    assert len(found.screens) == 2 and np.ptp(patches) < 0.05
    assert level.energy > found.baseline.energy
    ranked = found.ranked()
    assert ranked[0][0].start.effect == "sink" and len(ranked[0]) == 2


def test_every_effect_is_fitted_to_better_than_its_start_and_two_together():
    found = candidate_fits({"sink": {"amount": 0.6}, "drift": {"east": 0.4}})
    ranked = found.ranked()
    fits = found.fitted(ranked)
    assert all(fit.energy < found.baseline.energy for fit in fits)
    best = max(fits, key=lambda fit: fit.log_evidence)
    ((score,),) = found.ranked_beside(best)
    assert {score.start.effect, *best.unknowns.effects} == {*NAMES}
    (pair,) = found.converged(found.fitted([[score]]))
    values = pair.unknowns.values(pair.vector)
    assert values["sink"]["amount"] == pytest.approx(0.6, abs=0.1)
    assert values["drift"]["east"] == pytest.approx(0.4, abs=0.1)


def test_a_baseline_that_stopped_short_goes_on_from_the_others():
    """Otherwise an effect would gain by having started where the material is right."""
    short = candidate_fits({}, iterations=1)
    fits = short.fitted(short.ranked())
    none, *_ = short.converged([short.baseline, *fits])
    assert none.unknowns.effects == () and none.energy <= short.baseline.energy
    assert max(fit.log_evidence for fit in fits) - none.log_evidence < 2.0


def test_the_baseline_is_fitted_from_the_material_of_an_answer():
    """One that was never fitted itself comes to the energy of the best one."""
    never, best = candidate_fits({}, iterations=0), candidate_fits({}).baseline
    answers = never.fitted(never.ranked())
    again = never.without_effects(answers)
    assert [fit.unknowns.elastic_law for fit in again] == [fit.unknowns.elastic_law for fit in answers]
    for own in (fit.unknowns for fit in again):
        assert own.effects == () and own.fields is never.baseline.unknowns.fields
        np.testing.assert_array_equal(own.block.precision, never.baseline.unknowns.block.precision)
    assert never.baseline.energy > best.energy + 50.0
    assert all(fit.energy < best.energy + 1.0 for fit in again)


def test_the_baseline_begins_at_the_modulus_that_suits_it_without_the_effect():
    """Beside an effect a modulus was too small by one of the factors tried, which gives that back before any step is taken."""
    found = candidate_fits({})
    still = replace(found, settings=replace(SETTINGS, settling=0))
    off = found.baseline.vector.copy()
    off[: found.baseline.unknowns.patches] -= np.log(max(MODULI_WITHOUT))
    (begun,) = still.without_effects([replace(found.baseline, vector=off)])
    np.testing.assert_allclose(begun.vector, found.baseline.vector)


def test_an_effect_is_fitted_alone_from_where_two_are():
    found = candidate_fits({"sink": {"amount": 0.6}, "drift": {"east": 0.4}})
    (two,) = found.converged(found.fitted(found.ranked_beside(found.fitted(found.ranked())[0])[:1]))
    alone = found.alone(two)
    assert [fit.unknowns.effects for fit in alone] == [(name,) for name in two.unknowns.effects]
    assert all(two.energy < fit.energy < found.baseline.energy for fit in alone)


def test_a_screen_taken_anew_promises_the_same_in_a_linear_world():
    """Beside a fit with an effect in it: what does not go with it is left out."""
    found = candidate_fits({"sink": {"amount": 0.6}, "drift": {"east": 0.4}})
    best = max(found.fitted(found.ranked()), key=lambda fit: fit.log_evidence)
    ((score,),) = found.ranked_beside(best)
    (other,) = set(NAMES) - set(best.unknowns.effects)
    assert score.start.effect == other
    (settled,) = found.converged(found.fitted([[score]]))
    assert settled.log_evidence - best.log_evidence == pytest.approx(score.gain, rel=0.05)


class Late(LinearExperiment):
    """`sink` moves the tracks only when it is large, down and sideways; `slump` moves them down at once."""

    def _one(self, trial):
        sink, slump = (trial.effects.get(name, {}).get("amount", 0.0) for name in ("sink", "slump"))
        late = max(0.0, sink - 0.3)
        effects = {"sink": {"amount": late}, "drift": {"east": late}, "slump": {"amount": slump}}
        return super()._one(SimpleNamespace(fields=trial.fields, effects=effects))


@pytest.fixture
def late(monkeypatch) -> Late:
    """`sink` is missing, far from where its tangents are taken, and `slump`, of the same term, is not."""
    for name in ("sink", "slump"):
        effect = MadeUp(name, EFFECTS["sink"].coefficients, name)
        effect.terms = ("weight",)
        monkeypatch.setitem(EFFECTS, name, effect)
    return Late({**ANSWERS, "slump": ANSWERS["sink"]}, {"sink": {"amount": FAR}})


def test_what_another_of_the_same_term_may_stand_for_is_found_from_a_plain_size_beside_it(late):
    """Its tangents promise nothing, and so nothing comes of a fit from them."""
    data = Data([late], [late.noise()])
    found = CandidateFits.beside(baseline(late, data), data, ("sink", "slump", "drift"), SETTINGS)
    fits = {fit.unknowns.effects[0]: fit for fit in found.converged(found.fitted(found.ranked()))}
    kin = found.converged(found.look_alikes(fits["slump"]))
    assert [fit.unknowns.effects for fit in kin] == [("sink",)]
    assert kin[0].unknowns.values(kin[0].vector)["sink"]["amount"] == pytest.approx(FAR, abs=0.05)
    assert kin[0].log_evidence > fits["slump"].log_evidence + 10.0
    assert fits["slump"].log_evidence > fits["sink"].log_evidence + 10.0
    assert found.look_alikes(fits["drift"]) == [] == found.look_alikes(fits["slump"], ["drift"])


def test_what_is_added_is_fitted_from_where_the_search_finds_it(late):
    """Though only the effect that is added is named, and not what takes its place at first."""
    settings = replace(SETTINGS, candidates=("sink", "slump", "drift"), model_error=ModelError(rms=3e-4, moved=1e-4))
    fits = EffectFits.begin([late], settings, lambda message: None)
    added = fits.with_effects(["sink"])
    assert added.unknowns.effects == ("sink",)
    assert added.unknowns.values(added.vector)["sink"]["amount"] == pytest.approx(FAR, abs=0.05)


class Barrier(LinearExperiment):
    """`sink` moves the tracks up at first and down only beyond half a metre of it."""

    def _one(self, trial):
        amount = trial.effects.get("sink", {}).get("amount", 0.0)
        return super()._one(
            SimpleNamespace(fields=trial.fields, effects={"sink": {"amount": 4 * amount * (amount - 0.5)}})
        )


@pytest.mark.parametrize(("hook", "reached"), [(None, 0.0), ("large_starts", FAR), ("blocking_starts", FAR)])
def test_an_effect_that_a_modulus_hides_is_found_from_a_plain_size(monkeypatch, hook, reached):
    if hook:
        monkeypatch.setattr(type(EFFECTS["sink"]), hook, lambda *what_tells_of_it: ({"amount": 1.2},))
    experiment = Barrier(ANSWERS, {"sink": {"amount": FAR}})
    data = Data([experiment], [experiment.noise()])
    found = CandidateFits.beside(baseline(experiment, data), data, ("sink",), SETTINGS)
    assert found.needs_large_starts("sink") == bool(hook)
    (fitted,) = found.converged(found.fitted(found.ranked()))
    assert fitted.unknowns.values(fitted.vector)["sink"]["amount"] == pytest.approx(reached, abs=0.1)


def test_of_many_large_starts_those_that_come_closest_are_fitted(monkeypatch):
    amounts = (3.0, 0.1, 1.0, 9.0, 0.5)
    large = tuple({"amount": amount} for amount in amounts)
    monkeypatch.setattr(EFFECTS["sink"], "large_starts", lambda setting: large, raising=False)
    found = candidate_fits({"sink": {"amount": 0.9}})
    scores = next(scores for scores in found.ranked() if scores[0].start.effect == "sink")
    fitted = [request.unknowns.at["sink"]["amount"] for request in found._from_large_amplitudes(scores[:1])["sink"]]
    assert len(fitted) == FEW and {*fitted} == {0.5, 1.0}


class Torn(LinearExperiment):
    """`sink` tears the body where it is large, so that nothing is predicted. As a simulator, it refuses a modulus that is no number."""

    def _one(self, trial):
        assert all(bool(field.isfinite().all()) for field in trial.fields.values())
        tracks = super()._one(trial)
        return np.full_like(tracks, np.nan) if trial.effects.get("sink", {}).get("amount", 0.0) > 2.0 else tracks


def test_a_start_from_which_the_rollout_fails_is_left_alone(monkeypatch):
    monkeypatch.setattr(type(EFFECTS["sink"]), "blocking_starts", lambda *what_tells_of_it: ({"amount": 3.0},))
    experiment = Torn(ANSWERS, {"sink": {"amount": 0.9}})
    data = Data([experiment], [experiment.noise()])
    found = CandidateFits.beside(baseline(experiment, data), data, ("sink",), SETTINGS)
    (fitted,) = found.fitted(found.ranked())
    assert np.isfinite(fitted.vector).all()
    assert fitted.unknowns.values(fitted.vector)["sink"]["amount"] == pytest.approx(0.9, abs=0.05)
