"""Fits, scores and evidence in a linear world, against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from physreal_core.gap.answers.answer import NINETY, fitted_effects
from physreal_core.gap.fits import least_squares
from physreal_core.gap.fits.evidence import Evidence
from physreal_core.gap.fits.least_squares import Answered, Asked, Data, Fit, fit, together
from physreal_core.gap.fits.linear_starts import linear_starts
from physreal_core.gap.fits.screening import Screen, project_out
from physreal_core.gap.fits.unknowns import Priors, Unknowns
from physreal_core.gap.settings import GapSettings
from tests.gap.linear import ANSWERS, LinearExperiment, baseline, register

PRIORS = Priors()


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def scene(truth: dict) -> tuple[LinearExperiment, Data]:
    experiment = LinearExperiment(ANSWERS, truth)
    return experiment, Data([experiment], [experiment.noise()])


def with_effect(name, base, data):
    screen = Screen.of(base, data, [name], PRIORS)
    (score,) = screen.scores(base.residual)
    unknowns, starts, known = linear_starts([score])
    (found,) = together([fit(unknowns, data, starts, 8, known)])
    return score, found


def test_fit_reaches_the_closed_form_of_a_linear_problem():
    experiment, data = scene({"sink": {"amount": 0.8}})
    _, found = with_effect("sink", baseline(experiment, data), data)
    block = found.unknowns.block
    gradient = found.jacobian.T @ found.residual + block.precision @ (found.vector - block.mean)
    newton = np.linalg.solve(found.hessian, gradient)
    assert np.abs(newton / np.sqrt(np.diag(found.covariance))).max() < 0.3
    sd = np.sqrt(found.covariance[-1, -1])
    assert found.vector[-1] == pytest.approx(0.8, abs=3 * sd) and sd < 0.1


def rollouts(request, data, failing=()) -> tuple[list[int], Fit]:
    """How many trials a fit asks for, round by round, where the rollouts of some rounds fail; and where it ends."""
    sizes, asked = [], next(request.steps)
    while True:
        (answered,) = data.answer([asked])
        if len(sizes) in failing:
            answered = Answered(*([np.full_like(p, np.nan) for p in own] for own in (answered.trials, answered.around)))
        sizes.append(len(asked.trials) + len(asked.around))
        try:
            asked = request.steps.send(answered)
        except StopIteration as done:
            return sizes, done.value


def test_a_step_that_failed_mends_old_tangents_and_a_second_one_has_them_taken_anew():
    experiment, data = scene({})
    base = baseline(experiment, data)
    unknowns, start = base.unknowns, base.unknowns.start()
    wrong = base.jacobian * np.where(np.arange(len(start)) < 2, -1.0, 1.0)
    sizes, found = rollouts(fit(unknowns, data, start[None], 8, [wrong]), data)
    assert set(sizes) == {1} and found.energy == pytest.approx(base.energy, abs=0.3)
    sizes, found = rollouts(fit(unknowns, data, start[None], 8, [base.jacobian]), data, failing=(1, 2))
    assert sizes[:4] == [1, 1, 1, len(start)] and set(sizes[4:]) == {1}
    assert found.energy == pytest.approx(base.energy, abs=0.3)


class Rough(LinearExperiment):
    """The same world seen askew: every prediction is off by a constant, and answers by a factor. It counts its rollouts."""

    def __init__(self, full: LinearExperiment, factor: float) -> None:
        self.__dict__ |= vars(full)
        self.factor, self.rollouts = factor, 0

    def predict(self, trials, frames=None, discretisation=None) -> np.ndarray:
        self.rollouts += len(trials)
        found = super().predict(trials, frames, discretisation)
        return 0.05 + self.points0 + self.factor * (found - self.points0)


def in_two_forms(factor: float) -> tuple[LinearExperiment, Data, Data, Rough]:
    experiment, full = scene({"sink": {"amount": 0.8}})
    rough = Rough(experiment, factor)
    return experiment, full, Data([experiment], full.noises, [rough]), rough


@pytest.mark.parametrize("factor", [1.15, 0.85])
def test_tangents_of_quick_rollouts_lead_to_the_minimum_of_full_ones(factor):
    experiment, full, data, rough = in_two_forms(factor)
    base, quick = baseline(experiment, full), baseline(experiment, data)
    assert quick.energy == pytest.approx(base.energy, abs=0.5)
    _, found = with_effect("sink", base, full)
    rough.rollouts = 0
    _, quickly = with_effect("sink", base, data)
    assert quickly.energy == pytest.approx(found.energy, abs=0.5) and rough.rollouts > 0
    assert quickly.vector == pytest.approx(found.vector, abs=0.02)


def test_where_quick_tangents_lead_nowhere_full_ones_are_taken():
    experiment, full, data, _ = in_two_forms(-1.0)
    assert baseline(experiment, data, 12).energy == pytest.approx(baseline(experiment, full).energy, abs=0.5)


def test_trials_in_two_forms_are_answered_in_the_order_in_which_they_were_asked_for():
    experiment, full, data, _ = in_two_forms(1.0)
    unknowns = baseline(experiment, full).unknowns
    trials = [unknowns.trial(unknowns.start() + 0.1 * step) for step in range(5)]
    asked = [Asked(trials[:1], trials[3:]), Asked(trials[1:3]), Asked()]
    for own, answered in zip(asked, data.answer(asked), strict=True):
        for trials, (found,), shift in ((own.trials, answered.trials, 0.0), (own.around, answered.around, 0.05)):
            assert len(found) == len(trials)
            if trials:
                np.testing.assert_allclose(found, experiment.predict(trials)[:, : data.frames[0]] + shift)


@pytest.mark.parametrize("thorough", [False, True])
def test_a_thorough_fit_does_not_end_where_only_old_tangents_see_nothing_to_gain(thorough):
    experiment, data = scene({})
    base = baseline(experiment, data)
    unknowns, start = base.unknowns, base.unknowns.start()
    blind = np.zeros_like(base.jacobian)
    (found,) = together([fit(unknowns, data, start[None], 8, [blind], thorough)])
    assert (found.energy == pytest.approx(base.energy, abs=0.3)) == thorough


class Bent(LinearExperiment):
    """`sink` leads down to 0.8 and from there up again twice as steeply."""

    def _one(self, trial):
        amount = trial.effects.get("sink", {}).get("amount", 0.0)
        effects = {"sink": {"amount": amount - 3.0 * max(0.0, amount - 0.8)}} if amount else {}
        return super()._one(SimpleNamespace(fields=trial.fields, effects=effects))


@pytest.mark.parametrize("fine, reached", [(1.0, False), (0.2, True)])
def test_where_plain_secants_lead_astray_a_fit_goes_on_with_fine_ones(monkeypatch, fine, reached):
    """From 0.65 the secant, of length 0.25, points up, the tangent down to the truth."""
    monkeypatch.setattr(least_squares, "FINE", fine)
    experiment = Bent(ANSWERS, {"sink": {"amount": 0.75}})
    data = Data([experiment], [experiment.noise()])
    base = baseline(experiment, data)
    unknowns = Unknowns(experiment.model.fields, ("sink",), PRIORS, {"sink": {"amount": 0.65}}, scalars=())
    start = np.concatenate([np.log([1.2e5, 0.9e5]), base.vector[2:3], [0.65]])
    (found,) = together([fit(unknowns, data, start[None], 8)])
    assert (abs(found.vector[-1] - 0.75) < 0.03) == reached


def test_score_foretells_the_gain_of_the_fit():
    """Where everything is linear, the score test's gain is the difference of the evidences."""
    experiment, data = scene({"drift": {"east": 0.5, "north": -0.3}})
    base = baseline(experiment, data)
    score, found = with_effect("drift", base, data)
    assert found.log_evidence - base.log_evidence == pytest.approx(score.gain, rel=0.02, abs=1.0)
    assert score.values["east"] == pytest.approx(0.5, abs=0.1)


