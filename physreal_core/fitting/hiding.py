"""Which particles a hand hides from the camera: it holds some of them, and hardly any that is seen beside it."""

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float
from physreal_core.rendering import Camera


def hidden_by_hand(
    x: Float[Array, "particles 3"],
    camera: Camera,
    hand: Bool[Array, "height width"],
    depth: Float[Array, "height width"] | None = None,
) -> Bool[Array, " particles"]:
    """Particles that are seen through the hand's mask, behind what the camera reads of it.

    Args:
        x: particles [m].
        camera: that sees them.
        hand: its mask.
        depth: along the camera's z [m], 0 where nothing is read, and where the mask alone counts; None without a sensor.
    """
    pixels, far = (own.numpy() for own in camera.project(torch.as_tensor(x, dtype=torch.float64)))
    column, row = np.round(pixels).astype(int).T
    inside = (far > 0) & (row >= 0) & (row < camera.height) & (column >= 0) & (column < camera.width)
    found = np.zeros(len(x), bool)
    row, column = row[inside], column[inside]
    found[inside] = hand[row, column] & (True if depth is None else far[inside] > depth[row, column])
    return found
