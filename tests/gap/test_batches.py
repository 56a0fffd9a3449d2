"""Trials that run together: on a GPU a batch takes the substeps of its stiffest, so that its members must be alike."""

import dataclasses

import pytest

from physreal_core.effects import EFFECTS, lacking
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.interactions.experiment import LIKE_SUBSTEPS, of_like_counts
from physreal_core.simulation import Simulator
from tests.fitting import scene
from tests.gap.trials import plain_values


@pytest.fixture(scope="module")
def experiment():
    model = scene.model()
    return Experiment(dataclasses.replace(scene.problem(model, frames=8, observed=6), camera=None), model)


def _one_of_each(experiment) -> list[Trial]:
    """Every effect at plain size from its first start, so that all terms are in use."""
    fields, setting = experiment.model.fields, experiment.setting
    acting = [effect for effect in EFFECTS.values() if not lacking(effect, setting.body)]
    return [Trial(fields, {effect.name: plain_values(effect, setting)}) for effect in acting]


def test_substeps_of_a_trial_are_those_that_its_rollout_takes(experiment):
    problem = experiment.problem
    for rollout in experiment._made(_one_of_each(experiment), 1):
        simulator = Simulator(problem.body, rollout.config, problem.grip, problem.clamps, problem.loads)
        assert experiment._substeps(rollout) == simulator.substeps(rollout.inputs.parameters), rollout.effects


def test_batches_of_a_gpu_hold_every_trial_once_and_like_substeps(experiment, monkeypatch):
    trials = experiment._made(_one_of_each(experiment), experiment.frames)
    counts = [experiment._substeps(trial) for trial in trials]
    assert max(counts) > LIKE_SUBSTEPS * min(counts), "all are alike, so nothing would be proved"
    monkeypatch.setattr(experiment, "device", "cuda:0")
    batches = experiment._batches(trials)
    assert sorted(row for rows in batches for row in rows) == list(range(len(trials)))
    for rows in batches:
        own = [counts[row] for row in rows]
        assert max(own) <= LIKE_SUBSTEPS * min(own)
    assert len(batches) < len(set(counts)), "those that are alike run together"


def test_partsof_like_counts_begin_at_the_largest_and_keep_the_order():
    assert of_like_counts([0, 1, 2, 3, 4], [50, 100, 75, 84, 83]) == [[1, 3], [2, 4], [0]]
    assert of_like_counts([0, 2], [50, 0, 60]) == [[0, 2]]
    assert of_like_counts([], []) == []