def test_a_fit_may_start_where_the_linear_model_says_material_and_all():
    experiment, data = scene({"drift": {"east": 0.5, "north": -0.3}})
    base = baseline(experiment, data)
    (score,) = Screen.of(base, data, ["drift"], PRIORS).scores(base.residual)
    unknowns, starts, known = linear_starts([score])
    (found,) = together([fit(unknowns, data, starts, 8, known)])
    predictions = data.predict([unknowns.trial(start) for start in starts])
    residuals = data.residuals(predictions).T
    energies = [0.5 * r @ r + unknowns.prior_energy(s) for r, s in zip(residuals, starts, strict=True)]
    along, alone = energies[0], energies[-1]
    assert along == pytest.approx(found.energy, abs=0.3) and alone > along + 0.1
    np.testing.assert_allclose(score.shift, starts[0][: len(score.shift)] - base.vector)


def test_intervals_widen_as_the_likelihood_is_tempered():
    """Where the data outweigh the prior, four times the temperature is twice the interval; the scale is a factor on it."""
    experiment, data = scene({"sink": {"amount": 0.8}})
    _, found = with_effect("sink", baseline(experiment, data), data)
    evidence = Evidence(0.0, np.ones(1), 1.0, found.covariance)
    given = [GapSettings(temperature=t, interval_scale=scale) for t, scale in ((1.0, 1.0), (4.0, 1.0), (1.0, 1.5))]
    widths = [np.ptp(fitted_effects(found, evidence, own)[0].intervals["amount"]) for own in given]
    assert widths[1] == pytest.approx(2 * widths[0], rel=0.05)
    assert widths[2] == pytest.approx(1.5 * widths[0], rel=1e-6)
    assert widths[0] == pytest.approx(2 * NINETY * np.sqrt(found.covariance[-1, -1]), rel=1e-6)


def test_effects_rank_by_what_they_explain_and_signs_are_kept():
    experiment, data = scene({"sink": {"amount": 0.6}})
    base = baseline(experiment, data)
    ranked = Screen.of(base, data, ["drift", "sink"], PRIORS).scores(base.residual)
    assert [score.start.effect for score in ranked] == ["sink", "drift"]
    experiment, data = scene({"sink": {"amount": -0.6}})  # against its sign: not to be had
    base = baseline(experiment, data)
    score, found = with_effect("sink", base, data)
    assert score.values["amount"] == 0.0 and found.vector[-1] == 0.0 and score.gain < 1.0


def test_nothing_hidden_rarely_beats_the_bootstrap():
    gains = []
    for seed in range(12):
        experiment = LinearExperiment(ANSWERS, {}, seed)
        data = Data([experiment], [experiment.noise()])
        base = baseline(experiment, data)
        screen = Screen.of(base, data, ["drift", "sink"], PRIORS)
        gains.append(screen.scores(base.residual)[0].gain > np.quantile(screen.null_gains(0), 0.95))
    assert sum(gains) <= 3


def test_what_the_baseline_can_imitate_is_no_evidence():
    """A second effect that moves the tracks as a modulus does has nothing left to explain with."""
    experiment, data = scene({})
    base = baseline(experiment, data)
    column = base.jacobian[:, :1]
    assert np.linalg.norm(project_out(base, column)) < 0.2 * np.linalg.norm(column)
