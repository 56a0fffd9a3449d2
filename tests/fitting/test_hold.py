"""How far a hand holds is a number of the model: every rollout of it obeys, the model's file keeps it, and other bonds stay."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.fitting.model import load_model, save_model
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.interactions.interaction import Trial
from physreal_core.simulation import Grip
from tests.fitting import scene

FRAMES = 5
REACH = 0.035  # the upper of two layers of held particles


@pytest.fixture(scope="module")
def problem():
    return scene.problem(scene.model(), frames=FRAMES, observed=FRAMES, with_masks=False)


@pytest.fixture(scope="module")
def nearer(problem):
    """The same with the bonds of the near particles alone."""
    grip = problem.grip
    kept = grip.rest_lengths <= REACH
    assert 0 < kept.sum() < len(kept)
    fewer = Grip(grip.particles[kept], grip.controllers[kept], grip.weights[kept], grip.rest_lengths[kept])
    return dataclasses.replace(problem, grip=fewer)


def test_a_particle_stays_held_by_all_its_bonds_if_the_nearest_is_within_reach():
    bonds = [3, 3, 5, 5], [0, 1, 0, 1], [0.5, 0.5, 0.4, 0.6], [0.01, 0.03, 0.02, 0.04]
    grip = Grip(*map(np.array, bonds), released=np.array([9, 8, 7, 6]))
    held = grip.within(0.015)
    assert held.particles.tolist() == [3, 3] and held.controllers.tolist() == [0, 1]
    assert held.weights.tolist() == [0.5, 0.5] and held.released.tolist() == [9, 8]
    assert len(grip.within(0.02).particles) == 4 and len(grip.within(0.005).particles) == 0
    told = dataclasses.replace(grip, reach=np.array([0.004, 0.004, -0.003, -0.003]))
    assert told.within(0.0).particles.tolist() == [5, 5]
    assert told.within(0.0).reach.tolist() == [-0.003, -0.003]


def test_rollouts_and_the_search_hold_what_the_model_says(problem, nearer):
    plain = scene.model()
    model = dataclasses.replace(plain, grip_reach=REACH)
    with torch.no_grad():
        found, expected, all_held = (
            rollouts.simulate(rollouts.inputs(plain.fields)).x
            for rollouts in (Rollouts(problem, model), Rollouts(nearer, plain), Rollouts(problem, plain))
        )
    assert torch.equal(found, expected) and not torch.allclose(found, all_held, atol=1e-4)
    experiment = Experiment(problem, model)
    assert experiment.setting.grip.particles.tolist() == nearer.grip.particles.tolist()
    seen = experiment.motion(Trial(plain.fields)).x
    assert np.array_equal(seen.numpy(), expected[:FRAMES].numpy())


def test_the_models_file_keeps_it(tmp_path):
    for reach in (None, REACH):
        save_model(tmp_path, dataclasses.replace(scene.model(), grip_reach=reach))
        assert load_model(tmp_path).grip_reach == reach
