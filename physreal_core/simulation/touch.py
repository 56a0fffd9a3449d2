"""Where a body touches the ground: the nodes next to the plane that act, told from the masses on the grid.

Nodes act on what is nearer than a cell and a half: those next to the plane would stop a falling body a cell above it, and those
a layer below them (`box.CONTACT_DEPTH`) give under pressure like a cell of the same material. Therefore the former act where the
body lies on the plane already, and the latter stop what falls. How much of a body's mass the lower ones have beside those next
to the plane says how near it is, at its edges as in its middle, so that every node decides for itself in every substep: decided
once a frame, a motion would jump by what a body falls in one where a parameter moves its landing past a frame's beginning.
The adjoint takes which nodes act as given.
"""

from physreal_core.simulation.box import CONTACT_DEPTH

REACH = 0.1
"""Cells by which the surface of a body may lie above the plane and still touch it."""


def _weight(distance: float) -> float:
    """Of the quadratic B-spline, at so many cells from a node."""
    distance = abs(distance)
    return 0.75 - distance**2 if distance < 0.5 else 0.5 * max(1.5 - distance, 0.0) ** 2


def _share() -> float:
    """Mass of a node of the layer below over that of the one next to the plane, under a body of layers half a cell apart whose
    lower surface is `REACH` above the plane."""
    heights = [CONTACT_DEPTH + REACH + 0.25 + 0.5 * layer for layer in range(5)]  # above the lower nodes
    return sum(map(_weight, heights)) / sum(_weight(height - 1.0) for height in heights)


TOUCHING = _share()
"""Share of its own mass that the node below one next to the plane has where the body touches the plane."""
