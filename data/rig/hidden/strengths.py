"""Amplitudes at which a bar's tracks are about 1.5, 4 and 9 mm from those of any elastic bar (see `calibrate.py`).

Measured by `python -m data.rig.hidden.calibrate`; units are those of the amplitude of each effect in `library.py`. Below what
the sizes ask for, lest it be another effect or object: at "high", wind gives 6 mm, gravity 4, payload and density 5, fibres 4,
stiffening 1.7 (a stiffer elastic bar comes near), stick-slip 0.8 and rate friction 2.3, which this bar hardly shows.
"""

STRENGTHS = ("weak", "middle", "high")

AMPLITUDES: dict[str, tuple[float, float, float]] = {
    "linear_drag": (0.205, 0.613, 1.84),
    "quadratic_drag": (0.255, 0.839, 3.1),
    "wind": (1.7, 3.69, 8.0),
    "gravity": (0.159, 0.258, 0.42),
    "kelvin_voigt": (0.0004, 0.00108, 0.00483),
    "maxwell_creep": (0.0954, 0.26, 0.609),
    "plastic_yield": (6.86, 8.32, 10.6),
    "strain_stiffening": (1.5, 3.0, 5.0),
    "fibres": (0.511, 1.75, 6.0),
    "soft_spot": (0.62, 0.82, 0.93),
    "rest_shape": (0.156, 0.435, 0.945),
    "payload": (0.47, 0.84, 1.45),
    "density_gradient": (3.96, 7.7, 14.0),
    "ground_adhesion": (79.4, 227.0, 589.0),
    "stick_slip": (0.6, 1.2, 2.4),
    "rate_friction": (1.8, 3.28, 6.0),
    "ground_plane": (0.0109, 0.0291, 0.0655),
    "obstacle_plane": (0.000624, 0.00242, 0.00516),
    "obstacle_sphere": (0.0001, 0.000626, 0.00399),
    "obstacle_post": (0.000542, 0.00298, 0.00978),
    "grip_slip": (0.00142, 0.00379, 0.00854),
    "grip_compliance": (2.7e-05, 0.0001, 0.00026),
    "grip_offset": (0.00154, 0.00415, 0.00943),
    "grip_lag": (0.00474, 0.0128, 0.0292),
    "camera_drift": (0.00107, 0.00286, 0.00645),
    "depth_bias": (0.00872, 0.0233, 0.0523),
    "frame_rate": (0.00471, 0.0128, 0.029),
    "outside:magnet": (0.328, 0.921, 2.06),
    "outside:breathing": (0.015, 0.0399, 0.0904),
    "outside:turntable": (3.12, 4.33, 6.0),
    "outside:tether": (0.877, 2.63, 8.01),
}
