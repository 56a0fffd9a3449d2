"""Sheets of triangles and bent rows of vertices, for benchmarks and tests of thin bodies."""

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
    vertices = np.stack([u.ravel(), v.ravel(), np.full(u.size, height)], 1)
    return vertices, np.concatenate([first, second], 2).reshape(-1, 3)


def wavy_sheet() -> Body:
    """42 vertices over the ground, stretched and bent where the rollout starts."""
    rest, triangles = sheet((5, 6), (0.05, 0.06), 0.003)
    waves = np.sin(90.0 * rest @ np.array([[1.0, 0.3, 0.7], [0.4, 1.0, -0.8], [0.0, 0.0, 0.0]]))
    start = rest + np.array([0.0005, 0.0005, 0.002]) * waves
    return shell_body(start, triangles, 0.002, 300.0, rest, warp=(1.0, 0.3, 0.0))


def wavy_ropes() -> Body:
    """Ropes of 12 and 7 vertices over the ground, stretched and bent where the rollout starts."""
    along = np.linspace(0.0, 1.0, 12)[:, None]
    long = along * np.array([0.06, 0.05, 0.0]) + np.array([0.0, 0.0, 0.005])
    short = long[:7] + np.array([0.02, -0.01, 0.0])
    waves = np.array([0.001, 0.001, 0.002]) * np.sin(np.arange(1, 20)[:, None] * np.array([1.7, 2.3, 1.1]))
    lengths = np.full(17, 0.007) + 0.0005 * np.cos(np.arange(17.0))
    return rod_body(np.concatenate([long, short]) + waves, 0.003, 600.0, lengths, (12, 7))


def stacked_sheets(seed: int = 0, height: float = 0.05, gap: float = 0.95) -> Body:
    """Two crumpled sheets of unlike meshes, one on the other turned against it, `gap` of their thickness apart in the mean."""
    thickness, rng = 0.004, np.random.default_rng(seed)
    lower, first = sheet((4, 3), (0.05, 0.04))
    upper, second = sheet((3, 3), (0.035, 0.035))
    c, s = np.cos(0.4), np.sin(0.4)
    upper = (upper - upper.mean(0)) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]) + lower.mean(0)
    upper[:, 2] += gap * thickness
    rest = np.concatenate([lower, upper]) + np.r_[1e-3, 1e-3, 0.0] * rng.normal(size=(len(lower) + len(upper), 3))
    start = rest + np.r_[1e-4, 1e-4, 2e-4] * rng.normal(size=rest.shape) + [0.0, 0.0, height]
    return shell_body(start, np.concatenate([first, second + len(lower)]), thickness, 300.0, rest)


def crossing_ropes(seed: int = 0, height: float = 0.05, gap: float = 0.98, frames: bool = False) -> Body:
    """A rope across two that lie nearly beside each other, in touch where `gap` diameters are less than one, bent and stretched."""
    rng, count = np.random.default_rng(seed), 8
    along = np.linspace(-0.045, 0.045, count)
    flat = np.zeros(count)
    rows = [
        np.stack([along, flat, flat], 1),
        np.stack([along + 0.004, flat + 0.0085 + 0.02 * along, flat + 0.001], 1),
        np.stack([0.003 + 0.3 * along, along, flat + 0.01 * gap], 1),
    ]
    rest = np.concatenate(rows)
    lengths = np.concatenate([np.linalg.norm(np.diff(row, axis=0), axis=1) for row in rows])
    start = rest + 3e-4 * rng.normal(size=rest.shape) + [0.0, 0.0, height]
    return rod_body(start, 0.005, 600.0, lengths, (count,) * 3, frames)
