"""A made-up bar that a hand lifts by one end, stops, and that then swings: closed-form motion for tests of `where`."""

import numpy as np

from physreal_core.gap.where.comparison import Comparison
from physreal_core.gap.where.phases import Phases, label_phases, on_ground

FPS, FRAMES, POINTS, STOP = 30.0, 60, 120, 25
SWING = 12.0  # rad/s
NOISE = 0.001


def along(points: int = POINTS) -> np.ndarray:
    """Distance of each point from the hand [m], shape [J]."""
    return np.linspace(0.0, 0.24, points)


def hand(t: np.ndarray) -> np.ndarray:
    """Hand's height [m]: half a cosine up by 0.1 m from frame 5 to `STOP`, then rest."""
    phase = np.clip((t * FPS - 5.0) / (STOP - 5.0), 0.0, 1.0)
    return 0.05 * (1.0 - np.cos(np.pi * phase))


def points(t: np.ndarray, swing: np.ndarray | float = 0.03, lag: np.ndarray | float = 0.0) -> np.ndarray:
    """Points of the bar at times t [s], shape [T, J, 3]: it follows the hand, and swings sideways once that has stopped.

    Args:
        t: shape [T].
        swing: sideways amplitude of the far end [m], may depend on the frame (shape [T]).
        lag: of the swing [s].
    """
    s = along()
    since = np.maximum(t - lag - STOP / FPS, 0.0)
    sideways = swing * np.sin(SWING * since)
    base = np.stack([s, 0.02 * np.sin(40 * s), 0.05 + 0.02 * np.cos(40 * s)], -1)
    x = np.broadcast_to(base, (len(t), POINTS, 3)).copy()
    x[..., 2] += hand(t)[:, None]
    x[..., 1] += sideways[:, None] * (s / s.max()) ** 2
    return x


def times() -> np.ndarray:
    """Frame times [s]."""
    return np.arange(FRAMES) / FPS


def measure(
    truth: np.ndarray, simulated: np.ndarray, seed: int = 0, noise: float = NOISE, modes: np.ndarray | None = None
) -> Comparison:
    """Noise on the true points, a third of them missing; modes [m], shape [M, T, J, 3]."""
    rng = np.random.default_rng(seed)
    valid = rng.random(truth.shape[:2]) > 0.3
    measured = np.where(valid[..., None], truth + noise * rng.standard_normal(truth.shape), np.nan)
    return Comparison(
        simulated, measured, np.full(truth.shape[:2], NOISE), valid, FPS, None if modes is None else modes[:, valid]
    )


def phases(simulated: np.ndarray) -> Phases:
    """Labels of the bar's motion."""
    controllers = np.repeat(hand(times())[:, None, None], 3, 2) * [0.0, 0.0, 1.0]
    return label_phases(
        simulated, FPS, controllers=controllers, held_distance=along(), touching=on_ground(simulated, 0.0, 0.01)
    )
