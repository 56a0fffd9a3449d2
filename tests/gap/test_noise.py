"""The noise model whitens what it says it does."""

import numpy as np
import pytest

from physreal_core.gap.noise.model import ModelError, Noise

FRAMES, TRACKS, SIGMA = 12, 9, 1e-3


def scene(seed: int = 0):
    random = np.random.default_rng(seed)
    points0 = random.uniform(-0.1, 0.1, (TRACKS, 3))
    motion = points0 + np.linspace(0, 0.06, FRAMES)[:, None, None] * np.array([1.0, 0.0, 0.5])
    valid = random.random((FRAMES, TRACKS)) > 0.2
    valid[0] = False
    modes = 1e-3 * np.sin(np.linspace(0, 3, FRAMES))[None, :, None, None] * random.standard_normal((2, 1, TRACKS, 3))
    carried = np.broadcast_to(np.eye(3)[:, None, None], (3, FRAMES, TRACKS, 3)).copy()
    return points0, motion, valid, modes, carried


def noise(error: ModelError | None = None) -> Noise:
    points0, motion, valid, modes, carried = scene()
    sigma = np.full(valid.shape, SIGMA)
    return Noise(sigma, valid, points0, motion, modes, carried, 30.0, error or ModelError(rms=1e-3))


def samples(count: int) -> np.ndarray:
    """Residuals of a right model: sensor noise now and in frame 0, and the reruns' differences at random amplitudes."""
    random = np.random.default_rng(1)
    *_, modes, _ = scene()
    now = SIGMA * random.standard_normal((count, FRAMES, TRACKS, 3))
    first = SIGMA * random.standard_normal((count, 1, TRACKS, 3))
    return now - first + np.einsum("sm,mtjk->stjk", random.standard_normal((count, len(modes))), modes)


def test_whitened_samples_are_independent_and_of_size_one():
    model = noise(ModelError(rms=1e-9, relative=0.0))
    whitened = model.whiten(samples(4000))
    covariance = whitened @ whitened.T / whitened.shape[1]
    off = covariance - np.diag(np.diag(covariance))
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.12)
    assert np.abs(off).max() < 0.12


def test_global_test_is_calibrated_and_sees_a_gap():
    model = noise(ModelError(rms=1e-9, relative=0.0))
    p = np.array([model.global_test(sample, 0)["p_value"] for sample in samples(400)])
    assert 0.02 < (p < 0.05).mean() < 0.09
    gap = samples(1)[0] + 8e-3 * np.linspace(0, 1, FRAMES)[:, None, None] * np.array([0.0, 0.0, 1.0])
    assert noise(ModelError(rms=5e-4)).global_test(gap, 0)["p_value"] < 1e-6


def test_what_the_numerics_can_move_is_little_evidence():
    *_, modes, _ = scene()
    along = 3.0 * modes[:1]
    with_modes, without = noise(), noise(ModelError(rms=1e-3, reruns=0.0))
    assert (with_modes.whiten(along) ** 2).sum() < 12.0 < (without.whiten(along) ** 2).sum()


def test_one_track_has_a_model_error_that_is_smooth_in_time():
    points0, *fields = scene()
    motion, valid, modes, carried = (np.take(field, [0], -2 if field.ndim > 2 else -1) for field in fields)
    alone = Noise(np.full(valid.shape, SIGMA), valid, points0[:1], motion, modes, carried, 30.0, ModelError(rms=1e-2))
    steady, jumping = (
        (alone.whiten(np.tile(course[:, None, None], (1, 1, 1, 3))) ** 2).sum()
        for course in (1e-2 * np.ones(FRAMES), 1e-2 * (-1.0) ** np.arange(FRAMES))
    )
    assert 5.0 * steady < jumping


def test_modes_and_sensor_are_the_covariance():
    """The spread of a weighted sum by modes and sensor is that of samples."""
    model = noise(ModelError(rms=1e-9, relative=0.0))
    *_, valid, _, _ = scene()
    weights = np.random.default_rng(2).standard_normal((valid.sum(), 3)) + 1.0
    expected = np.sqrt(
        (np.tensordot(model.modes(), weights, 2) ** 2).sum() + (SIGMA * weights).ravel() @ (SIGMA * weights).ravel()
    )
    sums = [(sample[valid] * weights).sum() for sample in samples(4000)]
    assert np.std(sums) == pytest.approx(expected, rel=0.05)
