"""Amplitudes at which a bar's tracks move by about 1.5, 4 and 9 mm (root mean square, over the motion that shows it more).

Written by `python -m data.rig.hidden.calibrate`; units are those of the amplitude of each effect in `library.py`.
"""

STRENGTHS = ("weak", "middle", "high")

AMPLITUDES: dict[str, tuple[float, float, float]] = {
    "linear_drag": (0.3, 1.0, 3.0),
    "quadratic_drag": (1.0, 3.0, 9.0),
    "wind": (0.3, 0.8, 2.0),
    "gravity": (0.03, 0.08, 0.18),
    "kelvin_voigt": (0.003, 0.008, 0.02),
    "payload": (0.01, 0.03, 0.07),
}
