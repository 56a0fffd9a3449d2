"""What confirms a change of a model: frames that its fit did not see, and nothing else."""

import dataclasses

import pytest
import torch

from physreal_core.fitting.confirmation import Confirmation, confirmation, measured_from, observed_until
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from tests.fitting import scene

FRAMES, OBSERVED, FITTED = 10, 8, 6
LOSSES = LossConfig(mask=0.0)


@pytest.fixture(scope="module")
def given():
    return scene.problem(scene.model(), frames=FRAMES, observed=OBSERVED)


def test_a_fit_that_sees_less_compares_the_first_frames_alone(given):
    stiff = scene.model(youngs_modulus=6e4)
    less = Objective(observed_until(given, FITTED), stiff, LOSSES)
    assert less.full_horizon == FITTED
    whole = Objective(given, stiff, LOSSES)
    assert float(less(stiff.fields, FITTED)[0]) == float(whole(stiff.fields, FITTED)[0])
    assert observed_until(given, 0).observed == 2 and observed_until(given, 99).observed == OBSERVED


def test_what_lies_before_the_frames_that_were_kept_back_changes_nothing(given):
    """Tracks and silhouettes of the fitted frames are spoilt; the objective of the late ones stays."""
    tracks, masks = given.tracks, given.masks
    early = torch.arange(FRAMES) < FITTED
    spoilt = dataclasses.replace(
        given,
        tracks=dataclasses.replace(
            tracks,
            points3d=torch.where(early[:, None, None], tracks.points3d + 1.0, tracks.points3d),
            points2d=torch.where(early[:, None, None], tracks.points2d + 50.0, tracks.points2d),
        ),
        masks=dataclasses.replace(
            masks, coverage=torch.where((masks.frames < FITTED)[:, None, None], 1.0 - masks.coverage, masks.coverage)
        ),
    )
    stiff = scene.model(youngs_modulus=6e4)
    one, other = (Objective(measured_from(p, FITTED), stiff, LossConfig()) for p in (given, spoilt))
    totals = [float(objective(stiff.fields, OBSERVED)[0]) for objective in (one, other)]
    assert totals[0] == totals[1] > 0.0
    assert float(Objective(spoilt, stiff, LossConfig())(stiff.fields, OBSERVED)[0]) > 2 * totals[0]


def test_nothing_measured_late_is_said(given):
    tracks = given.tracks
    early = (torch.arange(FRAMES) < FITTED)[:, None]
    blind = dataclasses.replace(
        given,
        masks=None,
        tracks=dataclasses.replace(tracks, valid3d=tracks.valid3d & early, visible=tracks.visible & early),
    )
    assert measured_from(blind, FITTED) is None
    only_future = dataclasses.replace(given, masks=None)
    assert measured_from(only_future, OBSERVED) is None, (
        "frames after the observed ones serve for nothing but the score"
    )


def test_a_better_modulus_is_confirmed_and_a_worse_one_is_not(given):
    true, stiff = scene.model(), scene.model(youngs_modulus=6e4)
    late = measured_from(given, FITTED)
    assert confirmation([(late, stiff, true)], LOSSES).confirmed
    assert not confirmation([(late, true, stiff)], LOSSES).confirmed
    assert not confirmation([(late, stiff, true), (late, true, stiff)], LOSSES).confirmed, "in every recording"
    assert not confirmation([(late, true, true)], LOSSES).confirmed, "what changes nothing is not needed"


def test_without_frames_nothing_is_confirmed_and_a_failure_counts_as_infinite():
    assert not confirmation([], LOSSES).confirmed
    assert not Confirmation((1.0,), (float("inf"),)).confirmed
    assert Confirmation((float("inf"),), (1.0,)).confirmed
