"""What the layers of a thin body touch with: its surface, how stiff contact is, and which pairs are left out.

Points touch triangles (of a rod: segments), and edges touch edges, where they come nearer than `distance` between middle surfaces: a shell's
thickness, a rod's diameter. `contact.h` states energy and friction. A pair's stiffness is the mean Young's modulus of its corners times `size`
times the smallest `weight` of its points: `SHARE` of that of a piece of the body as large as a face, so that contact asks for
steps little shorter than the body's own.
"""

from dataclasses import dataclass

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor

SHARE = 0.125
"""Of a shell's membrane stiffness E t, and of a rod's E A / l, that a pair has."""
TOUCHING_PAIRS = 24
"""Pairs that act at a vertex between two others which lie right above and below it, each of six triangles."""
LAYER_SPEED = 2e-3
"""Speed [m/s] below which friction between layers is smoothed."""
FINDING = 0.5
"""Of an edge's length: the margin within which pairs are listed."""
PATH = 2.0
"""Contact distances along the body within which vertices never touch; nor do vertices that share an edge."""


@dataclass(frozen=True)
class Surface:
    """What a thin body touches itself with.

    Args:
        faces: vertices of triangles or, of rods, of segments, shape [F, 3] or [F, 2].
        edges: vertices of each edge, shape [E, 2].
        lengths: of the edges without stress [m], shape [E].
        distance: between middle surfaces or lines, below which they touch [m].
        size: stiffness of a pair over Young's modulus [m].
        weight: of each vertex: its share of area or length over the mean, shape [N].
    """

    faces: Int[Array, "faces corners"]
    edges: Int[Array, "edges 2"]
    lengths: Float[Array, " edges"]
    distance: float
    size: float
    weight: Float[Array, " vertices"]

    @property
    def margin(self) -> float:
        """Within which pairs are listed [m]."""
        return FINDING * float(np.median(self.lengths))

    def neighbours(self) -> tuple[Int[Array, " bounds"], Int[Array, " neighbours"]]:
        """Of each vertex, itself among them, those that hang together with it so closely that they never touch: bounds [N + 1] and
        vertices."""
        from scipy.sparse import coo_matrix
        from scipy.sparse.csgraph import dijkstra

        count = len(self.weight)
        one, other = self.edges.T
        graph = coo_matrix((self.lengths, (one, other)), shape=(count, count)).tocsr()
        linked = coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(count, count)).tocsr()
        linked = linked + linked.T
        found = []
        for first in range(0, count, 256):
            rows = np.arange(first, min(first + 256, count))
            near = dijkstra(graph, directed=False, indices=rows, limit=PATH * self.distance) < np.inf
            near |= linked[rows].toarray()
            found += [np.flatnonzero(row) for row in near]
        bounds = np.concatenate([[0], np.cumsum([len(row) for row in found])])
        return bounds.astype(np.int32), np.concatenate(found).astype(np.int32)

    def squared_frequency(
        self, youngs_modulus: Float[Tensor, "*rollouts vertices"], mass: Float[Tensor, "*rollouts vertices"]
    ) -> float:
        """Upper bound of the square of the fastest vibration of vertices on contacts [rad2/s2], of many rollouts the largest.

        A pair pushes a vertex and its partner; `TOUCHING_PAIRS` of them act at a vertex.

        Args:
            youngs_modulus: [Pa].
            mass: of the vertices [kg].
        """
        weight = torch.as_tensor(self.weight, device=mass.device)
        stiffness = self.size * weight * youngs_modulus.detach().double()
        return 2.0 * TOUCHING_PAIRS * float((stiffness / mass.double()).max())
