"""Fits and scores with too little evidence end in one sentence before any work is done; with just enough they go on."""

import dataclasses
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.evidence import LEAST_FRAMES, LEAST_PIXELS, LEAST_TRACKS, require_pixels, require_tracks
from physreal_core.fitting.curriculum import ScanConfig, fit_material, start_from_scan, uniform_start
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.variables import TRANSFORMS, Variable
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.geometry import Observation
from physreal_core.rendering import Camera
from stages._evaluation import Sequence
from tests.fitting import scene

MODULUS = Variable("youngs_modulus", TRANSFORMS["youngs_modulus"], rate=0.1, lower=1e3, upper=1e6)


@pytest.fixture(scope="session")
def given() -> Problem:
    return scene.problem(scene.model(), frames=8, observed=6)


def tracks(given: Problem, change) -> Problem:
    """The problem with other valid entries; the pixels are seen where the points are valid."""
    valid = change(given.tracks.valid3d.clone())
    return dataclasses.replace(given, tracks=dataclasses.replace(given.tracks, valid3d=valid, visible=valid))


def masks(given: Problem, **changes) -> Problem:
    return dataclasses.replace(given, masks=dataclasses.replace(given.masks, **changes))


def none(valid: torch.Tensor) -> torch.Tensor:
    return torch.zeros_like(valid)


def of_frames(*frames: int):
    def change(valid: torch.Tensor) -> torch.Tensor:
        kept = torch.zeros_like(valid)
        kept[list(frames)] = valid[list(frames)]
        return kept

    return change


def of_tracks(count: int):
    def change(valid: torch.Tensor) -> torch.Tensor:
        valid[:, count:] = False
        return valid

    return change


TRACKS = {
    "none valid": (none, "0 3D tracks on the object", f"{LEAST_TRACKS} or more"),
    "one": (of_tracks(1), "1 3D tracks on the object", f"{LEAST_TRACKS} or more"),
    "two": (of_tracks(2), "2 3D tracks on the object", f"{LEAST_TRACKS} or more"),
    "frame 0 alone": (of_frames(0), "known in 0 of the 5 observed frames", f"in {LEAST_FRAMES} frames"),
    "one frame after it": (of_frames(0, 2), "known in 1 of the 5 observed frames", f"in {LEAST_FRAMES} frames"),
    "the future alone": (of_frames(6, 7), "0 3D tracks on the object", f"{LEAST_TRACKS} or more"),
    "the future but for frame 0": (of_frames(0, 6, 7), "known in 0 of the 5", f"in {LEAST_FRAMES} frames"),
}


def objective_of(problem: Problem, **losses: float) -> Objective:
    return Objective(problem, scene.model(), LossConfig(**losses))


def refused(problem: Problem, what: str, expected: str, **losses: float) -> None:
    """By both entries of a fit, with nothing rolled out."""
    objective, model = objective_of(problem, **losses), scene.model()
    objective.rollout = None
    objective.rollouts.simulate_batch = None
    for work in (
        lambda: fit_material(objective, model, [MODULUS], uniform_start(model, [MODULUS]), DescentConfig(iterations=1)),
        lambda: start_from_scan(objective, model, [MODULUS], ScanConfig()),
    ):
        with pytest.raises(InputError) as raised:
            work()
        error = raised.value
        assert what in error.what and expected in error.expected and error.where and error.remedy, str(error)


@pytest.mark.parametrize("name", TRACKS)
@pytest.mark.parametrize("losses", [{}, {"mask": 0.0}, {"motion_2d": 0.0}], ids=["all", "tracks alone", "3D alone"])
def test_a_fit_with_too_few_tracks_is_refused(given, name, losses):
    change, what, expected = TRACKS[name]
    refused(tracks(given, change), what, expected, **losses)


@pytest.mark.parametrize("name", TRACKS)
def test_a_fit_to_pixels_with_too_few_of_them_is_refused(given, name):
    change, what, expected = TRACKS[name]
    refused(tracks(given, change), what, expected, motion_3d=0.0)


@pytest.mark.parametrize("name", ["none valid", "two", "the future alone"])
def test_a_fit_to_the_state_at_rest_with_too_few_tracks_is_refused(given, name):
    change, what, expected = TRACKS[name]
    refused(tracks(given, change), what, expected, settled=1.0, settled_measured=4)


