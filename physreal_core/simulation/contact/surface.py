"""What a body touches itself with: its surface, how stiff contact is, and which pairs are left out.

Points touch triangles (of a rod: segments), and edges touch edges, where they come nearer than their corners reach: half of a shell's
thickness, a rod's radius, half of the size of a volume's particles. `contact.h` states energy and friction. A pair's stiffness is the mean
Young's modulus of its corners times `size` times the smallest `weight` of its points: `SHARE` of that of a piece of the body as large as a
face, so that contact asks for steps little shorter than the body's own.
"""

from dataclasses import dataclass

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor

SHARE = 0.125
"""Of a shell's membrane stiffness E t, of a rod's E A / l, and of a particle's E h, that a pair has."""
TOUCHING_PAIRS = 12
"""Pairs that act at a vertex from one side, where another lies right above it, each of six triangles."""
LAYER_SPEED = 2e-3
"""Speed [m/s] below which friction between layers is smoothed."""
FINDING = 0.5
"""Of an edge's length: the margin within which pairs are listed."""


PATH = 2.0
"""Contact distances along a thin body within which vertices never touch; nor do vertices that share an edge."""

Near = tuple[Int[Array, " bounds"], Int[Array, " neighbours"]]
"""Of each vertex, itself among them, those that it never touches: bounds [N + 1] and vertices. Of vertices without weight only themselves."""


def never_touching(
    ends: Int[Array, "links 2"], lengths: Float[Array, " links"], path: float, weight: Float[Array, " vertices"]
) -> Near:
    """What hangs together so closely that it never touches.

    Args:
        ends: vertices that hang together.
        lengths: from one end to the other without stress [m].
        path: along links, up to which vertices never touch [m].
        weight: of the vertices, as of `Surface`.
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    count = len(weight)
    one, other = ends.T
    graph = coo_matrix((lengths, (one, other)), shape=(count, count)).tocsr()
    linked = coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(count, count)).tocsr()
    linked = linked + linked.T
    found = [np.array([vertex]) for vertex in range(count)]
    own = np.flatnonzero(weight > 0)
    for rows in np.array_split(own, -(-len(own) // 256)):
        near = dijkstra(graph, directed=False, indices=rows, limit=path) < np.inf
        near |= linked[rows].toarray()
        near &= weight > 0
        for row, vertex in zip(near, rows, strict=True):
            found[vertex] = np.flatnonzero(row)
    bounds = np.concatenate([[0], np.cumsum([len(row) for row in found])])
    return bounds.astype(np.int32), np.concatenate(found).astype(np.int32)


@dataclass(frozen=True)
class Surface:
    """What a body touches itself with.

    Args:
        faces: vertices of triangles or, of rods, of segments, shape [F, 3] or [F, 2].
        edges: vertices of each edge, shape [E, 2].
        reach: of each vertex: how far it stands off what it touches [m], shape [N].
        size: stiffness of a pair over Young's modulus [m].
        weight: of each vertex: its share of area, length or volume over a usual one, shape [N]; zero of one that touches nothing.
        near: what never touches.
        spacing: length of a usual edge [m].
        sides: of a vertex from which it may be touched at once: two of a sheet, one of a volume.
    """

    faces: Int[Array, "faces corners"]
    edges: Int[Array, "edges 2"]
    reach: Float[Array, " vertices"]
    size: float
    weight: Float[Array, " vertices"]
    near: Near
    spacing: float
    sides: int = 2

    @property
    def distance(self) -> float:
        """Below which two vertices may touch [m]."""
        return 2.0 * float(self.reach.max())

    @property
    def margin(self) -> float:
        """Within which pairs are listed [m]."""
        return FINDING * self.spacing

    @property
    def pairs_at_a_vertex(self) -> int:
        """The most that act at one."""
        return TOUCHING_PAIRS * self.sides

    def squared_frequency(
        self, youngs_modulus: Float[Tensor, "*#rollouts vertices"], mass: Float[Tensor, "*#rollouts vertices"]
    ) -> float:
        """Upper bound of the square of the fastest vibration of vertices on contacts [rad2/s2], of many rollouts the largest.

        A pair pushes a vertex and its partner.

        Args:
            youngs_modulus: [Pa].
            mass: of the vertices [kg].
        """
        weight = torch.as_tensor(self.weight, device=mass.device)
        stiffness = self.size * weight * youngs_modulus.detach().double()
        return 2.0 * self.pairs_at_a_vertex * float((stiffness / mass.double()).max())
