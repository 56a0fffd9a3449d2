"""The hand's rigid motion from tracks with outliers and gaps, and where controller points are picked."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from physreal_core.errors import InputError
from physreal_core.perception.controllers import move_controllers, pick_controllers, robust_rigid_fit, with_depth

RANDOM = np.random.default_rng(4)


def _hand(count: int = 60) -> np.ndarray:
    return np.random.default_rng(1).uniform([-0.03, -0.03, 0], [0.03, 0.03, 0.04], (count, 3))


def _motion(frames: int, turn: float) -> tuple[np.ndarray, np.ndarray]:
    angles = np.linspace(0, turn, frames)
    return Rotation.from_rotvec(angles[:, None] * np.array([0.3, 0.2, 1.0])).as_matrix(), np.linspace(
        [0, 0, 0], [0.03, -0.02, 0.12], frames
    )


def test_rigid_fit_is_exact_with_a_third_of_outliers():
    source = _hand()
    rotation = Rotation.from_rotvec([0.1, -0.2, 0.4]).as_matrix()
    target = source @ rotation.T + [0.05, 0.01, 0.1]
    target[::3] += np.random.default_rng(2).uniform(-0.1, 0.1, (20, 3))
    found, shift = robust_rigid_fit(source, target, 0.005)
    assert Rotation.from_matrix(found.T @ rotation).magnitude() < 0.01
    assert np.linalg.norm(shift - [0.05, 0.01, 0.1]) < 0.0005


def test_noise_alone_makes_no_rotation():
    source = _hand(12)
    target = source + [0.0, 0.0, 0.05] + np.random.default_rng(3).normal(0, 0.001, source.shape)
    assert np.array_equal(robust_rigid_fit(source, target, 0.01)[0], np.eye(3))


@pytest.mark.parametrize("turn", [0.0, 0.5])
def test_controllers_follow_the_hand(turn: float):
    source, frames = _hand(), 20
    rotations, shifts = _motion(frames, turn)
    truth = np.einsum("tij,pj->tpi", rotations, source) + shifts[:, None]
    tracks = truth + np.random.default_rng(5).normal(0, 0.001, truth.shape)
    valid = np.random.default_rng(6).random(truth.shape[:2]) > 0.3
    valid[0] = True
    tracks[0] = truth[0]
    moved = move_controllers(source[:7].astype(np.float32), tracks, valid, smoothing=1.0)
    error = np.linalg.norm(moved.points - truth[:, :7], axis=-1)
    # 40 tracks of 1 mm noise: a quarter of a millimetre, more at the rim where rotation errors show.
    assert error.max() < 0.0015 and moved.interpolated == []
    assert np.array_equal(moved.points[0], source[:7].astype(np.float32))
    assert np.allclose(moved.poses[5][:3, :3] @ source[3] + moved.poses[5][:3, 3], moved.points[5, 3], atol=1e-5)


def test_frames_without_the_hand_are_interpolated_and_said():
    source, frames = _hand(), 12
    rotations, shifts = _motion(frames, 0.3)
    truth = np.einsum("tij,pj->tpi", rotations, source) + shifts[:, None]
    valid = np.ones(truth.shape[:2], bool)
    valid[5:8] = False
    moved = move_controllers(
        source[:5].astype(np.float32), np.where(valid[..., None], truth, np.nan), valid, smoothing=0.0
    )
    assert moved.interpolated == [5, 6, 7]
    assert np.isfinite(moved.points).all()
    assert np.linalg.norm(moved.points - truth[:, :5], axis=-1).max() < 0.0005  # the motion is nearly uniform


def test_controllers_are_picked_near_the_object_and_apart():
    hand = np.random.default_rng(0).uniform([0, 0, 0], [0.3, 0.05, 0.02], (800, 3))
    thing = np.array([[0.0, 0.0, 0.0], [0.0, 0.05, 0.0]])
    points = pick_controllers(hand, thing, 10, 0.06)
    assert len(points) == 10 and points[:, 0].max() < 0.07
    gaps = np.linalg.norm(points[:, None] - points[None], axis=-1)[np.triu_indices(10, 1)]
    assert gaps.min() > 0.01


def test_a_hand_without_depth_is_an_error_that_names_the_way_out():
    with pytest.raises(InputError, match="controllers.npz"):
        pick_controllers(np.zeros((0, 3)), np.zeros((5, 3)), 10, 0.05)


def test_a_hand_reaches_behind_its_seen_face():
    eye, face = np.array([0.1, -1.0, 0.3]), np.array([[0.0, 0.0, 0.0], [0.04, 0.0, 0.02]], np.float32)
    points = with_depth(face, eye, 0.04)
    np.testing.assert_array_equal(points[:2], face)
    behind = points[-2:] - face
    np.testing.assert_allclose(np.linalg.norm(behind, axis=1), 0.04, rtol=1e-5)
    np.testing.assert_allclose(np.cross(behind, face - eye), 0.0, atol=1e-7)
    assert with_depth(face, eye, 0.0) is face
