"""The noise of tracks is learnt from the tracks themselves; what has slipped off the body is not trusted; some tracks stand for all."""

import numpy as np
import pytest

from physreal_core.gap.interactions.tracks import LARGEST, spread_tracks
from physreal_core.gap.noise.neighbours import LEAST, NEIGHBOURS, learnt_noise, trusted

FRAMES, TRACKS = 60, 150


def bending_bar(bend: float = 3.0, seed: int = 0) -> np.ndarray:
    """Tracks of a bar of 20 cm that turns by a radian and bends on the way, by up to `bend` rad/m [m], shape [T, J, 3]."""
    random = np.random.default_rng(seed)
    points0 = random.uniform(-1, 1, (TRACKS, 3)) * [0.1, 0.02, 0.02]
    angle = np.linspace(0, 1, FRAMES)[:, None] + bend * np.sin(np.linspace(0, 12, FRAMES))[:, None] * points0[:, 0]
    c, s = np.cos(angle), np.sin(angle)
    x, y = points0[:, 0], points0[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(points0[:, 2], c.shape)], -1)


def noise_of(size: float, correlation: float, seed: int = 1) -> np.ndarray:
    found = np.random.default_rng(seed).standard_normal((FRAMES, TRACKS, 3))
    for frame in range(1, FRAMES):
        found[frame] = correlation * found[frame - 1] + np.sqrt(1 - correlation**2) * found[frame]
    return size * found


def known(share: float = 0.7, seed: int = 2) -> np.ndarray:
    valid = np.random.default_rng(seed).random((FRAMES, TRACKS)) < share
    valid[0] = True
    return valid


def stated(size: float) -> np.ndarray:
    return np.full((FRAMES, TRACKS), size)


@pytest.mark.parametrize("correlation", [0.0, 0.6])
@pytest.mark.parametrize("told", [3e-4, 1e-3, 1.9e-3])
def test_size_and_correlation_are_found_whatever_is_stated(correlation, told):
    points = bending_bar() + noise_of(1e-3, correlation)
    found = learnt_noise(points[0], points, known(), stated(told))
    assert found.sigma == pytest.approx(1e-3, rel=0.08)
    assert found.correlation == pytest.approx(correlation, abs=0.08)


def test_fits_count_a_measurement_with_half_its_stated_deviation_at_least():
    points = bending_bar(bend=1.0) + noise_of(2e-4, 0.0)
    found = learnt_noise(points[0], points, known(), stated(1e-3))
    assert found.sigma == pytest.approx(LEAST * 1e-3)
    assert found.sensor == pytest.approx(2e-4, rel=0.3)


def test_its_pattern_over_tracks_stays_as_stated():
    pattern = stated(1e-3)
    pattern[:, ::2] *= 3.0
    points = bending_bar() + 0.8 * pattern[..., None] * noise_of(1.0, 0.0)
    found = learnt_noise(points[0], points, known(1.0), pattern)
    np.testing.assert_allclose(found.sigma / pattern, found.sigma[0, 0] / pattern[0, 0])


def test_few_tracks_are_as_good_as_stated():
    points = (bending_bar() + noise_of(1e-3, 0.0))[:, :NEIGHBOURS]
    found = learnt_noise(points[0], points, known()[:, :NEIGHBOURS], stated(5e-3)[:, :NEIGHBOURS])
    assert (found.sigma == 5e-3).all() and found.correlation == 0.0


def test_a_recording_of_two_frames_is_as_good_as_stated():
    points = (bending_bar() + noise_of(1e-3, 0.0))[:2]
    assert (learnt_noise(points[0], points, known()[:2], stated(5e-3)[:2]).sigma == 5e-3).all()


@pytest.mark.parametrize("slipped", [0.01, 0.3])
def test_a_track_that_slips_is_not_trusted_and_its_neighbours_are(slipped):
    points, valid = bending_bar(bend=1.0) + noise_of(3e-4, 0.0), known()
    valid[20:, 7] = True
    points[20:, 7, 2] += slipped
    found = trusted(points[0], points, valid, stated(5e-4))
    assert not found[20:, 7].any()
    assert (valid & ~found).sum() <= (FRAMES - 20) + 0.001 * valid.sum()


def test_all_tracks_of_a_body_that_bends_are_trusted():
    points, valid = bending_bar() + noise_of(1e-3, 0.0), known()
    assert (trusted(points[0], points, valid, stated(1e-3)) == valid).mean() > 0.999


def test_few_tracks_are_all_trusted():
    points, valid = 2.0 * bending_bar()[:, :NEIGHBOURS], known()[:, :NEIGHBOURS]
    assert (trusted(points[0], points, valid, stated(1e-3)[:, :NEIGHBOURS]) == valid).all()


def test_some_tracks_stand_for_all_and_reach_as_far():
    places = np.random.default_rng(0).uniform(0, 1, (3 * LARGEST, 3))
    valid = np.ones((10, len(places)), bool)
    valid[1:, ::5] = False
    kept = spread_tracks(places, valid)
    assert len(np.unique(kept)) == LARGEST and not (kept % 5 == 0).any()
    assert (np.ptp(places[kept], axis=0) > 0.95 * np.ptp(places, axis=0)).all()
    assert (spread_tracks(places[:20], valid[:, :20]) == np.arange(20)).all()
