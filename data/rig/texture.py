"""Procedural surface colours, fixed to the material (rest coordinates), so that they move with it. Linear RGB in 0-1."""

import numpy as np

from physreal_core.array_types import Array, Float

TEAL, CREAM, MITTEN = np.array([0.10, 0.42, 0.46]), np.array([0.86, 0.76, 0.58]), np.array([0.78, 0.30, 0.20])
TABLE = np.array([0.42, 0.36, 0.30])
GAMMA = 1 / 1.8  # linear colour to picture


class Waves:
    """Sum of plane waves of about one wavelength in random directions: band-limited noise of unit variance."""

    def __init__(self, seed: int, wavelength: float, count: int = 24) -> None:
        random = np.random.default_rng(seed)
        directions = random.normal(size=(count, 3))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        self._vectors = directions * (2 * np.pi / wavelength) * random.uniform(0.7, 1.3, (count, 1))
        self._phases = random.uniform(0, 2 * np.pi, count)

    def __call__(self, points: Float[Array, "R 3"]) -> Float[Array, " R"]:
        return np.sin(points @ self._vectors.T + self._phases).sum(axis=1) * np.sqrt(2 / len(self._phases))


def plush(points: Float[Array, "R 3"], seed: int = 0) -> Float[Array, "R 3"]:
    """Teal fleece with cream patches, and speckles about 12 mm apart for the tracker to hold on to."""
    patch = np.clip(0.5 + 4.0 * (Waves(seed, 0.055)(points) - 0.5), 0, 1)[:, None]
    fleece = 1 + 0.20 * Waves(seed + 1, 0.016)(points) + 0.16 * Waves(seed + 2, 0.009)(points)
    return np.clip((TEAL * (1 - patch) + CREAM * patch) * np.clip(fleece, 0.35, 1.7)[:, None], 0, 1)


def mitten(points: Float[Array, "R 3"], seed: int = 10) -> Float[Array, "R 3"]:
    """Brick-red wool with faint knitting."""
    return np.clip(MITTEN * (1 + 0.07 * Waves(seed, 0.012)(points))[:, None], 0, 1)


def table(points: Float[Array, "R 3"], seed: int = 20) -> Float[Array, "R 3"]:
    """Wood: fine grain along x and soft blotches."""
    grain = Waves(seed, 0.03)(points * [0.15, 1.0, 1.0])
    return np.clip(TABLE * (1 + 0.07 * grain + 0.05 * Waves(seed + 1, 0.09)(points))[:, None], 0, 1)
