"""The free end of the body: the points that lie farthest from the hand, and how they move against it."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from pipeline.products.free_end import FreeEnd

SHARE = 0.2
"""Of the tracks, those farthest from the hand; without a hand, those that move most."""


def free_end(
    fps: float,
    measured: Float[Array, "T J 3"],
    valid: Bool[Array, "T J"],
    controllers: Float[Array, "T C 3"],
    simulated: Float[Array, "M T J 3"],
) -> FreeEnd | None:
    """The motion of the free end; None where none of its points is known in frame 0 and in another one.

    Args:
        fps: frames per second.
        measured: tracks [m]; anything where they are not valid.
        valid: which entries were measured.
        controllers: the hand's points [m]; C may be 0.
        simulated: the same points in M models [m].
    """
    known = valid & valid[0]
    moved = np.where(known[..., None], measured - measured[0], 0.0)
    chosen = _farthest(measured[0], moved, known, controllers)
    known, count = known[:, chosen], known[:, chosen].sum(1)
    if (count[1:] == 0).all():
        return None
    hand = (controllers - controllers[0]).mean(1) if controllers.shape[1] else np.zeros((len(measured), 3))

    def mean(motion: Float[Array, "T J 3"]) -> Float[Array, "T 3"]:
        total = np.where(known[..., None], motion[:, chosen], 0.0).sum(1)
        return np.where(count[:, None] > 0, total / np.maximum(count, 1)[:, None], np.nan) - hand

    own = mean(moved)
    direction = _main_direction(own[count > 0])
    models = [mean(motion - motion[0]) @ direction for motion in simulated]
    return FreeEnd(np.arange(len(own)) / fps, direction, own @ direction, np.array(models).reshape(-1, len(own)))


def _farthest(points0: Array, moved: Array, known: Array, controllers: Array) -> Bool[Array, " J"]:
    """The share of the points in frame 0 that lies farthest from the hand, or moves most."""
    if controllers.shape[1]:
        gaps = np.linalg.norm(points0[:, None] - controllers[0], axis=2).min(1)
    else:
        gaps = np.linalg.norm(moved, axis=2).max(0)
    gaps = np.where(known[0], gaps, -np.inf)
    count = max(1, round(SHARE * known[0].sum()))
    return (gaps >= np.sort(gaps)[-count]) & known[0]


def _main_direction(motion: Float[Array, "T 3"]) -> Float[Array, "3"]:
    """Of largest variance, upwards (or along x, where it is level)."""
    _, _, axes = np.linalg.svd(motion - motion.mean(0))
    axis = axes[0]
    return axis if (axis[2], axis[0]) > (0.0, 0.0) else -axis
