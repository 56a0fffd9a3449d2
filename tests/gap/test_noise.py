"""The noise model whitens what it says it does."""

import numpy as np
import pytest
import torch
from scipy.stats import multivariate_normal

from physreal_core.gap.noise.axes import Axes
from physreal_core.gap.noise.discrepancy import Discrepancy
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


def noise(error: ModelError | None = None, correlation: float = 0.0) -> Noise:
    points0, motion, valid, modes, carried = scene()
    sigma = np.full(valid.shape, SIGMA)
    return Noise(sigma, valid, points0, motion, modes, carried, 30.0, error or ModelError(rms=1e-3), "cpu", correlation)


def samples(count: int, correlation: float = 0.0) -> np.ndarray:
    """Residuals of a right model: sensor noise now and in frame 0, and the reruns' differences at random amplitudes."""
    random = np.random.default_rng(1)
    *_, modes, _ = scene()
    now = SIGMA * random.standard_normal((count, FRAMES, TRACKS, 3))
    for frame in range(1, FRAMES):
        now[:, frame] = correlation * now[:, frame - 1] + np.sqrt(1 - correlation**2) * now[:, frame]
    return now - now[:, :1] + np.einsum("sm,mtjk->stjk", random.standard_normal((count, len(modes))), modes)


def test_whitened_samples_are_independent_and_of_size_one():
    model = noise(ModelError(rms=1e-9, relative=0.0))
    whitened = model.whiten(samples(4000))
    covariance = whitened @ whitened.T / whitened.shape[1]
    off = covariance - np.diag(np.diag(covariance))
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.12)
    assert np.abs(off).max() < 0.12


@pytest.mark.parametrize("correlation", [0.3, 0.8])
def test_noise_that_hangs_on_from_frame_to_frame_is_whitened_too(correlation):
    """Frame 0 takes part: the body carries its error along, and the next frames' noise hangs on it."""
    model = noise(ModelError(rms=1e-9, relative=0.0), correlation)
    whitened = model.whiten(samples(4000, correlation))
    covariance = whitened @ whitened.T / whitened.shape[1]
    off = covariance - np.diag(np.diag(covariance))
    assert np.diag(covariance) == pytest.approx(1.0, abs=0.12)
    assert np.abs(off).max() < 0.12


def test_the_true_correlation_is_the_likeliest():
    known = samples(30, 0.6)
    tried = np.linspace(0.0, 0.9, 10)
    models = [noise(ModelError(rms=1e-9, relative=0.0), c) for c in tried]
    logs = [sum(model.log_density(sample) for sample in known) for model in models]
    assert tried[int(np.argmax(logs))] == pytest.approx(0.6)


def test_a_density_integrates_the_model_error():
    """Against scipy's for the covariance as one matrix."""
    model = noise(ModelError(rms=1e-3), 0.5)
    sensor = model.sensor
    columns = np.concatenate([model.known_columns(), model.field_columns()], axis=1)
    inside = sensor.metres(np.concatenate([columns, np.eye(len(columns))], axis=1))
    sample = samples(1, 0.5)[0]
    whole = multivariate_normal(cov=inside @ inside.T).logpdf(model.rows(sample[None])[:, 0])
    constant = -0.5 * len(columns) * np.log(2 * np.pi)
    assert model.log_density(sample) + constant == pytest.approx(whole, rel=1e-4)


def test_weights_and_whitening_can_be_undone():
    model = noise(ModelError(rms=1e-3), 0.5)
    rows = model.rows(samples(3))
    np.testing.assert_allclose(model.sensor.metres(model.sensor.weighted(rows)), rows, atol=1e-15)
    whitened = model.whiten(samples(3))
    np.testing.assert_allclose(model.weighted(whitened), model.sensor.weighted(rows), atol=2e-3)


@pytest.mark.parametrize("size", [0.5, 3.0])
def test_products_beside_an_error_of_any_size_are_those_of_its_covariance(size):
    error = ModelError(rms=1e-3)
    model = noise(error, 0.4)
    found = Discrepancy(model)
    field = size * model.field_columns()
    covariance = np.eye(len(field)) + field @ field.T + model.known_columns() @ model.known_columns().T
    given = model.sensor.weighted(model.rows(samples(2)))
    (products,) = found.products(model.whiten(samples(2)), np.array([size]))
    np.testing.assert_allclose(products, given.T @ np.linalg.solve(covariance, given), rtol=2e-3)
    nothing, own = found.log_sizes(np.array([1e-9, size]))
    plain = np.eye(len(field)) + model.known_columns() @ model.known_columns().T
    expected = 0.5 * (np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(plain)[1])
    assert own - nothing == pytest.approx(expected, rel=1e-3)


@pytest.mark.parametrize("size", [0.5, 3.0])
def test_beside_an_error_of_another_size_it_is_the_model_made_for_that_size(size):
    error, given = ModelError(rms=1e-3), samples(3)
    kept, made = noise(error, 0.4).beside(size), noise(error.times(size), 0.4)
    products = [own.whiten(given).T @ own.whiten(given) for own in (kept, made)]
    np.testing.assert_allclose(*products, rtol=2e-3, atol=1e-3)
    assert kept.log_density(given[0]) == pytest.approx(made.log_density(given[0]), rel=1e-4)


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


def test_where_a_solver_gives_up_the_axes_come_from_lapack(monkeypatch):
    columns, asked, solve = np.random.default_rng(0).standard_normal((40, 6)), [], torch.linalg.eigh

    def gives_up_once(matrix):
        asked.append(matrix)
        if len(asked) == 1:
            raise torch.linalg.LinAlgError("the algorithm failed to converge")
        return solve(matrix)

    plain = Axes(columns, "cpu")
    monkeypatch.setattr(torch.linalg, "eigh", gives_up_once)
    again = Axes(columns, "cpu")
    assert len(asked) == 2
    np.testing.assert_array_equal(again.variances, plain.variances)
    np.testing.assert_array_equal(again.along(columns), plain.along(columns))
