"""Camera: projection, its inverse, resolution changes."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.rendering import Camera
from tests.rendering.splat_scene import camera


def test_known_projection() -> None:
    """Looking down from 2 m: OpenCV x is world x, y is world -y; 0.5 m to the side at f = 100 is 25 px."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[2, 3] = 2.0
    cam = Camera(np.array([[100.0, 0, 64], [0, 100.0, 48], [0, 0, 1]]), pose, 129, 97)
    pixels, depth = cam.project(torch.tensor([[0.5, 0.25, 0.0]], dtype=torch.float64))
    assert torch.allclose(pixels, torch.tensor([[89.0, 35.5]], dtype=torch.float64))
    assert depth.item() == pytest.approx(2.0)


def test_unproject_inverts_project() -> None:
    cam = camera()
    points = cam.unproject(torch.rand(20, 2, dtype=torch.float64) * 30, torch.rand(20, dtype=torch.float64) + 0.5)
    pixels, depth = cam.project(points)
    torch.testing.assert_close(cam.unproject(pixels, depth), points, rtol=0, atol=1e-12)


def test_scaled_keeps_the_image_corners() -> None:
    """The corner of the image, half a pixel outside the outer pixel centres, sees the same ray at every resolution."""
    cam = camera()
    half = cam.scaled(0.5)
    assert (half.width, half.height) == (20, 15)
    one = torch.tensor(1.0, dtype=torch.float64)
    for a, b in [((-0.5, -0.5), (-0.5, -0.5)), ((39.5, 29.5), (19.5, 14.5))]:
        full = cam.unproject(torch.tensor(a, dtype=torch.float64), one)
        torch.testing.assert_close(half.unproject(torch.tensor(b, dtype=torch.float64), one), full)


@pytest.mark.parametrize("K", [np.eye(4), np.diag([-1.0, 1, 1]), np.array([[1.0, 0.5, 0], [0, 1, 0], [0, 0, 1]])])
def test_bad_intrinsics(K: np.ndarray) -> None:
    with pytest.raises(InputError, match="3x3, fx and fy > 0"):
        Camera(K, np.eye(4), 10, 10)
