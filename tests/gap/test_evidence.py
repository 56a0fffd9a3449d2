"""Evidence where the size of the model's error is integrated out, in a linear world."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.gap import GapSettings
from physreal_core.gap.fits.evidence import Evidences
from physreal_core.gap.fits.least_squares import Fit, fit, together
from physreal_core.gap.fits.unknowns import Unknowns
from physreal_core.gap.noise.discrepancy import Discrepancy, ErrorPrior
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.noise.model import ModelError
from tests.gap.linear import ANSWERS, FRAMES, LinearExperiment, register

SETTINGS = GapSettings(model_error=ModelError(rms=3e-4, moved=1e-4))


@pytest.fixture(autouse=True)
def registry(monkeypatch):
    register(monkeypatch)


def made(truth: dict, settings: GapSettings, error: float = 0.0) -> tuple[Measurements, list[Fit]]:
    """Measurements with a smooth error of a size [m] of their own, and fits of nothing, of `sink` and of `drift`."""
    experiment = LinearExperiment(ANSWERS, truth)
    time = np.linspace(0, 1, FRAMES)[:, None, None]
    experiment.measured = experiment.measured + error * np.sin(9.0 * time) * np.ones(3)
    unknowns = [
        Unknowns(experiment.model.fields, names, settings.priors, scalars=()) for names in ((), ("sink",), ("drift",))
    ]
    measurements = Measurements.around([experiment], [unknowns[0].trial(unknowns[0].start())], settings)
    data = measurements.train
    return measurements, together([fit(own, data, own.start()[None], 12) for own in unknowns])


def test_of_one_size_alone_it_is_that_of_the_fits():
    settings = replace(SETTINGS, error_prior=ErrorPrior(sizes=(1.0,)))
    measurements, (none, *others) = made({"sink": {"amount": 0.6}}, settings)
    evidences = Evidences(measurements, settings)
    for found in others:
        assert evidences.gain(found, none) == pytest.approx(found.log_evidence - none.log_evidence, rel=1e-3, abs=0.05)
        np.testing.assert_allclose(evidences.of(found).covariance, found.covariance, rtol=2e-3)
        assert evidences.of(found).size == pytest.approx(1.0)


def test_a_larger_error_is_found_larger_and_tempers_what_is_gained():
    sizes = []
    for error in (1e-4, 3e-3):
        measurements, (none, sink, _) = made({"sink": {"amount": 0.6}}, SETTINGS, error)
        evidences = Evidences(measurements, SETTINGS)
        sizes.append(evidences.of(sink).size)
    assert sizes[1] > 3.0 * sizes[0]
    assert 0.0 < evidences.gain(sink, none) < 0.7 * (sink.log_evidence - none.log_evidence)


def test_an_answer_that_leaves_much_does_not_widen_the_error_of_one_that_leaves_little():
    measurements, (none, sink, drift) = made({"sink": {"amount": 1.5}}, SETTINGS)
    evidences = Evidences(measurements, SETTINGS)
    assert evidences.of(drift).size > 2.0 * evidences.of(sink).size
    # and the rival pays for what it leaves by a logarithm, not by its square
    assert 5.0 < evidences.gain(sink, drift) < sink.log_evidence - drift.log_evidence
    assert evidences.gain(sink, none) > evidences.gain(drift, none)


def test_held_out_frames_are_as_likely_as_their_density_says():
    """Under one size of the error, the difference of two fits is that of their densities in the noise model."""
    settings = replace(SETTINGS, error_prior=ErrorPrior(sizes=(1.0,)))
    measurements, (none, sink, _) = made({"sink": {"amount": 0.6}}, settings)
    (experiment,), (noise,) = measurements.experiments, [measurements.held_out(0)]
    evidences, densities = Evidences(measurements, settings), []
    for found in (none, sink):
        predicted = experiment.predict([found.unknowns.trial(found.vector)])
        told = evidences.held_out(found, [*predicted])
        densities.append((told, noise.log_density(predicted[0] - experiment.measured)))
    (none_told, none_density), (sink_told, sink_density) = densities
    assert sink_told - none_told == pytest.approx(sink_density - none_density, rel=1e-3, abs=0.02)
    assert sink_told > none_told


def test_a_fit_whose_rollout_failed_has_no_evidence():
    measurements, (none, sink, _) = made({}, SETTINGS)
    failed = replace(sink, energy=np.inf)
    assert Evidences(measurements, SETTINGS).gain(failed, none) == -np.inf


@pytest.mark.parametrize("size", [0.25, 1.0, 4.0])
def test_the_determinant_is_that_of_the_whole_covariance(size):
    measurements, _ = made({"sink": {"amount": 0.6}}, SETTINGS)
    (noise,) = measurements.train.noises
    known, field = noise.known_columns().astype(float), noise.field_columns().astype(float)
    covariance = np.eye(len(known)) + known @ known.T + size**2 * field @ field.T
    part = Discrepancy(noise)
    assert part.log_sizes(np.array([size])) == pytest.approx([0.5 * np.linalg.slogdet(covariance)[1]], rel=1e-4)
