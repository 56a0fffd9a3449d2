"""Step responses of the simulator: what they predict of a weak force is what another rollout with that force does."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Trial
from physreal_core.gap.lead.lead import find_lead
from physreal_core.gap.lead.preparation import departure_of, lead_on
from physreal_core.gap.noise.measurements import Measurements
from physreal_core.gap.noise.model import ModelError, Noise
from physreal_core.gap.noise.neighbours import SeenNoise
from physreal_core.gap.settings import GapSettings
from physreal_core.simulation import Clamp
from tests.fitting import scene
from tests.gap.linear import ANSWERS, LinearExperiment

FRAMES, TRAIN, DRAG, SIGMA = 30, 24, 1.0, 1e-5


@pytest.fixture(scope="module")
def model():
    """A soft bar in the air, in a twenty-fifth of gravity, so that it bends by a quarter of its length."""
    soft = scene.model(youngs_modulus=1e3)
    return dataclasses.replace(soft, simulation=soft.simulation | {"ground_height": None, "gravity": (0.0, 0.1, -0.4)})


@pytest.fixture(scope="module")
def experiment(model):
    """The bar of the fits, clamped at one end and let go; its tracks as they are with linear drag."""
    problem = scene.problem(scene.model(), frames=FRAMES, observed=TRAIN, with_masks=False)
    clamp = Clamp((-1.0, -1.0, -1.0), (0.03, 1.0, 1.0))
    problem = dataclasses.replace(problem, grip=None, controllers=torch.zeros(FRAMES, 0, 3), clamps=(clamp,))
    record = {"name": "linear_drag", "values": {"rate": DRAG}, "intervals": {}, "units": {}, "probability": 1.0}
    truth = Experiment(problem, dataclasses.replace(model, effects=[record])).predict([Trial(model.fields)])[0]
    return Experiment(measured_as(problem, truth), model, noise=SeenNoise.known(np.full(truth.shape[:2], SIGMA)))


def measured_as(problem, points):
    known = torch.ones(points.shape[:2], dtype=torch.bool)
    sigma = torch.full(points.shape[:2], SIGMA)
    tracks = dataclasses.replace(problem.tracks, points3d=torch.from_numpy(points), valid3d=known, sigma3d=sigma)
    return dataclasses.replace(problem, tracks=tracks)


def noise_of(experiment, predicted, frames):
    valid = experiment.valid & np.isin(np.arange(FRAMES), frames)[:, None]
    starts = np.broadcast_to(np.eye(3)[:, None, None], (3, *predicted.shape))
    reruns, fps = np.zeros((0, *predicted.shape)), experiment.setting.fps
    return Noise(experiment.sigma, valid, experiment.points0, predicted, reruns, starts, fps, ModelError(rms=1e-6))


@pytest.fixture(scope="module")
def seen(experiment, model):
    predicted = experiment.predict([Trial(model.fields)])[0]
    train, held_out = (noise_of(experiment, predicted, part) for part in (range(TRAIN), range(TRAIN, FRAMES)))
    return departure_of(experiment, Trial(model.fields), predicted, train, held_out, regions=6)


def test_the_regions_share_every_track(seen):
    np.testing.assert_allclose(seen.weights.sum(1), 1.0, rtol=1e-6)


def test_convolution_with_the_responses_is_the_rollout_with_the_force(seen):
    predicted = seen.responses.displacement(-DRAG * seen.motion().velocity[None])[0]
    departure = seen.displacement[0]
    size = np.sqrt((departure**2).mean())
    assert size > 1e-4
    # the bar bends while its responses are those of the first frames; its swing has nine frames
    assert np.sqrt(((predicted - departure)[1:] ** 2).mean()) < 0.3 * size


def test_drag_in_the_simulator_is_read_off_as_drag(seen):
    lead = find_lead([seen])
    assert lead.terms[0].term.formula == "-v"
    assert lead.terms[0].coefficient == pytest.approx(DRAG, rel=0.2)


def test_responses_start_at_rest(seen):
    assert np.abs(seen.responses.step[:, :, 0]).max() == 0.0


def test_the_searchs_evidence_leads_to_the_same_formula(experiment, model):
    trial = Trial(model.fields)
    measurements = Measurements.around(
        [experiment], [trial], GapSettings(model_error=ModelError(rms=1e-6)), reruns=False
    )
    lead = lead_on(measurements, trial, list(experiment.predict([trial])))
    assert lead.terms[0].term.formula == "-v" and lead.terms[0].explained > 0.9
    assert lead.explained_held_out > 0.8 and "in proportion to speed" in lead.sentence


def test_a_search_without_our_simulator_has_no_lead(experiment, model):
    trial = Trial(model.fields)
    measurements = Measurements.around([experiment], [trial], GapSettings(), reruns=False)
    measurements = dataclasses.replace(measurements, experiments=[LinearExperiment(ANSWERS, {})])
    with pytest.raises(InputError, match="no interaction"):
        lead_on(measurements, trial, list(experiment.predict([trial])))
