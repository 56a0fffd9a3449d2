"""Where on an experiment: distances from what holds the body, a displaced far end found, the search's noise model believed."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.noise.model import ModelError, Noise
from physreal_core.gap.where.locate import held_distance, locate
from physreal_core.simulation import Clamp
from tests.fitting import scene

SIGMA = 1e-4
ERROR = ModelError(rms=2e-4)


@pytest.fixture(scope="module")
def problem():
    return scene.problem(scene.model(), with_masks=False)


def carried(problem):
    """The tracks moving rigidly with the hand [m], shape [T, J, 3]."""
    hand = problem.controllers.double().mean(1, keepdim=True)
    return problem.tracks.points0.double() + hand - hand[0]


def measured_as(problem, points, seed=0):
    """The experiment with these positions [m] measured, plus their noise."""
    noise = SIGMA * torch.randn(points.shape, dtype=points.dtype, generator=torch.Generator().manual_seed(seed))
    tracks = dataclasses.replace(
        problem.tracks,
        points3d=points + noise,
        valid3d=torch.ones(points.shape[:2], dtype=torch.bool),
        sigma3d=torch.full(points.shape[:2], SIGMA, dtype=points.dtype),
    )
    return Experiment(dataclasses.replace(problem, tracks=tracks), scene.model())


def noise_of(experiment, predicted):
    starts = np.broadcast_to(np.eye(3)[:, None, None], (3, *predicted.shape))
    no_reruns = np.zeros((0, *predicted.shape))
    return Noise(
        experiment.sigma,
        experiment.valid,
        experiment.points0,
        predicted,
        no_reruns,
        starts,
        experiment.setting.fps,
        ERROR,
    )


def find(problem, truth, simulated, seed=0):
    experiment = measured_as(problem, truth, seed)
    return locate(experiment, simulated.numpy(), noise_of(experiment, simulated.numpy()))


def test_distances_from_grip_and_clamp(problem):
    setting = Experiment(problem, scene.model()).setting
    points = problem.tracks.points0.double().numpy()
    far = points[:, 0].argmax()
    held = problem.body.x0[problem.grip.particles]
    expected = np.linalg.norm(points[far] - held, axis=1).min()
    assert held_distance(points, setting)[far] == pytest.approx(expected)
    clamped = dataclasses.replace(setting, grip=None, clamps=(Clamp((-1.0, -1.0, -1.0), (0.03, 1.0, 1.0)),))
    np.testing.assert_allclose(held_distance(points, clamped), np.maximum(0.0, points[:, 0] - 0.03))
    assert held_distance(points, dataclasses.replace(setting, grip=None)) is None


def test_a_displaced_far_end_is_found(problem):
    simulated = carried(problem)
    shift = torch.zeros_like(simulated)
    shift[6:, problem.tracks.points0[:, 0] > 0.1, 2] = 0.004
    where = find(problem, simulated + shift, simulated)
    first = where.place.signatures[0]
    assert where.onset.frame == 6 and where.place.part == "far end" and "higher" in where.sentence
    assert first.kind == "offset" and first.value == pytest.approx(0.004, abs=3 * first.deviation)


def test_wrong_starting_points_are_no_disagreement(problem):
    """Tracks bound a noisy reading away from their material point stay off for good; twenty captures, one false alarm allowed."""
    simulated = carried(problem)
    alarms = 0
    for seed in range(20):
        offset = SIGMA * torch.randn(
            simulated.shape[1:], dtype=simulated.dtype, generator=torch.Generator().manual_seed(99 + seed)
        )
        alarms += find(problem, simulated + offset, simulated, seed).significant
    assert alarms <= 1


def test_two_tracks_are_too_few():
    problem = scene.problem(scene.model(), frames=4, observed=3, with_masks=False)
    seen = torch.zeros_like(problem.tracks.valid3d)
    seen[:, :2] = True
    with pytest.raises(InputError, match="2 3D tracks"):
        Experiment(
            dataclasses.replace(problem, tracks=dataclasses.replace(problem.tracks, valid3d=seen)), scene.model()
        )


def test_a_model_that_breaks_off_is_compared_until_there(problem):
    simulated = carried(problem)
    experiment = measured_as(problem, simulated)
    noise = noise_of(experiment, simulated.numpy())
    broken = simulated.numpy().copy()
    broken[-2:] = np.nan
    where = locate(experiment, broken, noise)
    assert len(where.as_record()["frames"]["gap"]) == len(broken) - 2
