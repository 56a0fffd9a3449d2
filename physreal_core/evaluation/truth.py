"""Scores against known truth (captures of the rig, lab set-ups): vertex error and statics."""

from __future__ import annotations

import numpy as np

from physreal_core.array_types import Array, Bool, Float


def vertex_errors(simulated: Float[Array, "T V 3"], true: Float[Array, "T V 3"]) -> Float[Array, " T"]:
    """Mean distance [m] in each frame between true vertices and where the simulation carries them from frame 0."""
    return np.linalg.norm(simulated - true, axis=-1).mean(axis=-1)


def mean_sag(
    vertices: Float[Array, "T V 3"], hand: Float[Array, "T 3"], frames: int, free: Bool[Array, " V"] | None = None
) -> float:
    """How far [m] the body hangs below the place where moving rigidly with the hand would have put it.

    Mean over the free vertices and the last `frames` frames of -(x_t - x_0 - hand_t + hand_0) . z.

    Args:
        vertices: [m]; hand: position or displacement of the hand [m]; free: vertices that the hand does not hold.
    """
    free = np.ones(vertices.shape[1], bool) if free is None else free
    moved = vertices[-frames:, free, 2] - vertices[0, free, 2]
    carried = hand[-frames:, 2] - hand[0, 2]
    return float((carried[:, None] - moved).mean())


def equivalent_modulus(youngs_modulus: float, sag: float, true_sag: float) -> float | None:
    """The Young's modulus [Pa] with which our simulator would show the truth's static deflection: E * sag / true_sag.

    Linear statics (deflection ~ 1 / E), so exact as the two deflections approach one another; None where either is not
    positive, that is where the body does not hang. It compares materials over two discretisations, each of which is a
    little stiffer or softer than the continuum.
    """
    return youngs_modulus * sag / true_sag if sag > 0 and true_sag > 0 else None


def windowed_mean(values: Float[Array, "T ..."]) -> Array:
    """Mean over time under a Hann window: a swing about rest averages out without knowing its period."""
    weights = np.hanning(len(values) + 2)[1:-1]
    return np.tensordot(weights / weights.sum(), values, axes=1)
