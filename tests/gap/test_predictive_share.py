"""Which of two interactions predicts the other."""

import numpy as np

from physreal_core.gap.answers.predictive_share import predictive_shares
from physreal_core.gap.fits.candidate_fits import CandidateFits
from physreal_core.gap.fits.least_squares import Data
from physreal_core.gap.settings import GapSettings
from tests.gap.linear import ANSWERS, LinearExperiment, baseline, register


def test_the_interaction_that_shows_the_effect_tells_of_the_one_that_hardly_does(monkeypatch):
    register(monkeypatch)
    faint = {name: {key: 0.05 * change for key, change in changes.items()} for name, changes in ANSWERS.items()}
    truth = {"sink": {"amount": 2.0}}
    plain, dim = LinearExperiment(ANSWERS, truth, 0), LinearExperiment(faint, truth, 1)
    for experiments in ([plain, dim], [dim, plain]):
        data = Data(experiments, [experiment.noise() for experiment in experiments])
        fits = CandidateFits.beside(baseline(experiments[0], data), data, ("sink",), GapSettings())
        (found,) = fits.fitted(fits.ranked())
        shares = predictive_shares(found, fits.baseline, data)
        assert int(np.argmax(shares)) == experiments.index(plain)
        assert all(0.0 <= share <= 1.0 for share in shares)


def test_alone_there_is_nothing_to_choose(monkeypatch):
    register(monkeypatch)
    experiment = LinearExperiment(ANSWERS, {})
    data = Data([experiment], [experiment.noise()])
    found = baseline(experiment, data)
    assert predictive_shares(found, found, data) == (1.0,)
