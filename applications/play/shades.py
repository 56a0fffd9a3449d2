"""The stretch of the body as colour."""

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.rendering import Binding
from physreal_core.simulation.play import FrameState

FULL = 0.3
"""Strain that has the last colour."""

# From blue over white to red (ColorBrewer RdBu, five of its classes).
_COLOURS = np.array([[5, 113, 176], [146, 197, 222], [247, 247, 247], [244, 165, 130], [202, 0, 32]]) / 255


def stretch_colours(state: FrameState, binding: Binding) -> Float[Array, "points 3"]:
    """Colours of points by the largest principal strain around them: of the Biot strain, largest stretch less one; blue where it is
    zero, red from `FULL` on."""
    stretches = torch.linalg.svdvals(state.F.cpu().double())
    strain = (stretches - 1.0).abs().amax(-1).numpy()
    near, weights = binding.neighbours.numpy(), binding.weights.numpy()
    value = np.clip((strain[near] * weights).sum(1) / weights.sum(1) / FULL, 0.0, 1.0)
    steps = np.linspace(0.0, 1.0, len(_COLOURS))
    return np.stack([np.interp(value, steps, _COLOURS[:, channel]) for channel in range(3)], axis=1)
