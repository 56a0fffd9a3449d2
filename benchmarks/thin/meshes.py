"""Flat sheets of triangles."""

import numpy as np


def rectangle(cells: tuple[int, int], size: tuple[float, float], height: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] and triangles of a level rectangle from the origin, cut into cells whose diagonals go one way."""
    (m, n), (length, width) = cells, size
    u, v = np.meshgrid(np.linspace(0, length, m + 1), np.linspace(0, width, n + 1), indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    triangles = np.concatenate([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], 2).reshape(-1, 3)
    return np.stack([u.ravel(), v.ravel(), np.full(u.size, height)], 1), triangles


def scattered(vertices: np.ndarray, share: float, seed: int = 0, kept: np.ndarray | None = None) -> np.ndarray:
    """The vertices of a rectangle, those inside moved at random in its plane by up to a share of its cells.

    Args:
        vertices: of `rectangle`.
        share: of a cell.
        seed: of the random moves.
        kept: vertices that stay, besides those at the edges.
    """
    x, y = vertices[:, 0], vertices[:, 1]
    inside = (x > x.min() + 1e-9) & (x < x.max() - 1e-9) & (y > y.min() + 1e-9) & (y < y.max() - 1e-9)
    if kept is not None:
        inside &= ~kept
    cell = np.array([np.diff(np.unique(values.round(9))).min() for values in (x, y)])
    moved = vertices.copy()
    moved[inside, :2] += share * cell * np.random.default_rng(seed).uniform(-1.0, 1.0, (int(inside.sum()), 2))
    return moved
