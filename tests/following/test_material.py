"""The ensemble transform Kalman filter of a material, against the Kalman filter in closed form."""

import dataclasses

import numpy as np
import pytest

from physreal_core.following.material import LearntMaterial
from tests.fitting import scene

SPREAD = 0.4


@pytest.mark.parametrize("factor", [0.8, 1.3])
def test_a_linear_model_is_learnt_as_by_kalman(factor):
    """y = H log factor + r with covariance R: mean and deviation after one frame."""
    random, members, tracks = np.random.default_rng(0), 8, 5
    H, root = random.normal(size=(tracks, 3)), random.normal(size=(tracks, tracks))
    R = 0.3 * root @ root.T + 0.1 * np.eye(tracks)
    own = LearntMaterial(scene.model(), {"youngs_modulus": SPREAD}, members, 1.0)
    forecasts = own.logarithms[:, 0, None, None] * H
    valid = np.array([True, True, False, True, True])
    seen = np.log(factor) * H + 0.1 * random.normal(size=H.shape)
    update = own.update(forecasts, seen - forecasts.mean(0), valid, R)
    h, W = H[valid], np.linalg.inv(R[np.ix_(valid, valid)])
    precision = SPREAD**-2 + sum(h[:, a] @ W @ h[:, a] for a in range(3))
    mean = sum(h[:, a] @ W @ seen[valid, a] for a in range(3)) / precision
    told = own.told()["youngs_modulus"]
    assert np.log(told["factor"]) == pytest.approx(mean, rel=1e-9)
    assert told["log_deviation"] == pytest.approx(precision**-0.5, rel=1e-9)
    np.testing.assert_allclose(update.of_mean(forecasts), mean * H, rtol=1e-9)
    np.testing.assert_allclose(update.spread(forecasts), np.abs(H) / np.sqrt(precision), rtol=1e-9)


def test_frames_that_count_as_one_leave_a_wider_spread():
    own = {frames: LearntMaterial(scene.model(), {"youngs_modulus": SPREAD}, 6, frames) for frames in (1.0, 10.0)}
    for material in own.values():
        forecasts = material.logarithms[:, 0, None, None] * np.ones((4, 3))
        material.update(forecasts, np.zeros((4, 3)), np.ones(4, bool), np.eye(4))
    found = [material.told()["youngs_modulus"]["log_deviation"] for material in own.values()]
    np.testing.assert_allclose(found, [(SPREAD**-2 + 12.0 / frames) ** -0.5 for frames in own], rtol=1e-9)


def test_nothing_seen_says_nothing():
    own = LearntMaterial(scene.model(), {"youngs_modulus": SPREAD}, 4, 1.0)
    before = own.logarithms.copy()
    update = own.update(np.zeros((4, 3, 3)), np.zeros((3, 3)), np.zeros(3, bool), np.eye(3))
    np.testing.assert_array_equal(own.logarithms, before)
    assert not update.of_mean(np.arange(12.0).reshape(4, 3)).any()


def test_members_have_their_own_factors():
    model = scene.model()
    own = LearntMaterial(model, {"youngs_modulus": SPREAD, "friction_coefficient": 0.2}, 6, 1.0)
    factors = [own.fields(number)["youngs_modulus"] / model.fields["youngs_modulus"] for number in range(6)]
    np.testing.assert_allclose(np.log([float(f.mean()) for f in factors]), own.logarithms[:, 0], rtol=1e-5)
    np.testing.assert_allclose(own.logarithms.std(0, ddof=1), [SPREAD, 0.2])
    assert set(own.fields(0)) == set(model.fields) and dataclasses.is_dataclass(model)