def test_tracks_known_before_the_object_rests_are_no_evidence_of_its_rest(given):
    refused(tracks(given, of_frames(0, 1, 2)), "0 3D tracks", "3 or more", settled=1.0, settled_measured=2)


def test_no_tracks_at_all(given):
    refused(dataclasses.replace(given, tracks=None), "0 3D tracks on the object", "3 or more")


@pytest.mark.parametrize("losses", [{}, {"motion": 0.0}], ids=["beside tracks", "alone"])
@pytest.mark.parametrize("hidden", [False, True], ids=["empty", "hidden"])
def test_silhouettes_without_a_pixel_are_refused(given, losses, hidden):
    change = {"known": torch.zeros_like(given.masks.known)} if hidden else {"coverage": 0 * given.masks.coverage}
    refused(masks(given, **change), "the largest silhouette has 0 pixels", f"at least {LEAST_PIXELS}", **losses)


def test_an_objective_without_a_weight_is_refused(given):
    refused(given, "no term of the objective has a weight", "motion with tracks", motion=0.0, mask=0.0)


def test_weights_for_masks_that_are_not_there_are_refused(given):
    refused(dataclasses.replace(given, masks=None), "no term of the objective", "mask with silhouettes", motion=0.0)


def test_a_hand_that_holds_nothing_is_refused(given):
    refused(
        dataclasses.replace(given, grip=None), "none of 1 controller points holds a particle", "a hand that touches"
    )


ENOUGH = {
    "three tracks": lambda given: tracks(given, of_tracks(3)),
    "two frames after the first": lambda given: tracks(given, of_frames(0, 2, 4)),
    "one silhouette of two": lambda given: masks(given, coverage=given.masks.coverage * torch.tensor([0.0, 1.0])[:, None, None]),
    "no masks": lambda given: dataclasses.replace(given, masks=None),
    "no hand": lambda given: dataclasses.replace(given, grip=None, controllers=given.controllers[:, :0]),
}  # fmt: skip


@pytest.mark.parametrize("name", ENOUGH)
def test_just_enough_passes(given, name):
    objective_of(ENOUGH[name](given)).require_evidence()


def test_masks_alone_pass_where_tracks_have_no_weight(given):
    objective_of(dataclasses.replace(given, tracks=None), motion=0.0).require_evidence()


@pytest.mark.parametrize("name", TRACKS)
def test_a_search_with_too_few_tracks_is_refused(given, name):
    change, what, expected = TRACKS[name]
    with pytest.raises(InputError) as raised:
        Experiment(tracks(given, change), scene.model())
    assert what in raised.value.what and expected in raised.value.expected and raised.value.remedy


@pytest.mark.parametrize(("frames", "told"), [((0,), False), ((0, 4, 5), False), ((0, 2, 4), True)])
def test_no_error_of_tracks_is_told_where_none_is_known(given, frames, told):
    """`tracks 0.00 mm` would be said of it."""
    objective = objective_of(tracks(given, of_frames(*frames)), motion=0.0, mask=1.0)
    with torch.no_grad():
        _, terms = objective(scene.model().fields, 3)
    assert ("track_error" in terms) == told


def test_a_search_without_tracks_is_refused(given):
    with pytest.raises(InputError, match="0 3D tracks on the object"):
        Experiment(dataclasses.replace(given, tracks=None), scene.model())


# --- the pose ---------------------------------------------------------------------------------------------------------

SIZE = (40, 30)


def observation(pixels: int, *, depth: int | None = None, up: bool = False) -> Observation:
    """Frame 0 from 0.5 m above the table with so many pixels of the object, `depth` of them measured."""
    T = np.diag([1.0, -1.0, -1.0, 1.0]) if not up else np.diag([1.0, 1.0, 1.0, 1.0])
    T[2, 3] = 0.5
    mask, reading = np.zeros(SIZE[::-1], bool), np.zeros(SIZE[::-1])
    mask.flat[:pixels] = True
    if depth is not None:
        reading.flat[:depth] = 0.4
        reading.flat[-1] = 0.5
    camera = Camera(np.array([[40.0, 0, 19.5], [0, 40.0, 14.5], [0, 0, 1]]), T, *SIZE)
    return Observation(np.zeros((*SIZE[::-1], 3)), reading, mask, np.zeros_like(mask), camera)


