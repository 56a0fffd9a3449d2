"""Quick rollouts: a coarse body has the mass and material of the full one, and moves as it does near the anchor."""

import dataclasses

import numpy as np
import pytest
import torch

from physreal_core.fitting import Problem, TrackObservations, uniform_model
from physreal_core.fitting.coarsening import coarsened, held_share
from physreal_core.fitting.grip import bind_within, reaching
from physreal_core.gap import Experiment, Trial
from physreal_core.gap.interactions.quick import quick_around, quick_interactions
from physreal_core.gap.noise.given import changed_by_records
from physreal_core.geometry import farthest_points, patch_weights
from physreal_core.rendering import bind
from physreal_core.simulation import Body, Clamp, Grip

SPACING, FRAMES, FPS, FACTOR = 0.008, 12, 50.0, 1.5


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    """A bar of 4 x 4 x 19 cm of two densities, held at one end by eight points that rise and stop."""
    along, across = SPACING * (np.arange(24) + 0.5), SPACING * (np.arange(5) + 0.5)
    x0 = np.stack(np.meshgrid(along, across, across, indexing="ij"), -1).reshape(-1, 3)
    density = np.where(x0[:, 0] < 0.1, 400.0, 700.0)
    body = Body(x0, np.full(len(x0), SPACING**3), density, SPACING)
    patches = farthest_points(x0, 3)
    neighbours, weights = (torch.from_numpy(array) for array in patch_weights(x0, patches))
    corners = np.stack(np.meshgrid([0.0, 0.05], [0.0, 0.04], [0.0, 0.04], indexing="ij"), -1).reshape(-1, 3)
    rise = 0.05 * np.clip(np.arange(FRAMES) / 5.0, 0.0, 1.0)[:, None, None] * [0.0, 0.0, 1.0]
    grip = bind_within(x0, corners, spacing=SPACING)
    points = torch.from_numpy(x0[::7]).float()
    shape = (FRAMES, len(points))
    seen = (points.expand(FRAMES, -1, -1), torch.ones(shape, dtype=torch.bool), torch.full(shape, 1e-3))
    problem = Problem(
        body=body,
        fps=FPS,
        controllers=torch.from_numpy(corners + rise).float(),
        observed=FRAMES,
        patch_neighbours=neighbours,
        patch_weights=weights,
        grip=grip,
        tracks=TrackObservations(points, bind(points.double(), torch.from_numpy(x0), 8), *seen),
    )
    guess = {"youngs_modulus": 1.5e5, "poissons_ratio": 0.3, "friction_coefficient": 0.5, "grip_stiffness": 100.0}
    simulation = {"ground_height": 0.0, "dtype": "float32"}
    return Experiment(
        problem, uniform_model(torch.from_numpy(x0[patches]), guess, elastic_law="hencky", simulation=simulation)
    )


@pytest.fixture(scope="module")
def anchor(experiment) -> tuple[Trial, np.ndarray]:
    trial = Trial(experiment.model.fields)
    return trial, experiment.predict([trial])[0]


def test_a_coarse_body_has_the_mass_and_the_places_of_the_full_one(experiment):
    problem = experiment.problem
    coarse = coarsened(problem, FACTOR)
    full, body = problem.body, coarse.body
    assert len(body.x0) == pytest.approx(len(full.x0) / FACTOR**3, rel=0.25), "five layers become three"
    assert body.spacing == pytest.approx(FACTOR * SPACING)
    for own, other in ((body.volume, full.volume), (body.volume * body.density, full.volume * full.density)):
        assert own.sum() == pytest.approx(other.sum())
        np.testing.assert_allclose(own @ body.x0, other @ full.x0, rtol=0.01)
    assert body.volume.std() < 0.2 * body.volume.mean(), "no slivers"
    np.testing.assert_allclose(coarse.patch_weights.sum(1), 1.0, rtol=1e-6)
    before = full.volume @ (problem.patch_weights[:, :, None] * torch.eye(3)[problem.patch_neighbours]).sum(1).numpy()
    after = body.volume @ coarse.patch_weights.numpy()
    np.testing.assert_allclose(after, before, rtol=1e-6, err_msg="what each patch rules over")
    held = np.unique(coarse.grip.particles)
    assert body.x0[held, 0].max() < 0.055 < np.delete(body.x0[:, 0], held).min() + FACTOR * SPACING
    assert held_share(problem, coarse) == pytest.approx(FACTOR**3, rel=0.4)


