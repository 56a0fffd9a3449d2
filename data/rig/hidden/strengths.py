"""Amplitudes at which a bar's tracks are about 1.5, 4 and 9 mm from those of any elastic bar (see `calibrate.py`).

Written by `python -m data.rig.hidden.calibrate`; units are those of the amplitude of each effect in `library.py`.
"""

STRENGTHS = ("weak", "middle", "high")

AMPLITUDES: dict[str, tuple[float, float, float]] = {
    "linear_drag": (0.205, 0.613, 1.84),
    "quadratic_drag": (0.255, 0.839, 3.1),
    "wind": (1.7, 3.69, 8.0),
    "gravity": (0.159, 0.258, 0.42),
    "kelvin_voigt": (0.0006, 0.0015, 0.0036),
    "maxwell_creep": (0.0954, 0.26, 0.609),
    "plastic_yield": (6.86, 8.32, 10.6),
    "strain_stiffening": (0.3, 1.0, 3.0),
    "fibres": (0.2, 0.5, 1.5),
    "soft_spot": (0.2, 0.5, 0.9),
    "rest_shape": (0.1, 0.3, 0.8),
    "payload": (0.005, 0.015, 0.04),
    "density_gradient": (0.3, 1.0, 3.0),
    "ground_adhesion": (50.0, 150.0, 400.0),
    "stick_slip": (0.1, 0.3, 0.8),
    "rate_friction": (0.3, 1.0, 3.0),
    "ground_plane": (0.03, 0.08, 0.2),
    "obstacle_plane": (0.002, 0.008, 0.02),
    "obstacle_sphere": (0.002, 0.008, 0.02),
    "obstacle_post": (0.002, 0.008, 0.02),
    "grip_slip": (0.002, 0.005, 0.01),
    "grip_compliance": (0.0005, 0.0015, 0.003),
    "grip_offset": (0.0015, 0.004, 0.009),
    "grip_lag": (0.01, 0.03, 0.06),
    "camera_drift": (0.002, 0.005, 0.01),
    "depth_bias": (0.02, 0.05, 0.1),
    "frame_rate": (0.005, 0.01, 0.02),
    "outside:magnet": (0.05, 0.15, 0.4),
    "outside:breathing": (0.01, 0.03, 0.06),
    "outside:turntable": (0.1, 0.3, 0.8),
    "outside:tether": (0.5, 1.5, 4.0),
}
