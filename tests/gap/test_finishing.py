"""Fits are made beside an error of the size that is there, and go on beside one of their own, in a linear world."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings, Search, Trial
from physreal_core.gap.fits.baseline import fit_baseline
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import Finish
from physreal_core.gap.fits.least_squares import fit, together
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import FITTED_BESIDE, Measurements, Predicted
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, LinearExperiment, MadeUp, register

SETTINGS = GapSettings(model_error=ModelError(rms=3e-4, moved=1e-4))


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def test_a_fit_in_units_of_another_noise_model_is_what_it_would_be_there():
    experiment = LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})
    baseline, measurements = fit_baseline([experiment], SETTINGS)
    data, other = measurements.train, measurements.beside_error(0.5 * measurements.size).train
    moved = rewhitened(baseline, data, other)
    np.testing.assert_allclose(moved.residual, other.residuals([p[None] for p in baseline.predicted])[:, 0], atol=2e-3)
    back = rewhitened(moved, other, data)
    np.testing.assert_allclose(back.residual, baseline.residual, atol=2e-3)
    np.testing.assert_allclose(back.jacobian, baseline.jacobian, atol=1e-3 * np.abs(baseline.jacobian).max())
    assert back.energy == pytest.approx(baseline.energy, rel=1e-4)


def test_a_fit_whose_rollout_failed_stays_failed_in_other_units(monkeypatch):
    baseline, measurements = fit_baseline([LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})], SETTINGS)
    monkeypatch.setattr(
        LinearExperiment,
        "predict",
        lambda self, trials, frames: np.full((len(trials), *self.measured[:frames].shape), np.nan),
    )
    evidences = Evidences(measurements, SETTINGS)
    (broken,) = Finish(measurements, evidences, 3)._gone_on([(baseline, None)])
    assert broken.energy == np.inf
    assert evidences.of(broken).log_evidence == -np.inf


def test_the_baseline_is_fitted_beside_an_error_as_large_as_it_leaves():
    sizes = {}
    for amount in (0.0, 0.9):
        baseline, measurements = fit_baseline([LinearExperiment(ANSWERS, {"sink": {"amount": amount}})], SETTINGS)
        sizes[amount] = measurements.size
        left = np.clip(Evidences(measurements, SETTINGS).of(baseline).size, *FITTED_BESIDE)
        assert measurements.size == pytest.approx(left, rel=0.25)
    assert sizes[0.9] > 4.0 * sizes[0.0]


def test_what_a_fit_beside_a_wide_error_left_is_found_beside_its_own():
    experiment = LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})
    baseline, measurements = fit_baseline([experiment], SETTINGS)
    own, wide = baseline.unknowns, measurements.beside_error(FITTED_BESIDE[1])
    unknowns = Unknowns(own.fields, ("sink",), own.priors, scalars=own.scalars)
    (begun,) = together([fit(unknowns, wide.train, unknowns.start()[None], 12)])
    evidences = Evidences(wide, SETTINGS)
    (after,) = Finish(wide, evidences, 12).settled([begun])
    assert evidences.gain(after, begun) >= 0.0
    at = unknowns.places["sink"].start
    assert abs(after.vector[at] - 0.6) <= abs(begun.vector[at] - 0.6)
    assert after.vector[at] == pytest.approx(0.6, abs=0.05)


def test_all_answers_are_judged_beside_the_noise_around_those_near_the_best(monkeypatch):
    around, made = [], Measurements.around_all
    monkeypatch.setattr(Measurements, "around_all", lambda self, trials: around.extend(trials) or made(self, trials))
    monkeypatch.setattr("physreal_core.gap.fits.strategy.FAR_BEHIND", 10.0)
    search = Search(
        [LinearExperiment(ANSWERS, {"sink": {"amount": 0.9}})], replace(SETTINGS, candidates=("drift", "sink"))
    )
    strategy = search.begin()
    known = strategy.measurements
    strategy.run()
    assert [trial.effects.keys() for trial in around] == [{"sink"}]
    data = strategy.measurements.train
    assert (
        strategy.measurements is not known and strategy.evidences.gain(strategy.found["sink",], strategy.baseline) > 10
    )
    for found in (strategy.baseline, *strategy.found.values()):
        np.testing.assert_allclose(found.residual, data.residuals([p[None] for p in found.predicted])[:, 0], atol=5e-3)
    at = strategy.found["sink",].unknowns.places["sink"].start
    assert strategy.found["sink",].vector[at] == pytest.approx(0.9, abs=0.05)


def test_the_noise_around_several_motions_has_the_mean_of_their_covariances():
    experiment, random = LinearExperiment(ANSWERS, {}), np.random.default_rng(0)
    motion, size = experiment.predict([Trial(experiment.model.fields)])[0], (*experiment.valid.shape, 3)

    def around(number: int) -> Predicted:
        fields = (random.standard_normal((n, *size)) for n in (number, 3, 2))
        reruns, start_sensitivity, given = fields
        return Predicted(motion, reruns, start_sensitivity, given)

    several = [around(1), around(4)]
    mean = Predicted.mean(several)
    for part in ("reruns", "given"):
        covariances = [np.einsum("mtjx,mtjx->tjx", *(getattr(own, part),) * 2) for own in (mean, *several)]
        np.testing.assert_allclose(covariances[0], 0.5 * (covariances[1] + covariances[2]))


def test_a_motion_around_which_no_noise_can_be_simulated_is_left_out(monkeypatch):
    baseline, measurements = fit_baseline([LinearExperiment(ANSWERS, {"sink": {"amount": 0.9}})], SETTINGS)
    trial = baseline.unknowns.trial(baseline.vector)
    monkeypatch.setattr(Predicted, "finite", property(lambda self: False))
    assert measurements.around_all([trial]) is measurements


def test_the_best_effects_family_is_fitted_whatever_its_score(monkeypatch):
    """`shortlist` hands on one alone, and the best leaves nothing."""

    def names(family: str) -> set[tuple[str, ...]]:
        monkeypatch.setitem(EFFECTS, "drift", MadeUp("drift", EFFECTS["drift"].coefficients, family))
        settings = replace(SETTINGS, candidates=("drift", "sink"), shortlist=1)
        found = Search([LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})], settings).run()
        return {answer.names for answer in found.answers}

    assert names("drift") == {(), ("sink",)}
    assert names("sink") == {(), ("sink",), ("drift",)}


def test_effects_are_screened_anew_where_the_baseline_has_gained_more_than_any_of_them(monkeypatch):
    settings, made, begun = replace(SETTINGS, candidates=("drift", "sink")), CandidateFits.beside, []
    monkeypatch.setattr(CandidateFits, "beside", lambda *given: begun.append(given[0]) or made(*given))

    def screens(least: float, amount: float) -> int:
        monkeypatch.setattr("physreal_core.gap.fits.strategy.LEFT_BEHIND", least)
        begun.clear()
        truth = {"sink": {"amount": amount}}
        found = Search([LinearExperiment(ANSWERS, truth)], settings).run()
        best = max(found.answers, key=lambda answer: answer.gain)
        assert best.names == (("sink",) if amount else ())
        return len(begun)

    assert screens(np.inf, 0.6) == 1 and screens(np.inf, 0.0) == 1
    assert screens(-np.inf, 0.6) == 1  # the effect gains more than the baseline has
    assert screens(-np.inf, 0.0) == 2
