"""The grid: a lattice of nodes that lies in the body at rest, and stays there while the body moves."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.simulation.body import Body, Clamp

CLAMP_DEPTH = 0.25
"""Cells by which the outermost held nodes lie outside a clamp's face, so that the body moves as if held at the face.

Found from the stretch of a hanging bar, whose upper end seems to be held this far behind the last held node.
"""
STENCIL = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(27, 3)
"""Steps from the lowest of a particle's nodes to each of the 27, z fastest."""
ROUNDING = 1e-3
"""Cells by which a body may be larger than a whole number of them."""


@dataclass(frozen=True)
class Lattice:
    """Nodes (i, j, k) at offset + cell (i, j, k), all that a body's particles have a share in.

    Attributes:
        offset: place of node (0, 0, 0) [m], shape [3].
        count: nodes along each axis.
        cell: edge of a cell [m].
    """

    offset: Float[Array, "3"]
    count: tuple[int, int, int]
    cell: float

    def order(self, x0: Float[Array, "particles 3"]) -> Int[Array, " particles"]:
        """Particles at x0 [m] in the order of their cells: those whose 27 nodes are the same follow one another."""
        return np.lexsort(base_nodes(x0, self).T[::-1])

    @property
    def nodes(self) -> int:
        """All of them."""
        return int(np.prod(self.count))


def lattice_of(body: Body, clamps: tuple[Clamp, ...]) -> Lattice:
    """The lattice of a body; the vertices of a thin body are its nodes, in a row.

    Along an axis, whole cells of the splines, as few as hold the body, have its middle in theirs: a cell at its edge that holds a
    single layer of particles would hardly feel how it bends, and a body that is turned over has the same lattice. Where a clamp's
    face cuts the body nodes lie where that asks for them, along the first such face; other faces are rounded to the nearest layer of
    nodes, so they lie up to half a cell off.

    Args:
        body: at rest.
        clamps: boxes in which nodes are held.
    """
    if body.elements is not None:
        return Lattice(body.x0.min(0), (len(body.x0), 1, 1), body.cell)
    lower, upper = body.x0.min(0) - body.spacing / 2, body.x0.max(0) + body.spacing / 2
    cells = np.ceil((upper - lower) / body.cell - ROUNDING)
    anchor = (lower + upper) / 2 - (cells + 1) * body.cell / 2  # nodes lie in the middle of the splines' cells
    for axis in range(3):
        low, high = body.x0[:, axis].min(), body.x0[:, axis].max()
        faces = [(clamp.lower[axis], -CLAMP_DEPTH) for clamp in clamps] + [
            (clamp.upper[axis], CLAMP_DEPTH) for clamp in clamps
        ]
        cutting = [face + depth * body.cell for face, depth in faces if low < face < high]
        if cutting:
            anchor[axis] = cutting[0]
    # a particle has a share in three nodes along an axis; one more on either side is for rounding
    first = np.floor((body.x0.min(0) - anchor) / body.cell - 0.5) - 1
    last = np.floor((body.x0.max(0) - anchor) / body.cell - 0.5) + 3
    return Lattice(anchor + body.cell * first, tuple(int(n) for n in last - first + 1), body.cell)


def base_nodes(x0: Float[Array, "particles 3"], lattice: Lattice) -> Int[Array, "particles 3"]:
    """The lowest of the 27 nodes in which a particle at x0 [m] has a share."""
    return np.floor((x0 - lattice.offset) / lattice.cell - 0.5).astype(np.int64)


def nodes_around(lowest: Int[Array, "particles 3"], lattice: Lattice) -> Int[Array, "particles 27"]:
    """Numbers of the nodes in which particles have a share, by the lowest of each one's, in the order of `STENCIL`."""
    i, j, k = np.moveaxis(lowest[:, None] + STENCIL, -1, 0)
    _, ny, nz = lattice.count
    return (i * ny + j) * nz + k


def held_boxes(clamps: tuple[Clamp, ...], cell: float) -> tuple[Float[Array, "clamps 3"], Float[Array, "clamps 3"]]:
    """Corners of the boxes whose nodes are held [m], each [number of clamps, 3]: to the nearest layer of nodes."""
    reach = (CLAMP_DEPTH + 0.5) * cell
    lower = np.array([clamp.lower for clamp in clamps], dtype=np.float64).reshape(-1, 3)
    upper = np.array([clamp.upper for clamp in clamps], dtype=np.float64).reshape(-1, 3)
    return lower - reach, upper + reach
