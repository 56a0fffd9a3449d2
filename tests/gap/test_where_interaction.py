"""Where on a fit's own problem: distances from what holds the body, and a softer simulation found at the far end."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.gap.interaction import held_distance, locate
from physreal_core.simulation import Clamp
from tests.fitting import scene


@pytest.fixture(scope="module")
def problem():
    return scene.problem(scene.model(), with_masks=False)


def carried(problem):
    """The tracks moving rigidly with the hand [m]."""
    hand = problem.controllers.double().mean(1, keepdim=True)
    return problem.tracks.points0.double() + hand - hand[0]


def measured_as(problem, points, sigma=1e-4):
    """The problem with these positions [m] measured, plus their noise."""
    noise = sigma * torch.randn(points.shape, dtype=points.dtype, generator=torch.Generator().manual_seed(0))
    tracks = dataclasses.replace(
        problem.tracks,
        points3d=points + noise,
        valid3d=torch.ones(points.shape[:2], dtype=torch.bool),
        sigma3d=torch.full(points.shape[:2], sigma, dtype=points.dtype),
    )
    return dataclasses.replace(problem, tracks=tracks)


def test_distances_from_grip_and_clamp(problem):
    points = problem.tracks.points0.numpy()
    gripped = problem.body.x0[problem.grip.particles]
    np.testing.assert_allclose(
        held_distance(problem)[points[:, 0] > 0.1].min(), 0.1 + 0.01 - gripped[:, 0].max(), atol=0.011
    )
    clamped = dataclasses.replace(problem, grip=None, clamps=(Clamp((-1.0, -1.0, -1.0), (0.03, 1.0, 1.0)),))
    np.testing.assert_allclose(held_distance(clamped), np.maximum(0.0, points[:, 0] - 0.03))
    assert held_distance(dataclasses.replace(problem, grip=None)) is None


def test_the_same_tracks_agree_and_a_displaced_far_end_does_not(problem):
    simulated = carried(problem)
    assert not locate(measured_as(problem, simulated), simulated).significant
    shift = torch.zeros_like(simulated)
    shift[6:, problem.tracks.points0[:, 0] > 0.1, 2] = 0.004
    where = locate(measured_as(problem, simulated + shift), simulated)
    assert where.onset.frame == 6 and where.place.part == "far end"
    assert where.place.signatures[0].value == pytest.approx(0.004, rel=0.05)
    assert "higher" in where.sentence


def test_a_problem_without_tracks_is_refused(problem):
    without = dataclasses.replace(scene.problem(scene.model()), tracks=None)
    with pytest.raises(InputError, match="no tracks"):
        locate(without, carried(problem))
