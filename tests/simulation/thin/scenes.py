"""Sheets of triangles for the tests of shells."""

import numpy as np

from physreal_core.simulation import Body, rod_body, shell_body


def sheet(cells: tuple[int, int], size: tuple[float, float], height: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices [m] and triangles of a level rectangle from the origin, cut into cells whose diagonals alternate."""
    (m, n), (length, width) = cells, size
    u, v = np.meshgrid(np.linspace(0, length, m + 1), np.linspace(0, width, n + 1), indexing="ij")
    number = np.arange(u.size).reshape(u.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    odd = (np.add(*np.indices((m, n))) % 2 == 1)[..., None]
    first = np.where(odd, np.stack([a, b, d], -1), np.stack([a, b, c], -1))
    second = np.where(odd, np.stack([b, c, d], -1), np.stack([a, c, d], -1))
    return np.stack([u.ravel(), v.ravel(), np.full(u.size, height)], 1), np.concatenate([first, second], 2).reshape(
        -1, 3
    )


def crumpled(
    cells: tuple[int, int] = (4, 3), seed: int = 0, height: float = 0.05, stretch_limit: float | None = None
) -> Body:
    """A sheet of unequal triangles, already bent and stretched where it starts."""
    vertices, triangles = sheet(cells, (0.012 * cells[0], 0.012 * cells[1]))
    rng = np.random.default_rng(seed)
    rest = vertices + np.r_[0.002, 0.002, 0.0] * rng.normal(size=vertices.shape)
    start = rest + np.r_[0.0005, 0.0005, 0.002] * rng.normal(size=vertices.shape) + np.r_[0.0, 0.0, height]
    return shell_body(start, triangles, 0.002, 300.0, rest, warp=(1.0, 0.3, 0.0), stretch_limit=stretch_limit)


def ropes(counts: tuple[int, ...] = (9, 5), seed: int = 0, height: float = 0.05) -> Body:
    """Bent ropes of unequal segments beside each other, already stretched where they start."""
    rng = np.random.default_rng(seed)
    places, lengths = [], []
    for number, count in enumerate(counts):
        step = 0.012 + 0.003 * rng.random(count - 1)
        along = np.concatenate([[0.0], np.cumsum(step)])
        rest = np.stack([along, np.full(count, 0.03 * number), np.full(count, height)], 1)
        places.append(rest + 0.002 * rng.normal(size=rest.shape))
        lengths.append(step)
    return rod_body(np.concatenate(places), 0.003, 600.0, np.concatenate(lengths), counts)