def test_a_hand_that_holds_less_than_half_of_any_cell_still_holds(experiment):
    """As where the part of the object in the hand was not seen: few particles lie near the hand's points."""
    problem = experiment.problem
    whole = problem.grip
    few = np.isin(whole.particles, np.unique(whole.particles)[:2])
    grip = Grip(whole.particles[few], whole.controllers[few], whole.weights[few], whole.rest_lengths[few])
    little = dataclasses.replace(problem, grip=grip)
    coarse = coarsened(little, FACTOR)
    assert len(np.unique(coarse.grip.particles)) == 1
    assert held_share(little, coarse) == 2.0


def test_a_hand_that_reaches_farther_holds_particles_of_the_coarse_body_itself(experiment):
    """What is beyond the full body's grip names particles that the coarse one does not have."""
    problem = experiment.problem.held_within(0.02)
    assert problem.grip.beyond is not None
    coarse = coarsened(problem, FACTOR)
    hand = coarse.controllers[0].numpy().astype(float)
    farther = reaching(coarse.grip, coarse.body.x0, hand, 1.25, coarse.body.spacing)
    farther.check(coarse.body)
    assert set(farther.particles) > set(coarse.grip.particles)


def test_a_coarse_body_has_seen_and_guessed_matter_where_the_full_one_has(experiment):
    full = experiment.problem.body
    unseen = (full.x0[:, 2] - full.x0[:, 2].min()) / np.ptp(full.x0[:, 2])
    coarse = coarsened(dataclasses.replace(experiment.problem, unseen=unseen), FACTOR)
    assert coarse.body.volume @ coarse.unseen == pytest.approx(full.volume @ unseen)
    assert np.corrcoef(coarse.unseen, coarse.body.x0[:, 2])[0, 1] > 0.99


def test_quick_predictions_are_the_full_ones_at_the_anchor(experiment, anchor):
    trial, predicted = anchor
    (quick,) = quick_interactions([experiment], trial, [predicted], FACTOR)
    np.testing.assert_allclose(quick.predict([trial])[0], predicted, atol=1e-6)


def test_quick_differences_are_near_the_full_ones(experiment, anchor):
    trial, predicted = anchor
    (quick,) = quick_interactions([experiment], trial, [predicted], FACTOR)
    softer = {**trial.fields, "youngs_modulus": 0.9 * trial.fields["youngs_modulus"]}
    trials = [
        Trial(softer),
        Trial(trial.fields, {"gravity": {"tilt_x": 0.0, "tilt_y": 0.0, "excess": 0.2}}),
        Trial(trial.fields, {"linear_drag": {"rate": 2.0}}),
    ]
    # a body three coarse particles thick bends within a fifth as a full one does; what its modulus changes of a swing is told worse
    near = (0.6, 0.25, 0.25)
    for own, other, most in zip(quick.predict(trials), experiment.predict(trials), near, strict=True):
        apart, change = own - other, other - predicted
        assert np.linalg.norm(apart) < most * np.linalg.norm(change)


def test_what_a_displaced_hand_does_is_told_by_quick_rollouts_and_the_rest_by_full_ones(experiment, anchor):
    trial, predicted = anchor
    quick = quick_interactions([experiment], trial, [predicted], FACTOR)[0]
    (full,) = changed_by_records(experiment, [trial], [predicted])
    (found,) = changed_by_records(experiment, [trial], [predicted], quick)
    records = len(full) - 3 * len(experiment.hand_modes)
    assert records > 0
    np.testing.assert_allclose(found[:records], full[:records], atol=1e-6)
    displaced = full[records:]
    # the coarse bar is three particles thick
    assert 0.0 < np.linalg.norm(found[records:] - displaced) < 0.35 * np.linalg.norm(displaced)


def test_a_quick_form_goes_to_the_end_though_it_is_tuned_to_the_training_frames(experiment, anchor):
    trial, predicted = anchor
    part = Experiment(dataclasses.replace(experiment.problem, observed=FRAMES // 2), experiment.model)
    (quick,) = quick_around([part], trial, FACTOR)
    np.testing.assert_allclose(quick.predict([trial])[0], predicted, atol=1e-6)
    assert quick_around([part], trial, 1.0) is None


def test_what_cannot_be_coarser_has_no_quick_form(experiment, anchor):
    trial, predicted = anchor
    assert quick_interactions([experiment], trial, [predicted], 2.5) is None, "too few particles would be left"
    clamps = (Clamp((-1.0, -1.0, -1.0), (0.01, 1.0, 1.0)),)
    assert (
        Experiment(dataclasses.replace(experiment.problem, clamps=clamps), experiment.model).coarsened(FACTOR) is None
    )
