"""The pieces of a closed mesh that do not hang together."""

from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Float, Int
from physreal_core.geometry.mesh import Mesh

TOUCHING = 0.25
"""Spacings between surfaces up to which two parts count as one: those of one object are often modelled apart and barely touch."""
PER_SPACING = 6
"""Sample points of a surface along a spacing, from which distances are taken."""


def separate_pieces(mesh: Mesh, spacing: float) -> list[Mesh]:
    """The parts of a mesh between which there is air, in the order of their first faces.

    Parts that overlap, lie in one another's cavities or come nearer than a quarter of a spacing are one piece.

    Args:
        mesh: closed, [m].
        spacing: between particles [m].
    """
    part = connected_parts(mesh)
    if part.max() == 0:
        return [mesh]
    joined = _joined(mesh, part, spacing)[part]
    _, first = np.unique(joined, return_index=True)
    return [replace(mesh, faces=mesh.faces[joined == joined[face]]) for face in np.sort(first)]


def connected_parts(mesh: Mesh) -> Int[Array, " faces"]:
    """Number of the connected part that each face belongs to."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    one, other = mesh.faces[:, [0, 1]].ravel(), mesh.faces[:, [1, 2]].ravel()
    size = len(mesh.vertices)
    graph = coo_matrix((np.ones(len(one), dtype=bool), (one, other)), shape=(size, size))
    label = connected_components(graph, directed=False)[1][mesh.faces[:, 0]]
    return np.unique(label, return_inverse=True)[1]


def _joined(mesh: Mesh, part: Int[Array, " faces"], spacing: float) -> Int[Array, " parts"]:
    """Label of the piece of each part."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    count = int(part.max()) + 1
    points, owner = _sampled(mesh, part, spacing)
    near = cKDTree(points).query_pairs(TOUCHING * spacing, output_type="ndarray")
    one, other = owner[near].T
    inside = [(a, b) for a in range(count) for b in range(count) if a != b and _lies_in(mesh, part, a, b)]
    pairs = np.concatenate([np.stack([one, other], 1), np.array(inside, dtype=np.int64).reshape(-1, 2)])
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), pairs.T), shape=(count, count))
    return connected_components(graph, directed=False)[1]


def _sampled(mesh: Mesh, part: Array, spacing: float) -> tuple[Float[Array, "points 3"], Int[Array, " points"]]:
    """Points spread over the faces that come near another part's, and the part of each."""
    corners = mesh.corners
    lower, upper = (
        np.stack([f(corners[part == k].reshape(-1, 3), axis=0) for k in range(part.max() + 1)])
        for f in (np.min, np.max)
    )
    reach = TOUCHING * spacing
    low, high = corners.min(1), corners.max(1)
    close = np.zeros(len(part), dtype=bool)
    for k in range(len(lower)):
        close |= (part != k) & ((low <= upper[k] + reach) & (high >= lower[k] - reach)).all(axis=1)
    faces = np.flatnonzero(close)
    longest = np.linalg.norm(corners[faces] - np.roll(corners[faces], 1, axis=1), axis=2).max(1, initial=0.0)
    steps = np.ceil(longest / spacing * PER_SPACING).astype(int)
    points, owner = [np.empty((0, 3))], [np.empty(0, dtype=np.int64)]
    for n in np.unique(steps):
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        weights = np.stack([i, j, n - i - j], -1)[i + j <= n] / max(n, 1)
        own = faces[steps == n]
        points.append((weights @ corners[own]).reshape(-1, 3))
        owner.append(np.repeat(part[own], len(weights)))
    return np.concatenate(points), np.concatenate(owner)


def _lies_in(mesh: Mesh, part: Array, a: int, b: int) -> bool:
    """Whether a vertex of part a lies within part b, by the solid angle of b's faces (van Oosterom and Strackee 1983)."""
    inner, outer = mesh.corners[part == a], mesh.corners[part == b]
    points = np.unique(inner.reshape(-1, 3), axis=0)
    lower, upper = outer.min((0, 1)), outer.max((0, 1))
    points = points[((points > lower) & (points < upper)).all(axis=1)]
    for point in points[:: max(1, len(points) // 50)]:
        r = outer - point
        length = np.linalg.norm(r, axis=2)
        triple = np.einsum("fi,fi->f", r[:, 0], np.cross(r[:, 1], r[:, 2]))
        pairs = [np.einsum("fi,fi->f", r[:, i], r[:, (i + 1) % 3]) * length[:, (i + 2) % 3] for i in range(3)]
        angle = 2.0 * np.arctan2(triple, length.prod(axis=1) + sum(pairs)).sum()
        if abs(angle) > 2.0 * np.pi:
            return True
    return False
