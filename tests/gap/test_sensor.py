"""A sensor's noise is learnt from the tracks themselves, and counts along the sensor's own axes."""

import numpy as np
import pytest

from physreal_core.gap.interactions.tracks import sight_axes
from physreal_core.gap.noise.model import ModelError, Noise
from physreal_core.gap.noise.neighbours import FINEST, NEIGHBOURS, learnt_sensor, trusted
from physreal_core.gap.noise.sensor import Sensor, SensorNoise

FRAMES, TRACKS = 60, 150
CAMERA = np.array([[0.0, 0.0, -1.0, 0.9], [1.0, 0.0, 0.0, 0.1], [0.0, -1.0, 0.0, 0.2], [0.0, 0.0, 0.0, 1.0]])


def bending_bar(bend: float = 3.0, seed: int = 0) -> np.ndarray:
    """Tracks of a bar of 20 cm that turns by a radian and bends on the way, by up to `bend` rad/m [m], shape [T, J, 3]."""
    random = np.random.default_rng(seed)
    points0 = random.uniform(-1, 1, (TRACKS, 3)) * [0.1, 0.02, 0.02]
    angle = np.linspace(0, 1, FRAMES)[:, None] + bend * np.sin(np.linspace(0, 12, FRAMES))[:, None] * points0[:, 0]
    c, s = np.cos(angle), np.sin(angle)
    x, y = points0[:, 0], points0[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, np.broadcast_to(points0[:, 2], c.shape)], -1)


def noise_of(size, correlation: float, seed: int = 1) -> np.ndarray:
    found = np.random.default_rng(seed).standard_normal((FRAMES, TRACKS, 3))
    for frame in range(1, FRAMES):
        found[frame] = correlation * found[frame - 1] + np.sqrt(1 - correlation**2) * found[frame]
    return found * np.asarray(size)


def known(share: float = 0.7, seed: int = 2) -> np.ndarray:
    valid = np.random.default_rng(seed).random((FRAMES, TRACKS)) < share
    valid[0] = True
    return valid


@pytest.mark.parametrize("correlation", [0.0, 0.6])
@pytest.mark.parametrize("stated", [3e-4, 1e-3, 4e-3])
def test_size_and_correlation_are_found_whatever_is_stated(correlation, stated):
    points = bending_bar() + noise_of(1e-3, correlation)
    found = learnt_sensor(points[0], points, known(), np.full(points.shape[:2], stated))
    assert found.sigma == pytest.approx(1e-3, rel=0.08)
    assert found.correlation == pytest.approx(correlation, abs=0.08)


def test_a_camera_sees_better_across_its_line_of_sight_than_along_it():
    clean = bending_bar(bend=1.0)
    axes = sight_axes(clean, CAMERA)
    strayed = np.einsum("tjax,tja->tjx", axes, noise_of([2e-4, 2e-4, 2e-3], 0.0))
    points = clean + strayed
    found = learnt_sensor(clean[0], points, known(), np.full(clean.shape[:2], 3e-3), axes)
    across, row, along = np.moveaxis(found.sigma, -1, 0)
    assert along == pytest.approx(2e-3, rel=0.08)
    assert across == pytest.approx(2e-4, rel=0.25) and row == pytest.approx(2e-4, rel=0.25)


def test_its_pattern_over_tracks_stays_as_stated():
    stated = np.full((FRAMES, TRACKS), 1e-3)
    stated[:, ::2] *= 3.0
    points = bending_bar() + 0.5 * stated[..., None] * noise_of(1.0, 0.0)
    found = learnt_sensor(points[0], points, known(1.0), stated)
    np.testing.assert_allclose(found.sigma[..., 0] / stated, found.sigma[0, 0, 0] / stated[0, 0])


def test_the_frames_after_the_observed_ones_are_not_looked_at():
    points = bending_bar() + noise_of(1e-3, 0.0)
    points[30:] += noise_of(1e-2, 0.0)[30:]
    found = learnt_sensor(points[0], points, known(), np.full(points.shape[:2], 1e-3), until=30)
    assert found.sigma == pytest.approx(1e-3, rel=0.1)


