"""Image scores against cases worked out by hand, and SSIM against scikit-image."""

from __future__ import annotations

import numpy as np
import pytest

from physreal_core.evaluation import iou, on_black, psnr, ssim
from physreal_core.evaluation.images import PSNR_MAX


def test_iou_without_the_hand() -> None:
    """Rendered 4 pixels, one of them under the hand and not in the mask: intersection 2, union 4."""
    alpha, mask, hand = np.zeros((3, 3)), np.zeros((3, 3), bool), np.zeros((3, 3), bool)
    alpha[0, :3], alpha[1, 0] = 0.5, 1e-6
    hand[0, 2] = True
    mask[0, :2], mask[2, 2] = True, True
    assert iou(alpha, mask, hand) == pytest.approx(2 / 4)
    hand[0, 2] = False
    assert iou(alpha, mask, hand) == pytest.approx(2 / 5)
    assert iou(np.zeros((3, 3)), np.zeros((3, 3), bool), hand) == 1.0


def test_psnr() -> None:
    """A tenth of the pixels off by 0.5 in every channel: mean square 0.025, 16.02 dB."""
    a, b = np.zeros((10, 10, 3)), np.zeros((10, 10, 3))
    b[0] = 0.5
    assert psnr(a, b) == pytest.approx(-10 * np.log10(0.025))
    assert psnr(a, a) == PSNR_MAX


def test_on_black() -> None:
    kept = np.array([[True, False]])
    np.testing.assert_array_equal(on_black(np.full((1, 2, 3), 0.7), kept), [[[0.7] * 3, [0.0] * 3]])


def test_ssim_equals_scikit_image() -> None:
    metrics = pytest.importorskip("skimage.metrics")
    rng = np.random.default_rng(0)
    a = rng.random((40, 50, 3))
    b = np.clip(0.7 * a + 0.2 * rng.random((40, 50, 3)), 0, 1)
    settings = {"data_range": 1.0, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    assert ssim(a, b) == pytest.approx(metrics.structural_similarity(a, b, channel_axis=2, **settings), abs=1e-9)
    assert ssim(a, a) == pytest.approx(1.0)
