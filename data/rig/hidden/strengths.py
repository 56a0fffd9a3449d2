"""How large a hidden effect is: amplitudes at which a bar's tracks are about `TARGETS` from those of any elastic bar, and how they
scale with another body.

How visible an effect is in a case is measured there (`data/rig/visibility.py`); the scaling only keeps it of one order.

Measured by `python -m data.rig.hidden.calibrate`; units are those of the amplitude of each effect in `library.py`. Below what
the sizes ask for, lest it be another effect or object: at "high", drag gives 4 to 5 mm, wind 5, gravity 4, viscosity 4, payload 6,
density 2.5 (further, the bar slips away), fibres 2, stiffening 1.6 (a stiffer elastic bar comes near). Friction that rises, with
speed or at rest, stays below a coefficient of about 2: the more of it, the further two simulators part where a soft bar is dragged,
without any effect (`python -m benchmarks.friction`). By hand: the table, the obstacles and the soft spot, which the coarse bar of the
calibration meets late or buckles at. What is touched for a few frames is less visible over all of them than `TARGETS` say.
"""

from collections.abc import Callable

import numpy as np

from data.rig.bodies import Body, bar

STRENGTHS = ("weak", "middle", "high")

TARGETS = (0.0012, 0.003, 0.007)
"""Of each strength: root mean square distance of the tracks from those of the nearest elastic bar [m]."""

AMPLITUDES: dict[str, tuple[float, float, float]] = {
    "linear_drag": (0.873, 3.24, 12),
    "quadratic_drag": (3.35, 11.0, 34),
    "surface_drag": (2.0, 6.0, 18.0),
    "wind": (1.36, 2.86, 6),
    "gravity": (0.135, 0.238, 0.42),
    "kelvin_voigt": (0.00141, 0.00651, 0.02),
    "hysteretic_damping": (0.03, 0.12, 0.3),
    "standard_linear_solid": (0.08, 0.3, 1.2),
    "maxwell_creep": (0.124, 0.314, 0.759),
    "plastic_yield": (14.6, 18.9, 24.4),
    "strain_stiffening": (2.98, 3.86, 5),
    "fibres": (2.76, 4.07, 6),
    "soft_spot": (0.65, 0.75, 0.82),
    "rest_shape": (0.156, 0.397, 0.899),
    "payload": (0.316, 0.848, 1.32),
    "density_gradient": (5.56, 8, 10.5),
    "ground_adhesion": (68.9, 202, 597),
    "stick_slip": (0.503, 1.12, 1.6),
    "rate_friction": (0.5, 1.0, 2.0),
    "ground_plane": (0.0114, 0.0287, 0.0706),
    "obstacle_plane": (0.002, 0.005, 0.01),
    "obstacle_sphere": (0.002, 0.005, 0.01),
    "obstacle_post": (0.002, 0.005, 0.01),
    "grip_slip": (0.00114, 0.00288, 0.00673),
    "grip_compliance": (4e-05, 0.00014, 0.00023),
    "grip_offset": (0.00132, 0.00329, 0.00767),
    "grip_lag": (0.00824, 0.0207, 0.0486),
    "camera_drift": (0.000905, 0.00227, 0.0053),
    "depth_bias": (0.0114, 0.0288, 0.0672),
    "frame_rate": (0.00796, 0.0199, 0.0457),
    "outside:magnet": (0.193, 0.492, 1.03),
    "outside:breathing": (0.0137, 0.0344, 0.0796),
    "outside:turntable": (2.85, 4.14, 6),
    "outside:tether": (1.33, 3.48, 10.1),
    "outside:charge": (1.5, 4.0, 8.0),
    "outside:gradient_field": (8.0, 20.0, 45.0),
    "outside:gyration": (3.0, 8.0, 18.0),
}


LARGEST: dict[str, float] = {
    "linear_drag": 12.0,
    "quadratic_drag": 34.0,
    "kelvin_voigt": 0.03,
    "obstacle_plane": 0.03,
    "obstacle_sphere": 0.02,
    "obstacle_post": 0.014,
    "gravity": 0.42,
    "wind": 6.0,
    "soft_spot": 0.95,
    "fibres": 6.0,
    "density_gradient": 15.0,
    "payload": 1.5,
    "stick_slip": 2.5,
    "rate_friction": 6.0,
    "strain_stiffening": 5.0,
    "outside:turntable": 6.0,
    "ground_plane": 0.15,
    "grip_lag": 0.1,
    "frame_rate": 0.1,
    "depth_bias": 0.15,
    "hysteretic_damping": 0.6,
    "standard_linear_solid": 2.5,
    "ground_adhesion": 1500.0,
}
"""Amplitudes on the bar beyond which the effect would be another one, or the object."""


def scaled(name: str, amplitude: float, body: Body) -> float:
    """The amplitude for another body that has about the effect which this one has on the bar.

    Args:
        name: of the effect.
        amplitude: for the bar, from `AMPLITUDES`.
        body: the other one.
    """
    return amplitude * _SCALES[name](body) if name in _SCALES else amplitude


_BAR = bar(np.random.default_rng(0))


def _length(body: Body) -> float:
    """Free length over the bar's."""
    return body.length / _BAR.length


def _weight(body: Body) -> float:
    """Weight over the bar's, at one density."""
    return body.volume / _BAR.volume


def _strain(body: Body) -> float:
    """Strain at the hand when the body hangs there, over the bar's: rho g L^2 / (E h)."""
    return _length(body) ** 2 / (body.softness * body.thickness / _BAR.thickness)


_SCALES: dict[str, Callable[[Body], float]] = {
    "plastic_yield": lambda body: 1 / _strain(body),  # a yield strain's inverse
    "strain_stiffening": lambda body: 1 / _strain(body) ** 2,  # against strain squared
    "rest_shape": lambda body: 1 / _length(body) ** 2,  # a curvature, by which the end moves
    "density_gradient": lambda body: 1 / _length(body),
    "ground_adhesion": lambda body: body.thickness / _BAR.thickness,  # against weight per area
    "grip_compliance": lambda body: 1 / _weight(body),
    "outside:magnet": _weight,
    "outside:tether": _weight,
}
"""What dimensions say; per mass, per speed, in shares and in metres seen, an amplitude holds for any body."""