@pytest.mark.parametrize("pixels", [0, 1, LEAST_PIXELS - 1])
def test_a_pose_from_too_few_pixels_is_refused(pixels):
    with pytest.raises(InputError) as raised:
        observation(pixels)
    assert f"the object's mask has {pixels} pixels" in raised.value.what and "frame 0" in raised.value.where
    assert raised.value.expected == f"at least {LEAST_PIXELS}" and "hint" in raised.value.remedy


@pytest.mark.parametrize("readings", [0, LEAST_PIXELS - 1])
def test_a_pose_from_too_little_depth_is_refused(readings):
    with pytest.raises(InputError) as raised:
        observation(100, depth=readings).points()
    assert f"the depth on the object has {readings} pixels" in raised.value.what
    assert "depth/000000.png" in raised.value.where and "T_world_object" in raised.value.remedy


def test_a_mask_above_the_horizon_is_refused():
    with pytest.raises(InputError) as raised:
        observation(100, up=True).points()
    assert "below the horizon has 0 pixels" in raised.value.what and "T_world_camera" in raised.value.remedy


def test_a_pose_from_just_enough_passes():
    assert len(observation(LEAST_PIXELS, depth=LEAST_PIXELS).points()) == LEAST_PIXELS
    assert len(observation(LEAST_PIXELS).points()) == LEAST_PIXELS


# --- scores -----------------------------------------------------------------------------------------------------------


def sequence(valid: np.ndarray, pixels: int | None, root: Path) -> Sequence:
    """What `require_measurement` looks at: valid tracks, and masks of so many pixels where there is a camera."""
    frames = len(valid)
    if pixels is not None:
        from pipeline.products.masks import Masks

        mask = np.zeros((frames, 8, 8), bool)
        mask[1:].reshape(frames - 1, -1)[:, :pixels] = True
        Masks(mask, mask).save(root)
    camera = None if pixels is None else SimpleNamespace()
    return SimpleNamespace(tracks_valid=valid, camera=camera, frame_count=frames, perceived=root)


@pytest.mark.parametrize(
    ("valid", "pixels", "what"),
    [
        (np.zeros((4, 5), bool), None, "0 3D tracks on the object"),
        (np.arange(4)[:, None].repeat(5, 1) == 0, None, "known in 0 of the 3 observed frames"),
        (np.zeros((4, 0), bool), None, "0 3D tracks on the object"),
        (np.zeros((4, 5), bool), 0, "the largest mask of the object after frame 0 has 0 pixels"),
        (np.zeros((4, 0), bool), LEAST_PIXELS - 1, f"has {LEAST_PIXELS - 1} pixels"),
    ],
)
def test_scores_without_a_measurement_are_refused(valid, pixels, what, tmp_path):
    with pytest.raises(InputError) as raised:
        Sequence.require_measurement(sequence(valid, pixels, tmp_path))
    assert what in raised.value.what and str(tmp_path) in raised.value.where and raised.value.remedy


@pytest.mark.parametrize(("valid", "pixels"), [(True, None), (True, 0), (False, LEAST_PIXELS)])
def test_scores_of_one_kind_of_measurement_pass(valid, pixels, tmp_path):
    Sequence.require_measurement(sequence(np.full((4, 5), valid), pixels, tmp_path))


# --- the floor itself -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("tracks_known", range(LEAST_TRACKS + 2))
@pytest.mark.parametrize("frames_known", range(LEAST_FRAMES + 2))
def test_the_floor_of_tracks(tracks_known, frames_known):
    valid = np.zeros((6, 9), bool)
    valid[1 : 1 + frames_known, :tracks_known] = True
    enough = tracks_known >= LEAST_TRACKS and frames_known >= LEAST_FRAMES
    with passes() if enough else pytest.raises(InputError):
        require_tracks(valid, "here")


@pytest.mark.parametrize("count", [0, LEAST_PIXELS - 1, LEAST_PIXELS])
def test_the_floor_of_pixels(count):
    with passes() if count >= LEAST_PIXELS else pytest.raises(InputError, match=f"{count} pixels"):
        require_pixels(count, "a mask", "here")


@contextmanager
def passes():
    yield
