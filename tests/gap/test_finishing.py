"""Fits are made beside an error of the size that is there, and go on beside one of their own, in a linear world."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings, Search
from physreal_core.gap.fits.baseline import fit_baseline
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.finishing import Finish
from physreal_core.gap.fits.least_squares import fit, together
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.fits.whitening import rewhitened
from physreal_core.gap.noise.measurements import FITTED_BESIDE, Measurements
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


def test_answers_near_the_best_are_judged_beside_noise_around_their_own_motion(monkeypatch):
    experiment = LinearExperiment(ANSWERS, {"sink": {"amount": 0.9}})
    baseline, measurements = fit_baseline([experiment], SETTINGS)
    own = baseline.unknowns
    beside = [own.beside((name,), {name: EFFECTS[name].dormant}) for name in ("sink", "drift")]
    sink, drift = together([fit(u, measurements.train, u.start()[None], 12) for u in beside])
    evidences, around = Evidences(measurements, SETTINGS), []
    made = Measurements.around_others
    monkeypatch.setattr(Measurements, "around_others", lambda self, trials: around.extend(trials) or made(self, trials))
    shared = [evidences.of(found) for found in (baseline, sink, drift)]
    assert min(evidences.gain(sink, other) for other in (baseline, drift)) > 10.0
    monkeypatch.setattr("physreal_core.gap.fits.finishing.FAR_BEHIND", 10.0)
    finish = Finish(measurements, evidences, 12)
    ends = finish.judged([baseline, sink, drift])
    assert [trial.effects.keys() for trial in around] == [{"sink"}]
    assert ends[0] is baseline and ends[2] is drift
    assert [evidences.of(found) for found in (ends[0], ends[2])] == [shared[0], shared[2]]
    assert evidences.of(ends[1]) is not shared[1]
    at = ends[1].unknowns.places["sink"].start
    assert ends[1].vector[at] == pytest.approx(0.9, abs=0.05)
    monkeypatch.setattr(Measurements, "simulated", property(lambda self: False))
    assert (
        finish.judged([baseline, sink, drift])[1] is sink
    )  # no noise model can be built around what cannot be simulated


def test_the_best_effects_family_is_fitted_whatever_its_score(monkeypatch):
    """`shortlist` hands on one alone, and the best leaves nothing."""

    def names(family: str) -> set[tuple[str, ...]]:
        monkeypatch.setitem(EFFECTS, "drift", MadeUp("drift", EFFECTS["drift"].coefficients, family))
        settings = replace(SETTINGS, candidates=("drift", "sink"), shortlist=1)
        found = Search([LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})], settings).run()
        return {answer.names for answer in found.answers}

    assert names("drift") == {(), ("sink",)}
    assert names("sink") == {(), ("sink",), ("drift",)}


def test_effects_are_screened_anew_where_the_baseline_has_gone_on(monkeypatch):
    settings, made, begun = replace(SETTINGS, candidates=("drift", "sink")), CandidateFits.beside, []
    monkeypatch.setattr(CandidateFits, "beside", lambda *given: begun.append(given[0]) or made(*given))

    def leading(least: float) -> tuple[tuple[str, ...], float]:
        monkeypatch.setattr("physreal_core.gap.fits.strategy.LEFT_BEHIND", least)
        begun.clear()
        found = Search([LinearExperiment(ANSWERS, {"sink": {"amount": 0.6}})], settings).run()
        best = max(found.answers, key=lambda answer: answer.gain)
        return best.names, best.gain

    once, gain = leading(np.inf)
    assert once == ("sink",) and len(begun) == 1
    again, gain_then = leading(-np.inf)
    assert again == once and gain_then == pytest.approx(gain, abs=0.5) and len(begun) == 2
