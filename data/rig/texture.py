"""Procedural surface colours, fixed to the material (rest coordinates), so that they move with it. Linear RGB in 0-1."""

from collections.abc import Callable

import numpy as np

from physreal_core.array_types import Array, Float

TEAL, CREAM, MITTEN = np.array([0.10, 0.42, 0.46]), np.array([0.86, 0.76, 0.58]), np.array([0.78, 0.30, 0.20])
TABLE = np.array([0.42, 0.36, 0.30])
WHITE, SKIN = np.array([0.74, 0.72, 0.70]), np.array([0.72, 0.43, 0.31])
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


def plain(points: Float[Array, "R 3"], seed: int = 0) -> Float[Array, "R 3"]:
    """A table of one colour, which shows no motion."""
    return np.broadcast_to(WHITE, points.shape).copy()


def print_(points: Float[Array, "R 3"], seed: int = 30) -> Float[Array, "R 3"]:
    """Printed cotton: blots of three colours about 4 cm wide over a fine weave."""
    blot, other = Waves(seed, 0.045)(points), Waves(seed + 1, 0.06)(points)
    base = np.where((blot > 0.5)[:, None], [0.62, 0.16, 0.18], [0.80, 0.76, 0.66])
    base = np.where((other > 0.9)[:, None], [0.16, 0.24, 0.48], base)
    return np.clip(base * (1 + 0.10 * Waves(seed + 2, 0.010)(points))[:, None], 0, 1)


def towel(points: Float[Array, "R 3"], seed: int = 40) -> Float[Array, "R 3"]:
    """Green terry with stripes 3 cm apart: along a stripe there is little to hold on to."""
    stripe = 0.5 + 0.5 * np.tanh(4 * np.sin(points[:, :1] * (2 * np.pi / 0.03)))
    base = np.array([0.20, 0.42, 0.24]) * (1 - stripe) + np.array([0.62, 0.72, 0.52]) * stripe
    return np.clip(base * (1 + 0.12 * Waves(seed, 0.012)(points))[:, None], 0, 1)


def rope(points: Float[Array, "R 3"], seed: int = 50) -> Float[Array, "R 3"]:
    """Hemp with coloured yarns: flecks about 9 mm apart."""
    fleck = np.clip(0.5 + 1.5 * Waves(seed, 0.012)(points), 0, 1)[:, None]
    base = np.array([0.16, 0.12, 0.30]) * (1 - fleck) + np.array([0.80, 0.64, 0.34]) * fleck
    return np.clip(base * (1 + 0.10 * Waves(seed + 1, 0.007)(points))[:, None], 0, 1)


def skin(points: Float[Array, "R 3"], seed: int = 60) -> Float[Array, "R 3"]:
    """A bare hand: soft blotches."""
    return np.clip(SKIN * (1 + 0.04 * Waves(seed, 0.02)(points))[:, None], 0, 1)


Paint = Callable[[Float[Array, "R 3"], int], Float[Array, "R 3"]]

PAINTS: dict[str, tuple[Paint, int]] = {
    "plush": (plush, 0),
    "mitten": (mitten, 10),
    "wood": (table, 20),
    "plain": (plain, 0),
    "print": (print_, 30),
    "towel": (towel, 40),
    "rope": (rope, 50),
    "skin": (skin, 60),
}
"""Patterns by name, each with its own first seed."""


def paint(name: str, points: Float[Array, "R 3"], seed: int = 0) -> Float[Array, "R 3"]:
    """Colours of material points [m] in a pattern; another `seed` gives another piece of the same stuff."""
    pattern, first = PAINTS[name]
    return pattern(points, first + 1000 * seed)
