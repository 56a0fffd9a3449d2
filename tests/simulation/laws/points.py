"""Deformation gradients that laws are tried at, and the directional finite differences that adjoints are held to."""

from collections.abc import Callable

import numpy as np

SPECIAL = {
    "identity": (1.0, 1.0, 1.0),
    "uniform stretch": (1.2, 1.2, 1.2),
    "two equal": (1.3, 1.3, 0.7),
    "two nearly equal": (1.3, 1.3 + 1e-9, 0.7),
    "three nearly equal": (0.9, 0.9 + 1e-7, 0.9 - 1e-8),
    "large stretch": (4.0, 0.5, 0.4),
    "near inversion": (1.1, 0.9, 0.02),
    "flat": (1.1, 0.05, 0.02),
}


def rotations(count: int, rng: np.random.Generator) -> np.ndarray:
    """Random rotations [count, 3, 3]."""
    Q = np.linalg.qr(rng.normal(size=(count, 3, 3)))[0]
    return Q * np.sign(np.linalg.det(Q))[:, None, None]


def special_points(rng: np.random.Generator) -> np.ndarray:
    """One F per entry of `SPECIAL`, axis-aligned, and again with random singular vectors; then a pure shear of one."""
    sigma = np.array([np.diag(s) for s in SPECIAL.values()])
    turned = rotations(len(sigma), rng) @ sigma @ rotations(len(sigma), rng)
    shear = np.eye(3)
    shear[0, 1] = 1.0
    return np.concatenate([sigma, turned, shear[None]])


def generic_points(count: int, rng: np.random.Generator, spread: float = 0.3) -> np.ndarray:
    """Random F [count, 3, 3] with distinct singular values exp(spread * normal), det F > 0."""
    sigma = np.exp(spread * rng.normal(size=(count, 3)))
    return rotations(count, rng) @ (sigma[:, :, None] * rotations(count, rng))


def directional(
    function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, direction: np.ndarray, seed: np.ndarray, step: float
) -> np.ndarray:
    """d/ds <seed, function(at + s direction)> per point [count], to fourth order in `step`."""
    difference = (
        8 * (function(at + step * direction) - function(at - step * direction))
        - (function(at + 2 * step * direction) - function(at - 2 * step * direction))
    ) / (12 * step)
    return (seed * difference).reshape(len(seed), -1).sum(1)


def inner(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Inner products per point [count]."""
    return (a * b).reshape(len(a), -1).sum(1)
