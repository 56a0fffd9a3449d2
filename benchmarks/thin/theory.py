"""Closed forms of beams, cables and plates; SI units."""

import math

import numpy as np
from scipy.integrate import solve_bvp
from scipy.optimize import brentq

FIRST_CLAMPED_FREE = 1.8751040687
"""First root of cosh b cos b = -1."""
FIRST_OF_CHAIN = 2.4048255577
"""First root of the Bessel function J0."""


def heavy_elastica(weight: float, length: float, bending: float) -> tuple[float, float]:
    """Where the free end of a heavy elastic line hangs that is held level: (along, down) [m].

    With theta the angle below the level: B theta'' = -q (L - s) cos(theta), theta(0) = 0, theta'(L) = 0; continued from a small weight.

    Args:
        weight: q, of a metre [N/m].
        length: L [m].
        bending: B, bending stiffness [N m2].
    """
    s = np.linspace(0.0, length, 200)
    angle = np.zeros((2, len(s)))
    for share in (0.02, 0.1, 0.3, 1.0):
        slope = lambda s, y, q=share * weight: np.stack([y[1], -q * (length - s) * np.cos(y[0]) / bending])
        found = solve_bvp(slope, lambda a, b: np.array([a[0], b[1]]), s, angle, tol=1e-8, max_nodes=100_000)
        if not found.success:
            raise ArithmeticError(found.message)
        angle = found.sol(s)
    fine = np.linspace(0.0, length, 2001)
    theta = found.sol(fine)[0]
    return float(np.trapezoid(np.cos(theta), fine)), float(np.trapezoid(np.sin(theta), fine))


def catenary_sag(length: float, span: float) -> float:
    """How far the middle of an inextensible line hangs below its ends [m]: a (cosh(D / 2a) - 1) with 2 a sinh(D / 2a) = L."""
    a = brentq(lambda a: 2.0 * a * math.sinh(span / (2.0 * a)) - length, span / 20.0, 50.0 * span)
    return a * (math.cosh(span / (2.0 * a)) - 1.0)


def clamped_frequency(bending: float, mass: float, length: float) -> float:
    """Of the first vibration of a beam that is held at one end [rad/s]; `mass` of a metre [kg/m]."""
    return FIRST_CLAMPED_FREE**2 * math.sqrt(bending / mass) / length**2


def clamped_shape(place: np.ndarray) -> np.ndarray:
    """The first vibration's shape at `place`, from 0 at the held end to 1 at the free one."""
    b = FIRST_CLAMPED_FREE
    ratio = (np.cosh(b) + np.cos(b)) / (np.sinh(b) + np.sin(b))
    x = b * np.clip(place, 0.0, None)
    return (np.cosh(x) - np.cos(x) - ratio * (np.sinh(x) - np.sin(x))) / 2.0


def chain_frequency(length: float, gravity: float) -> float:
    """Of the slowest swing of a hanging chain [rad/s] (Bernoulli): j0 / 2 sqrt(g / L)."""
    return FIRST_OF_CHAIN / 2.0 * math.sqrt(gravity / length)


def plate_stiffness(youngs_modulus: float, poissons_ratio: float, thickness: float) -> float:
    """D = E t^3 / (12 (1 - nu^2)) [N m]."""
    return youngs_modulus * thickness**3 / 12.0 / (1.0 - poissons_ratio**2)
