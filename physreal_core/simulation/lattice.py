"""The grid: a lattice of nodes that lies in the body at rest, and stays there while the body moves.

Pieces of a body that are not connected (`pieces.py`) have nodes of their own, so that they move apart, and so have the limbs of a piece
(`limbs.py`): each lies in a lattice as if it were alone, and these lattices stand one behind another along an axis. So a place on the grid is
a place in the body at rest but for its limb's shift. Where limbs meet, nodes of several lattices stand for one: they are its copies, which
have the sum of what particles give to any of them.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.simulation.body import Body, Clamp
from physreal_core.simulation.limbs import STENCIL, Limbs

CLAMP_DEPTH = 0.25
"""Cells by which the outermost held nodes lie outside a clamp's face, so that the body moves as if held at the face.

Found from the stretch of a hanging bar, whose upper end seems to be held this far behind the last held node.
"""
ROUNDING = 1e-3
"""Cells by which a body may be larger than a whole number of them."""


@dataclass(frozen=True)
class Lattice:
    """Nodes (i, j, k) at offset + cell (i, j, k), all that a body's particles have a share in.

    Attributes:
        offset: place of node (0, 0, 0) [m], shape [3].
        count: nodes along each axis.
        cell: edge of a cell [m].
        place: where each particle lies on the grid [m], shape [N, 3].
        limb: of each particle, shape [N].
        piece: of each of the K limbs, shape [K].
        shift: by which each limb is laid aside [m], shape [K, 3].
        axis: along which the limbs' lattices stand one behind another.
        begin: first layer of each along that axis, and the end, shape [K + 1].
        copies: numbers of nodes that stand for one, ascending, shape [G, C]; a row that has less is filled up with -1.
    """

    offset: Float[Array, "3"]
    count: tuple[int, int, int]
    cell: float
    place: Float[Array, "particles 3"]
    limb: Int[Array, " particles"]
    piece: Int[Array, " limbs"]
    shift: Float[Array, "limbs 3"]
    axis: int
    begin: Int[Array, " bounds"]
    copies: Int[Array, "groups copies"]

    def order(self, place: Float[Array, "particles 3"]) -> Int[Array, " particles"]:
        """Particles at `place` [m] in the order of their cells: those whose 27 nodes are the same follow one another."""
        return np.lexsort(base_nodes(place, self).T[::-1])

    @property
    def nodes(self) -> int:
        """All of them."""
        return int(np.prod(self.count))

    @property
    def first_copy(self) -> Int[Array, " nodes"]:
        """Of each node the first of its copies; itself where it has none."""
        first = np.arange(self.nodes)
        row, column = np.nonzero(self.copies >= 0)
        first[self.copies[row, column]] = self.copies[row, 0]
        return first

    @property
    def next_copy(self) -> Int[Array, " nodes"]:
        """Of each node the copy after it; -1 where there is none."""
        following = np.full(self.nodes, -1)
        row, column = np.nonzero(self.copies[:, 1:] >= 0)
        following[self.copies[row, column]] = self.copies[row, column + 1]
        return following

    def nodes_of_pieces(self) -> tuple[Int[Array, " nodes"], Float[Array, "nodes 3"]]:
        """The piece of each node, and where the node lies in the body at rest [m]."""
        index = np.stack(np.meshgrid(*map(np.arange, self.count), indexing="ij"), -1).reshape(-1, 3)
        limb = np.searchsorted(self.begin, index[:, self.axis], side="right") - 1
        return self.piece[limb], self.offset + self.cell * index - self.shift[limb]


def lattice_of(body: Body, clamps: tuple[Clamp, ...]) -> Lattice:
    """The lattice of a body; the vertices of a thin body are its nodes, in a row.

    Args:
        body: at rest.
        clamps: boxes in which nodes are held.
    """
    if body.elements is not None:
        first, count, whole = body.x0.min(0), len(body.x0), np.zeros(len(body.x0), dtype=np.int64)
        alone = (whole, whole[:1], np.zeros((1, 3)), 0, np.array([0, count]), np.zeros((0, 2), dtype=np.int64))
        return Lattice(first, (count, 1, 1), body.cell, body.x0, *alone)
    pieces = [_first_node(body.x0[body.piece == k], body, clamps) for k in range(body.piece.max() + 1)]
    origin = np.array(pieces)
    lowest = np.floor((body.x0 - origin[body.piece]) / body.cell - 0.5).astype(np.int64)
    limbs = Limbs.of(body.x0, lowest, body.piece, body.spacing)
    limb, number = limbs.limb, np.arange(limbs.limb.max() + 1)
    piece = body.piece[np.unique(limb, return_index=True)[1]]
    # a particle has a share in three nodes along an axis; one more on either side is for rounding
    first = np.array([lowest[limb == k].min(0) - 1 for k in number])
    counts = np.array([lowest[limb == k].max(0) + 4 for k in number]) - first
    offsets, largest, total = origin[piece] + body.cell * first, counts.max(0), counts.sum(0)
    axis = int(np.argmin(total / largest))  # where they stand in the fewest nodes
    begin = np.concatenate([[0], np.cumsum(counts[:, axis])])
    stands = np.zeros_like(first)
    stands[:, axis] = begin[:-1]
    shift = offsets[0] + body.cell * stands - offsets
    count = tuple(int(total[a] if a == axis else largest[a]) for a in range(3))
    on_grid = lowest - first[limb] + stands[limb]
    copies = _copies(limbs.group, _numbers(on_grid, count))
    return Lattice(offsets[0], count, body.cell, body.x0 + shift[limb], limb, piece, shift, axis, begin, copies)


def _copies(group: Int[Array, "particles 27"], nodes: Int[Array, "particles 27"]) -> Int[Array, "groups copies"]:
    """The nodes of each group that has several, as of `Lattice.copies`."""
    group, node = np.divmod(np.unique(group.ravel() * (nodes.max() + 1) + nodes.ravel()), nodes.max() + 1)
    _, begin, sizes = np.unique(group, return_index=True, return_counts=True)
    found = np.full((int((sizes > 1).sum()), max(2, sizes.max())), -1, dtype=np.int64)
    for row, (first, size) in zip(found, zip(begin[sizes > 1], sizes[sizes > 1], strict=True), strict=True):
        row[:size] = node[first : first + size]
    return found


def _first_node(x0: Float[Array, "particles 3"], body: Body, clamps: tuple[Clamp, ...]) -> Float[Array, "3"]:
    """Place of the first node [m] of a piece at x0.

    Along an axis, whole cells of the splines, as few as hold the piece, have its middle in theirs: a cell at its edge that holds a
    single layer of particles would hardly feel how it bends, and a body that is turned over has the same lattice. Where a clamp's
    face cuts the piece nodes lie where that asks for them, along the first such face; other faces are rounded to the nearest layer of
    nodes, so they lie up to half a cell off.
    """
    lower, upper = x0.min(0) - body.spacing / 2, x0.max(0) + body.spacing / 2
    cells = np.ceil((upper - lower) / body.cell - ROUNDING)
    anchor = (lower + upper) / 2 - (cells + 1) * body.cell / 2  # nodes lie in the middle of the splines' cells
    for axis in range(3):
        low, high = x0[:, axis].min(), x0[:, axis].max()
        faces = [(clamp.lower[axis], -CLAMP_DEPTH) for clamp in clamps] + [
            (clamp.upper[axis], CLAMP_DEPTH) for clamp in clamps
        ]
        cutting = [face + depth * body.cell for face, depth in faces if low < face < high]
        if cutting:
            anchor[axis] = cutting[0]
    return anchor + body.cell * (np.floor((x0.min(0) - anchor) / body.cell - 0.5) - 1)


def particle_order(body: Body, lattice: Lattice) -> Int[Array, " particles"]:
    """The particle at each place in the order in which the step keeps them: by their cells; the vertices of a thin body stay as they are."""
    return np.arange(len(body.x0)) if body.elements is not None else lattice.order(lattice.place)


def base_nodes(place: Float[Array, "particles 3"], lattice: Lattice) -> Int[Array, "particles 3"]:
    """The lowest of the 27 nodes in which a particle at a place on the grid [m] has a share."""
    return np.floor((place - lattice.offset) / lattice.cell - 0.5).astype(np.int64)


def nodes_around(lowest: Int[Array, "particles 3"], lattice: Lattice) -> Int[Array, "particles 27"]:
    """Numbers of the nodes in which particles have a share, by the lowest of each one's, in the order of `STENCIL`."""
    return _numbers(lowest, lattice.count)


