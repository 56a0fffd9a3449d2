"""Effects of the surroundings against closed forms."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from tests.effects.specimen import Specimen, lattice_body, material

GRAVITY = 9.81


def free_block(frames: int, fps: float = 30.0) -> Specimen:
    """In free fall."""
    body = lattice_body((4, 3, 5), corner=(0.1, 0.2, 5.0))
    points = torch.zeros(frames, 0, 3, dtype=torch.float64)
    return Specimen(body, points, fps, material(body), ground_height=None)


def fall(frames: int, **values: dict[str, float]) -> torch.Tensor:
    """Velocity of the centre of mass by frame [m/s]."""
    with torch.no_grad():
        return free_block(frames).rollout(**values).v.mean(1)


def test_terminal_velocity_of_linear_drag_is_g_over_c():
    """Reached as 1 - exp(-c t); the terminal velocity is exact in discrete time, too."""
    rate = 12.0
    speed = -fall(46, linear_drag={"rate": rate})[:, 2]
    assert float(speed[-1]) == pytest.approx(GRAVITY / rate, rel=1e-6)
    time = torch.arange(46) / 30
    torch.testing.assert_close(speed.float(), GRAVITY / rate * (1 - torch.exp(-rate * time)), rtol=0.02, atol=1e-3)


def test_terminal_velocity_of_quadratic_drag_is_root_of_g_over_c():
    """Reached as tanh(t sqrt(g c))."""
    rate = 15.0
    speed = -fall(31, quadratic_drag={"rate": rate})[:, 2]
    assert float(speed[-1]) == pytest.approx(np.sqrt(GRAVITY / rate), rel=1e-6)
    time = torch.arange(31) / 30
    expected = np.sqrt(GRAVITY / rate) * torch.tanh(np.sqrt(GRAVITY * rate) * time)
    torch.testing.assert_close(speed.float(), expected.float(), rtol=0.02, atol=1e-3)


def test_wind_accelerates_the_centre_of_mass_by_its_coefficients():
    """The surface alone is pushed, but all of the force arrives: v = (a + g) t, to rounding."""
    velocity = fall(7, wind={"x": 1.5, "y": -0.7, "z": 0.4})
    expected = torch.tensor([1.5, -0.7, 0.4 - GRAVITY], dtype=torch.float64) * 6 / 30
    torch.testing.assert_close(velocity[-1], expected, rtol=1e-9, atol=1e-9)


def test_wind_pushes_the_surface_alone():
    """Corners more than edges, edges more than faces, and nothing inside."""
    from physreal_core.effects.shape import exposure

    share = exposure(lattice_body((5, 5, 5))).reshape(5, 5, 5)
    corner, edge, face, inside = share[0, 0, 0], share[0, 0, 2], share[0, 2, 2], share[2, 2, 2]
    assert corner > edge > face > inside == 0
    assert share.sum() == pytest.approx(1.0)


def test_gravity_is_turned_about_x_then_about_y_and_scaled():
    velocity = fall(7, gravity={"tilt_x": 0.2, "tilt_y": -0.3, "excess": 0.1})
    turned = Rotation.from_euler("xy", [0.2, -0.3]).apply([0.0, 0.0, -GRAVITY])
    np.testing.assert_allclose(velocity[-1], 1.1 * turned * 6 / 30, rtol=1e-9)
