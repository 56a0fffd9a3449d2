"""Shells and rods for the tests of thin bodies."""

import numpy as np

from benchmarks.thin_scenes import sheet
from physreal_core.simulation import Body, rod_body, shell_body, untwisted_directors


def crumpled(cells: tuple[int, int] = (4, 3), seed: int = 0, height: float = 0.05) -> Body:
    """A sheet of unequal triangles, already bent and stretched where it starts."""
    vertices, triangles = sheet(cells, (0.012 * cells[0], 0.012 * cells[1]))
    rng = np.random.default_rng(seed)
    rest = vertices + np.r_[0.002, 0.002, 0.0] * rng.normal(size=vertices.shape)
    start = rest + np.r_[0.0005, 0.0005, 0.002] * rng.normal(size=vertices.shape) + np.r_[0.0, 0.0, height]
    return shell_body(start, triangles, 0.002, 300.0, rest, warp=(1.0, 0.3, 0.0))


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


def framed_ropes(counts: tuple[int, ...] = (9, 5), seed: int = 0, height: float = 0.05) -> Body:
    """The same with directors, already twisted where they start."""
    body = ropes(counts, seed, height)
    directors = untwisted_directors(body.x0, counts) + 0.3 * np.random.default_rng(seed).normal(size=body.x0.shape)
    return rod_body(body.x0, 0.003, 600.0, body.elements.rest_lengths, counts, directors=directors)
