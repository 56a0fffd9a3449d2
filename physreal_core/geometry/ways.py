"""Distances along a thin body: along its surface or its line, so that layers that lie on each other are far apart."""

import numpy as np
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from physreal_core.array_types import Array, Float, Int


def ways_of(cells: Int[Array, "cells corners"]) -> Int[Array, "ways 2"]:
    """Pairs of vertices between which one goes straight: ends of segments, or of the edges of triangles and the two corners
    on both sides of an edge, without which a way across a surface would be up to 15 % too long.

    Args:
        cells: vertices of segments [S, 2] or of triangles [M, 3].
    """
    if cells.shape[1] == 2:
        return np.asarray(cells, np.int64)
    pairs, number = edges_of(cells)
    opposite, order = np.asarray(cells, np.int64).ravel(), np.argsort(number, axis=None, kind="stable")
    shared = np.flatnonzero(np.diff(number.ravel()[order]) == 0)
    across = np.stack([opposite[order[shared]], opposite[order[shared + 1]]], axis=1)
    return np.concatenate([pairs, across])


def edges_of(triangles: Int[Array, "triangles 3"]) -> tuple[Int[Array, "edges 2"], Int[Array, "triangles 3"]]:
    """Edges, the vertex of the lower number first, and the number of the edge opposite to each corner."""
    sides = np.sort(np.asarray(triangles, np.int64)[:, [[1, 2], [2, 0], [0, 1]]], axis=2)
    count = int(sides.max()) + 1
    keys, number = np.unique(sides[..., 0] * count + sides[..., 1], return_inverse=True)
    return np.stack([keys // count, keys % count], axis=1), number.reshape(-1, 3)


def graph_of(x0: Float[Array, "vertices 3"], ways: Int[Array, "ways 2"]) -> csr_matrix:
    """The ways with their lengths [m], as scipy's graphs want them."""
    length = np.linalg.norm(x0[ways[:, 0]] - x0[ways[:, 1]], axis=1)
    return csr_matrix((length, (ways[:, 0], ways[:, 1])), shape=(len(x0), len(x0)))


def distances_along(
    x0: Float[Array, "vertices 3"], ways: Int[Array, "ways 2"], sources: Int[Array, " sources"]
) -> Float[Array, "vertices sources"]:
    """Length [m] of the shortest way from each source to each vertex; infinite where there is none.

    Args:
        x0: where the vertices are [m].
        ways: pairs between which one goes straight (`ways_of`).
        sources: vertices.
    """
    return dijkstra(graph_of(x0, ways), directed=False, indices=np.asarray(sources)).T