def test_few_tracks_are_as_good_as_stated():
    few = NEIGHBOURS
    points = (bending_bar() + noise_of(1e-3, 0.0))[:, :few]
    found = learnt_sensor(points[0], points, known()[:, :few], np.full(points.shape[:2], 5e-3))
    assert (found.sigma == 5e-3).all() and (found.correlation == 0.0).all()


def test_tracks_without_noise_are_not_believed_without_end():
    still = np.repeat(bending_bar()[:1], FRAMES, axis=0)
    found = learnt_sensor(still[0], still, known(), np.full(still.shape[:2], 1e-3))
    assert found.sigma == pytest.approx(FINEST * 1e-3)


@pytest.mark.parametrize("slipped", [0.01, 0.3])
def test_a_track_that_slips_is_not_trusted_and_its_neighbours_are(slipped):
    points, valid = bending_bar(bend=1.0) + noise_of(3e-4, 0.0), known()
    valid[20:, 7] = True
    points[20:, 7, 2] += slipped
    found = trusted(points[0], points, valid, np.full(points.shape[:2], 1e-3))
    assert not found[20:, 7].any()
    assert (valid & ~found).sum() <= (FRAMES - 20) + 0.001 * valid.sum()


def test_all_tracks_of_a_body_that_bends_are_trusted():
    points, valid = bending_bar() + noise_of(1e-3, 0.0), known()
    assert (trusted(points[0], points, valid, np.full(points.shape[:2], 1e-3)) == valid).mean() > 0.999


def test_few_tracks_are_all_trusted():
    points, valid = bending_bar()[:, :NEIGHBOURS] * 2.0, known()[:, :NEIGHBOURS]
    assert (trusted(points[0], points, valid, np.full(points.shape[:2], 1e-3)) == valid).all()


def sighted(correlation=(0.3, 0.7, 0.0)) -> tuple[Sensor, np.ndarray]:
    points = bending_bar()[:12, :8]
    sigma = np.broadcast_to([2e-4, 4e-4, 2e-3], points.shape)
    valid = np.random.default_rng(3).random(points.shape[:2]) > 0.2
    valid[0] = False
    return Sensor(sigma, np.array(correlation), sight_axes(points, CAMERA)), valid


def test_axes_of_sight_are_a_rotation_whose_last_row_is_the_line_of_sight():
    points = bending_bar()
    axes = sight_axes(points, CAMERA)
    np.testing.assert_allclose(axes @ np.swapaxes(axes, -1, -2), np.broadcast_to(np.eye(3), axes.shape), atol=1e-12)
    along = points - CAMERA[:3, 3]
    np.testing.assert_allclose(np.cross(axes[..., 2, :], along), 0.0, atol=1e-12)


def test_weights_along_the_axes_of_sight_can_be_undone():
    sensor, valid = sighted()
    noise = SensorNoise(sensor, valid)
    rows = noise.rows(np.random.default_rng(4).standard_normal((5, *valid.shape, 3)))
    np.testing.assert_allclose(noise.metres(noise.weighted(rows)), rows, atol=1e-12)


def test_what_a_camera_sees_is_whitened_with_its_start():
    """The body turns and carries the error of frame 0 along; the noise of each axis hangs on in its own way."""
    sensor, valid = sighted()
    random, count = np.random.default_rng(5), 4000
    now = random.standard_normal((count, *valid.shape, 3))
    for frame in range(1, len(valid)):
        c = sensor.correlation
        now[:, frame] = c * now[:, frame - 1] + np.sqrt(1 - c**2) * now[:, frame]
    errors = np.einsum("tjax,stja->stjx", sensor.axes, now * sensor.sigma)
    angle = np.linspace(0, 1, len(valid))
    turn = np.array([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in angle])
    carried = np.einsum("txy,sjy->stjx", turn, errors[:, 0])
    sensitivity = np.broadcast_to(np.moveaxis(turn, 2, 0)[:, :, None], (3, *valid.shape, 3))
    points = bending_bar()[: len(valid), : valid.shape[1]]
    model = Noise(
        sensor, valid, points[0], points, np.zeros((0, *points.shape)), sensitivity, 30.0, ModelError(rms=1e-9)
    )
    whitened = model.whiten(carried - errors)
    covariance = whitened @ whitened.T / count
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.12)
    assert np.abs(covariance - np.diag(np.diag(covariance))).max() < 0.12
