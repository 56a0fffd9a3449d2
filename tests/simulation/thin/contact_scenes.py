"""Sheets and ropes in contact, for the tests."""

import numpy as np

from physreal_core.simulation import Body, rod_body, shell_body
from tests.simulation.thin.scenes import sheet


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
