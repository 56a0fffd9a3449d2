"""Reruns in other discretisations: their differences are numerical error, not another experiment."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.fitting import Problem, TrackObservations, uniform_model
from physreal_core.fitting.grip import reaching
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.interactions.discretisation import Discretisation
from physreal_core.gap.noise.reruns import GUESSES, RERUNS, nearest_moduli, rerun_differences
from physreal_core.geometry import patch_weights
from physreal_core.rendering import bind
from physreal_core.simulation import Body, Clamp
from tests.gap.test_predictions import experiment

SPACING, FRAMES, FPS = 0.0075, 8, 50.0


def _cantilever() -> Experiment:
    """A bar of 3 x 3 x 10 cm held at x < 0 and let go for 0.14 s."""
    along, across = SPACING * (np.arange(14) - 0.5), SPACING * (np.arange(4) + 0.5)
    x0 = np.stack(np.meshgrid(along, across, across, indexing="ij"), -1).reshape(-1, 3)
    body = Body(x0, np.full(len(x0), SPACING**3), np.full(len(x0), 1000.0), SPACING)
    patch = np.array([len(x0) // 2])
    neighbours, weights = (torch.from_numpy(array) for array in patch_weights(x0, patch))
    points = torch.from_numpy(x0[-4:]).float()
    shape = (FRAMES, len(points))
    seen = (points.expand(FRAMES, -1, -1), torch.ones(shape, dtype=torch.bool), torch.full(shape, 1e-3))
    problem = Problem(
        body=body,
        fps=FPS,
        controllers=torch.zeros(FRAMES, 0, 3),
        observed=FRAMES,
        patch_neighbours=neighbours,
        patch_weights=weights,
        clamps=(Clamp((-1.0, -1.0, -1.0), (0.0, 1.0, 1.0)),),
        tracks=TrackObservations(points, bind(points.double(), torch.from_numpy(x0), 8), *seen),
    )
    guess = {"youngs_modulus": 2e5, "poissons_ratio": 0.3, "friction_coefficient": 0.5}
    simulation = {"ground_height": None, "dtype": "float32"}
    return Experiment(
        problem, uniform_model(torch.from_numpy(x0[patch]), guess, elastic_law="hencky", simulation=simulation)
    )


def test_a_clamped_body_is_not_turned_out_of_its_clamps():
    experiment = _cantilever()
    trial = Trial(experiment.model.fields)
    (predicted,) = experiment.predict([trial])
    fall = np.linalg.norm(predicted - predicted[0], axis=-1).max()
    (differences,) = rerun_differences(experiment, [trial], [predicted], nearest_moduli(experiment, trial, predicted))
    # the law is its own
    left = [v for v in RERUNS if v.turn == 0.0 and v.elastic_law != "hencky"]
    assert len(differences) == len(left) == 3
    assert fall > 0.005 and np.linalg.norm(differences, axis=-1).max() < 0.3 * fall
    # whereas turned, it would leave them
    (turned,) = (v for v in RERUNS if v.turn != 0.0)
    assert np.abs(experiment.predict([trial], discretisation=turned)[0] - predicted).max() > 0.3 * fall


def test_what_a_modulus_takes_up_is_no_numerical_error():
    """A rerun that is stiffer by 3 % and moved besides leaves the move alone."""
    experiment = _cantilever()
    trial = Trial(experiment.model.fields)
    (predicted,) = experiment.predict([trial])
    moved = np.zeros_like(predicted)
    moved[..., 1] = 0.0002 * np.linspace(0.0, 1.0, FRAMES)[:, None]  # across the fall
    rerun = Discretisation("as before", error=3.0)
    predict = experiment.predict

    def in_another_grid(trials, frames=None, discretisation=None):
        if discretisation is not rerun:
            return predict(trials, frames)
        stiffer = [dataclasses.replace(one, fields=_times(one.fields, 1.03)) for one in trials]
        return predict(stiffer, frames) + moved

    experiment.predict = in_another_grid
    moduli = nearest_moduli(experiment, trial, predicted, (rerun,))
    ((found,),) = rerun_differences(experiment, [trial], [predicted], moduli, (rerun,))
    plain = in_another_grid([trial], discretisation=rerun)[0] - predicted
    assert np.abs(plain).max() > 0.0004
    np.testing.assert_allclose(found, 3.0 * moved, atol=2e-5)


def _times(fields: dict, factor: float) -> dict:
    return {**fields, "youngs_modulus": fields["youngs_modulus"] * factor}


@pytest.mark.parametrize("hand_seen", [False, True])
def test_another_hold_is_tried_of_a_hand_that_a_camera_has_seen(hand_seen):
    own = experiment(hand_seen=hand_seen)
    trial, holds = Trial(own.model.fields), [guess for guess in GUESSES if guess.hold != 1.0]
    (predicted,) = own.predict([trial])
    ((*found,),) = rerun_differences(own, [trial], [predicted], {}, holds)
    assert len(found) == 2 * hand_seen
    for difference, rerun in zip(found, holds, strict=hand_seen):
        held = reaching(
            own.problem.grip,
            own.problem.body.x0,
            own.problem.controllers[0].numpy(),
            rerun.hold,
            own.problem.body.spacing,
        )
        there = Experiment(dataclasses.replace(own.problem, grip=held), own.model).predict([trial])[0]
        np.testing.assert_allclose(difference, there - predicted, atol=1e-6)
        assert np.abs(difference).max() > 1e-4


def test_the_far_side_of_a_body_whose_shape_was_seen_may_have_more_or_less_matter():
    """As if every particle behind the seen side had so much more volume; of a given shape nothing is guessed."""
    own, matter = experiment(), [guess for guess in GUESSES if guess.matter != 1.0]
    trial = Trial(own.model.fields)
    (predicted,) = own.predict([trial])
    ((*given,),) = rerun_differences(own, [trial], [predicted], {}, matter)
    assert not given
    unseen = np.linspace(0.0, 1.0, len(own.problem.body.x0))
    seen = Experiment(dataclasses.replace(own.problem, unseen=unseen), own.model)
    np.testing.assert_array_equal(seen.predict([trial])[0], predicted)
    ((*found,),) = rerun_differences(seen, [trial], [predicted], {}, matter)
    for difference, rerun in zip(found, matter, strict=True):
        body = own.problem.body
        other = dataclasses.replace(body, volume=body.volume * (1.0 + (rerun.matter - 1.0) * unseen))
        there = Experiment(dataclasses.replace(own.problem, body=other), own.model).predict([trial])[0]
        np.testing.assert_allclose(difference, there - predicted, atol=1e-6)
        assert np.abs(difference).max() > 1e-4
