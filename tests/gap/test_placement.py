"""An interaction in which the object lies elsewhere: effects of one place in the body mean the same place there."""

import dataclasses

import numpy as np
import pytest
import torch
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS
from physreal_core.effects.shape import PLACES, extent
from physreal_core.fitting.transfer import transfer_model
from physreal_core.gap import Experiment, GapSettings, Trial
from physreal_core.gap.fits.baseline import unknown_scalars
from physreal_core.gap.fits.plans import plans_along
from physreal_core.gap.interactions.starts import starts_of
from physreal_core.gap.search import candidates
from physreal_core.simulation import Body, Grip
from tests.fitting import scene

TURN = Rotation.from_euler("z", 90, degrees=True).as_matrix()
SHIFT = np.array([0.32, -0.12, 0.0])
"""A quarter turn and whole cells, so that the grid lies under the bar as it does here."""


def _moved(problem):
    """The same recording with scene and hand turned about the vertical and shifted."""
    R, t = torch.from_numpy(TURN), torch.from_numpy(SHIFT)
    body, grip, tracks = problem.body, problem.grip, problem.tracks
    return dataclasses.replace(
        problem,
        body=Body(body.x0 @ TURN.T + SHIFT, body.volume, body.density, body.spacing),
        grip=Grip(grip.particles, grip.controllers, grip.weights, grip.rest_lengths),
        controllers=problem.controllers @ R.T.to(problem.controllers) + t.to(problem.controllers),
        tracks=dataclasses.replace(
            tracks,
            points0=tracks.points0 @ R.T.to(tracks.points0) + t.to(tracks.points0),
            points3d=tracks.points3d @ R.T.to(tracks.points3d) + t.to(tracks.points3d),
        ),
        masks=None,
        camera=None,
    )


@pytest.fixture(scope="module")
def interactions():
    """The tiny scene, and the same elsewhere."""
    model = scene.model()
    here = dataclasses.replace(scene.problem(model, frames=8, observed=6, with_masks=False), camera=None)
    there = _moved(here)
    moved, _, _ = transfer_model(model, here.body.x0, there.body.x0, here.patch_neighbours.shape[1])
    return Experiment(here, model), Experiment(there, moved, placement=(TURN, SHIFT))


@pytest.mark.parametrize("name", ["soft_spot", "payload", "fibres", "density_gradient"])
def test_a_local_effect_does_the_same_to_the_object_elsewhere(interactions, name):
    here, effect = interactions[0], EFFECTS[name]
    start = effect.starts(here.setting)[-1]
    values = {
        c.name: start.get(c.name, c.dormant + (c.scale if c.kind == "amplitude" else 0.0)) for c in effect.coefficients
    }
    trial = Trial(here.model.fields, {name: values})
    ours, theirs = (experiment.predict([trial, Trial(here.model.fields)]) for experiment in interactions)
    changes = [(points[0] - points[1]) for points in (ours @ TURN.T + SHIFT, theirs)]
    size = np.abs(changes[0]).max()
    assert size > 1e-4, "no effect here, so nothing would be proved"
    assert np.abs(changes[0] - changes[1]).max() < 0.02 * size  # in float32, with contact


def test_starts_are_given_where_the_first_interaction_has_them(interactions):
    """Those of the other interaction are its own, carried back exactly, so that they lie in the first one's body."""
    effect, there, body = EFFECTS["soft_spot"], interactions[1].setting, interactions[0].setting.body
    ours, theirs = (starts_of(experiment, effect) for experiment in interactions)
    for carried, own in zip(theirs, effect.starts(there), strict=True):
        assert effect.carried(carried, TURN, SHIFT) == pytest.approx(own, abs=1e-9)
    distance, _ = cKDTree(body.x0).query([[start[axis] for axis in "xyz"] for start in theirs])
    assert len(ours) == len(theirs) and distance.max() < body.spacing


def test_places_in_the_body_are_tried_once_and_cover_it(interactions):
    plans = plans_along(
        EFFECTS["payload"],
        interactions,
        [experiment.motion(Trial(experiment.model.fields)) for experiment in interactions],
    )
    places = np.array([[plan.values[axis] for axis in "xyz"] for plan in plans])
    body = interactions[0].setting.body
    assert len(places) == PLACES
    assert cKDTree(places).query(body.x0)[0].max() < 0.4 * extent(body)


@pytest.mark.parametrize("fitted", [False, True])
def test_a_grip_that_was_fitted_is_an_unknown_and_no_effect(interactions, fitted):
    settings = GapSettings(grip_fitted=fitted)
    assert ("grip_stiffness" in unknown_scalars(interactions[0], settings)) == fitted
    assert ("grip_compliance" in candidates(interactions[0], settings)) != fitted
    assert {"grip_lag", "grip_slip"} <= {*candidates(interactions[0], settings)}
