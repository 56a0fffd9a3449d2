"""A hand's path out of a record that is not exact: noise of known size on paths of known shape."""

import numpy as np
import pytest

from data.rig.motions import MOTIONS
from data.rig.recording import lasting
from physreal_core.fitting.hand_record import HAND_ERROR, HAND_LASTS, LONGEST, estimate_hand, unknown_hand

FPS = 60.0


def strokes(frames: int, fps: float = FPS) -> np.ndarray:
    """Up in the first half second, then to and fro sideways; [T, 3] m."""
    time = np.arange(frames) / fps
    share = np.clip(time / 0.5, 0.0, 1.0)
    swing = 0.04 * np.sin(2 * np.pi * 0.8 * np.maximum(time - 0.5, 0.0)) ** 2
    return np.stack([swing, 0 * time, 0.08 * share**2 * (3 - 2 * share)], 1)


def recorded(size: float, frames: int = 120, fps: float = FPS, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Four points of a hand [T, 4, 3] m, true and with an error that hangs on, the same for all points."""
    random = np.random.default_rng(seed)
    corners = np.array([[0.0, 0, 0], [0.02, 0, 0], [0, 0.02, 0], [0, 0, 0.02]]) + 0.3
    kept = np.exp(-1 / (fps * HAND_LASTS))
    error = lasting((frames, 3), kept, random)
    true = corners + strokes(frames, fps)[:, None]
    return true, true + size * (error - error[0])[:, None]


def jumps(path: np.ndarray) -> float:
    """Root mean square of the second differences from frame to frame [m]."""
    return float(np.sqrt((np.diff(path, 2, axis=0) ** 2).mean()))


@pytest.mark.parametrize("size", [0.0003, 0.0006])
def test_the_record_says_how_large_its_error_is(size):
    found = np.array([estimate_hand(recorded(size, seed=seed)[1], FPS).error for seed in range(8)])
    assert np.exp(np.log(found / size).mean()) == pytest.approx(1.0, abs=0.2)


def test_the_error_no_longer_jumps():
    true, record = recorded(0.0006)
    found = estimate_hand(record, FPS)
    assert jumps(found.controllers - true) < 0.2 * jumps(record - true)
    assert np.sqrt(((found.controllers - true) ** 2).mean()) < np.sqrt(((record - true) ** 2).mean())
    np.testing.assert_array_equal(found.controllers[0], record[0])


@pytest.mark.parametrize("fps", [24.0, 60.0])
def test_an_exact_record_is_left_as_it_is(fps):
    true, record = recorded(0.0, frames=round(2 * fps), fps=fps)
    np.testing.assert_allclose(estimate_hand(record, fps).controllers, true, rtol=0, atol=1e-4)


def test_what_is_open_covers_the_error_that_is_left():
    """Summed over many records, the left error's square along the modes is what they say."""
    ratios = []
    for seed in range(12):
        true, record = recorded(0.0005, seed=seed)
        found = estimate_hand(record, FPS)
        error = (found.controllers - true)[:, 0]
        sizes = np.linalg.norm(found.modes, axis=1)
        ratios.append(((found.modes / sizes[:, None] ** 2) @ error) ** 2)
    assert 0.5 < np.mean([ratio.mean() for ratio in ratios]) < 2.0


@pytest.mark.parametrize("name", MOTIONS)
def test_the_error_that_is_left_is_as_large_as_stated_whatever_the_hand_does(name):
    """Coordinates along the modes have unit variance; a motion that is less smooth than the hand's takes the error for jumps."""
    squares, random = [], np.random.default_rng(3)
    for fps in (24.0, 30.0, 60.0):
        for _ in range(5):
            true = MOTIONS[name](random).displacement(np.arange(round(2 * fps)) / fps)[:, None] + np.zeros((4, 3))
            error = lasting((len(true), 3), np.exp(-1 / (fps * HAND_LASTS)), random)
            found = estimate_hand(true + 0.0005 * (error - error[0])[:, None], fps)
            along = np.linalg.lstsq(found.modes.T, (found.controllers - true)[:, 0], rcond=None)[0]
            squares.append((along**2).mean())
    assert 0.4 < np.mean(squares) < 1.6


def test_a_better_record_leaves_less_open():
    sizes = [
        np.sqrt((estimate_hand(recorded(size)[1], FPS).modes ** 2).sum(0).mean()) for size in (0.0, 0.0002, 0.0008)
    ]
    assert sizes[0] < 0.5 * sizes[1] < 0.25 * sizes[2]


def test_a_hand_that_rests_or_is_not_there_is_as_recorded():
    still = np.zeros((30, 2, 3), np.float32)
    for record in (still, still[:, :0], recorded(0.0005)[1][:2]):
        found = estimate_hand(record, FPS)
        np.testing.assert_array_equal(found.controllers, record)
        np.testing.assert_array_equal(found.modes, unknown_hand(len(record), FPS))
        assert found.error == HAND_ERROR


def test_points_that_turn_are_smoothed_too():
    time = np.arange(120) / FPS
    turned = 0.05 * np.stack([np.cos(time), np.sin(time), 0 * time], 1)[:, None] * np.array([[1.0], [-1.0]])
    record = turned + 0.0003 * np.random.default_rng(3).standard_normal(turned.shape)
    found = estimate_hand(record, FPS).controllers
    assert jumps(found - turned) < 0.3 * jumps(record - turned)


def test_a_long_record_is_learnt_from_where_the_hand_moves():
    still = np.repeat(recorded(0.0)[1][:1], LONGEST, axis=0)
    moving = recorded(0.0005)[1]
    found = estimate_hand(np.concatenate([still, moving]), FPS)
    assert found.error == pytest.approx(estimate_hand(moving, FPS).error, rel=0.5)


def test_the_modes_of_an_unknown_hand_have_its_covariance():
    fps, frames = 50.0, 100
    time = np.arange(frames) / fps
    kernel = HAND_ERROR**2 * np.exp(-np.abs(time[:, None] - time) / HAND_LASTS)
    against_frame_0 = kernel - kernel[:1] - kernel[:, :1] + kernel[0, 0]
    modes = unknown_hand(frames, fps)
    np.testing.assert_allclose(modes[:, 0], 0.0, atol=1e-9)
    np.testing.assert_allclose(modes.T @ modes, against_frame_0, rtol=0, atol=0.2 * HAND_ERROR**2)
    assert 0.95 < np.trace(modes.T @ modes) / np.trace(against_frame_0) < 1.0
    assert len(modes) < frames / 2
