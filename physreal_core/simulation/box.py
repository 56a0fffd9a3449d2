"""Where the grid's lattice lies in the world, and the box of its nodes that a frame needs."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.simulation.body import Body, Clamp

CONTACT_DEPTH = 0.85
"""Cells by which the topmost nodes that stop whatever comes down lie below the ground plane.

Particles feel a node from 1.5 cells away: with nodes in the plane itself a body that lands would hover about a cell above it.
Where it lies on the plane already, the layer above these acts too (`touch`), or it would give under pressure. Deeper than this,
how a coarse body falls depends on how the grid lies.
"""
CLAMP_DEPTH = 0.25
"""Cells by which the outermost held nodes lie outside a clamp's face, so that the body moves as if held at the face.

Found from the stretch of a hanging bar, whose upper end seems to be held this far behind the last held node.
"""
LARGEST_EDGE = 400  # nodes; a body that needs more than this has run away
SMALLEST_LIMIT = 1 << 20  # nodes: a grid of 16 MB in float32, so that a small body may fly far


def lattice_offset(body: Body, ground_height: float | None, clamps: tuple[Clamp, ...]) -> Float[Array, "3"]:
    """Position of lattice node (0, 0, 0) [m]: nodes where ground contact and the clamps' faces ask for them.

    Along an axis the lattice follows the ground, else the first clamp face that cuts the body; other faces are rounded
    to the nearest layer of nodes, so they lie up to half a cell off.
    """
    offset = np.zeros(3)
    for axis in range(3):
        low, high = body.x0[:, axis].min(), body.x0[:, axis].max()
        faces = [(clamp.lower[axis], -CLAMP_DEPTH) for clamp in clamps] + [
            (clamp.upper[axis], CLAMP_DEPTH) for clamp in clamps
        ]
        cutting = [face + depth * body.cell for face, depth in faces if low < face < high]
        if cutting:
            offset[axis] = cutting[0]
    if ground_height is not None:
        offset[2] = ground_height - CONTACT_DEPTH * body.cell
    return offset


def largest_box(particles: int) -> int:
    """Nodes of a box beyond which the body in it has run away: 512 times those that it fills, eight particles to a cell."""
    return max(SMALLEST_LIMIT, 64 * particles)


def held_boxes(clamps: tuple[Clamp, ...], cell: float) -> tuple[Float[Array, "clamps 3"], Float[Array, "clamps 3"]]:
    """Corners of the boxes whose nodes are held [m], each [number of clamps, 3]: to the nearest layer of nodes."""
    reach = (CLAMP_DEPTH + 0.5) * cell
    lower = np.array([clamp.lower for clamp in clamps], dtype=np.float64).reshape(-1, 3)
    upper = np.array([clamp.upper for clamp in clamps], dtype=np.float64).reshape(-1, 3)
    return lower - reach, upper + reach


def box_corners(
    lower: Float[Array, "*rollouts 3"],
    upper: Float[Array, "*rollouts 3"],
    margin: Float[Array, "*rollouts"] | float,
    cell: float,
    offset: Float[Array, "3"],
) -> tuple[Float[Array, "*rollouts 3"], Float[Array, "*rollouts 3"]]:
    """First node and number of nodes per axis of the boxes that hold all 27 nodes of every position within `margin` [m] of
    lower .. upper [m], whole numbers, whatever their size.

    Args:
        lower, upper: corners of where the particles are expected [m].
        margin: distance by which they may miss it [m].
        cell: dx [m].
        offset: position of lattice node (0, 0, 0) [m].
    """
    margin = np.asarray(margin)[..., None]
    first = np.floor((lower - margin - offset) / cell - 0.5)
    last = np.floor((upper + margin - offset) / cell - 0.5) + 3
    return first, last - first + 1


def small_enough(count: Float[Array, "*rollouts 3"], largest: int) -> Bool[Array, "*rollouts"] | np.bool_:
    """Whether the bodies in boxes of so many nodes per axis, `largest` of them at most, have not run away."""
    return np.isfinite(count).all(-1) & (count.max(-1) <= LARGEST_EDGE) & (count.prod(-1) <= largest)