def _numbers(lowest: Int[Array, "particles 3"], count: tuple[int, int, int]) -> Int[Array, "particles 27"]:
    i, j, k = np.moveaxis(lowest[:, None] + STENCIL, -1, 0)
    _, ny, nz = count
    return (i * ny + j) * nz + k


def held_boxes(
    clamps: tuple[Clamp, ...], lattice: Lattice, thin: bool
) -> tuple[Float[Array, "boxes 3"], Float[Array, "boxes 3"]]:
    """Corners of the boxes on the grid whose nodes are held [m]: to the nearest layer of nodes. Of several limbs a clamp holds those that
    reach into it, and with them the copies of their nodes.

    Args:
        clamps: in the body at rest.
        lattice: its grid.
        thin: whether the nodes are vertices, held where the clamps say.
    """
    reach = 0.0 if thin else (CLAMP_DEPTH + 0.5) * lattice.cell
    lower = np.array([clamp.lower for clamp in clamps], dtype=np.float64).reshape(-1, 3) - reach
    upper = np.array([clamp.upper for clamp in clamps], dtype=np.float64).reshape(-1, 3) + reach
    if len(lattice.shift) == 1:
        return lower, upper
    x0, half = lattice.place - lattice.shift[lattice.limb], (0.25 + ROUNDING) * lattice.cell  # of a particle's cube
    inside = (x0[:, None] + half >= lower + reach) & (x0[:, None] - half <= upper - reach)  # [N, clamps, 3]
    particle, clamp = np.nonzero(inside.all(-1))
    limb, clamp = np.unique(np.stack([lattice.limb[particle], clamp]), axis=1)
    lower, upper = (corner[clamp] + lattice.shift[limb] for corner in (lower, upper))
    ends = lattice.offset[lattice.axis] + lattice.cell * (lattice.begin - 0.5)  # between the limbs' nodes
    lower[:, lattice.axis] = np.maximum(lower[:, lattice.axis], ends[limb])
    upper[:, lattice.axis] = np.minimum(upper[:, lattice.axis], ends[limb + 1])
    return lower, upper
