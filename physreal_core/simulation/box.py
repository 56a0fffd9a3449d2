"""The box of grid nodes that a frame needs: the particles' extent, where their velocities take it, and a margin."""

import math
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float

LARGEST_EDGE = 400  # nodes; a body that needs more than this has run away


@dataclass(frozen=True)
class GridBox:
    """Nodes origin .. origin + count - 1 of the world-fixed lattice, per axis."""

    origin: tuple[int, int, int]
    count: tuple[int, int, int]

    @property
    def nodes(self) -> int:
        return math.prod(self.count)


def grid_box(
    lower: Float[Array, "3"], upper: Float[Array, "3"], margin: float, cell: float, offset: Float[Array, "3"]
) -> GridBox | None:
    """Box that holds all 27 nodes of every position within `margin` [m] of lower .. upper; None if it is too large.

    Args:
        lower, upper: corners of where the particles are expected [m].
        margin: distance by which they may miss it [m].
        cell: dx [m].
        offset: position of lattice node (0, 0, 0) [m].
    """
    first = np.floor((lower - margin - offset) / cell - 0.5)
    last = np.floor((upper + margin - offset) / cell - 0.5) + 3
    count = last - first + 1
    if not np.isfinite(count).all() or count.max() > LARGEST_EDGE:
        return None
    return GridBox(tuple(int(i) for i in first), tuple(int(c) for c in count))
