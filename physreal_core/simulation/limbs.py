"""Limbs of a body: parts that would share nodes of the grid although they hang together only farther away, such as the prongs of a fork.

At a node the particles that have a share in it are of one group if a chain of neighbours among them joins them. Where there are several
groups, the node stands for each of them separately (virtual nodes: Molino, Bao and Fedkiw, ACM Trans. Graph. 23, 2004). Particles of one limb
are never in two groups at a node, so that each limb has a lattice of its own, and nodes of different limbs that stand for one group are tied
(`lattice.py`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.simulation.pieces import CRUMB, NEAR

STENCIL = np.stack(np.meshgrid(*[np.arange(3)] * 3, indexing="ij"), -1).reshape(27, 3)
"""Steps from the lowest of a particle's nodes to each of the 27, z fastest."""

AROUND = 1
"""Layers of cells around a node's own in which the neighbours of a few particles are looked for."""


@dataclass(frozen=True)
class Limbs:
    """Which limb each particle is of, and for which group it is at each of its nodes; `of` finds them.

    Args:
        limb: of each particle, numbers from 0, those of one piece after those of the one before.
        group: of each particle at each of its nodes, in the order of `STENCIL`; equal for one group alone.
    """

    limb: Int[Array, " particles"]
    group: Int[Array, "particles 27"]

    @classmethod
    def of(
        cls,
        x0: Float[Array, "particles 3"],
        lowest: Int[Array, "particles 3"],
        piece: Int[Array, " particles"],
        spacing: float,
    ) -> Limbs:
        """Of particles at rest.

        Args:
            x0: places [m].
            lowest: the lowest of each one's nodes, as steps along the axes in the lattice of its piece.
            piece: of each particle (`pieces.py`).
            spacing: between neighbours [m].
        """
        blobs = _Blobs.of(x0, lowest, piece, spacing)
        groups = _Groups(blobs)
        limb = _numbered(np.stack([blobs.piece, _colours(groups)], 1))
        return cls(limb[blobs.blob], groups.group.reshape(-1, 27)[blobs.blob])


@dataclass(frozen=True)
class _Blobs:
    """Particles with the same nodes that hang together: they are of one group at each of these nodes.

    Args:
        blob: of each particle.
        lowest, piece: of each blob, as of `Limbs.of`.
        size: particles of each.
        centre: of each [m].
        pairs: of neighbours.
    """

    blob: Int[Array, " particles"]
    lowest: Int[Array, "blobs 3"]
    piece: Int[Array, " blobs"]
    size: Int[Array, " blobs"]
    centre: Float[Array, "blobs 3"]
    pairs: Int[Array, "pairs 2"]

    @classmethod
    def of(cls, x0: Array, lowest: Array, piece: Array, spacing: float) -> _Blobs:
        """Of particles, as of `Limbs.of`."""
        from scipy.spatial import cKDTree

        pairs = cKDTree(x0).query_pairs(NEAR * spacing, p=np.inf, output_type="ndarray")
        pairs = pairs[piece[pairs[:, 0]] == piece[pairs[:, 1]]]
        within = (lowest[pairs[:, 0]] == lowest[pairs[:, 1]]).all(1)
        blob = connected_components(_symmetric(pairs[within], len(x0)), directed=False)[1]
        first, size = np.unique(blob, return_index=True, return_counts=True)[1:]
        centre = np.stack([np.bincount(blob, weights=along) for along in x0.T], 1) / size[:, None]
        between = _symmetric(blob[pairs[~within]], len(first)).tocoo()
        linked = np.stack([between.row, between.col], 1)
        return cls(blob, lowest[first], piece[first], size, centre, linked[between.row < between.col].astype(np.int64))


class _Groups:
    """The groups of blobs at the nodes.

    Args:
        blobs: of a body.

    Attributes:
        group: of each blob at each of its nodes, flattened; equal for one group alone.
        node: number of the node of each entry of `group`.
        chain: which blobs are neighbours.
    """

    def __init__(self, blobs: _Blobs) -> None:
        self._blobs, self.chain = blobs, _symmetric(blobs.pairs, len(blobs.size))
        nodes = (blobs.lowest[:, None] + STENCIL).reshape(-1, 3)
        self.node = _numbered(np.concatenate([np.repeat(blobs.piece, 27)[:, None], nodes], 1))
        self.group = _chained(blobs)
        if self.shared.any():
            self._join_crumbs()

    @property
    def shared(self) -> Bool[Array, " entries"]:
        """Whether an entry's node has several groups."""
        both = np.unique(np.stack([self.node, self.group], 1), axis=0)
        return (np.bincount(both[:, 0]) > 1)[self.node]

    def _join_crumbs(self) -> None:
        """Join groups of a few particles with others at their node."""
        order = np.argsort(self.node, kind="stable")
        begin = np.append(0, np.cumsum(np.bincount(self.node)))
        small = np.bincount(self.group, weights=np.repeat(self._blobs.size, 27))[self.group] < CRUMB
        for node in np.unique(self.node[self.shared & small]):
            entries = order[begin[node] : begin[node + 1]]
            self.group[entries] = self._joined(self.group[entries], entries)

    def _joined(self, group: Int[Array, " entries"], entries: Int[Array, " entries"]) -> Int[Array, " entries"]:
        """The groups at one node, where a crumb is of the largest other one that a larger region joins it with; what is a crumb there, too, is
        of the nearest."""
        here, found, size = entries // 27, group.copy(), self._blobs.size
        part, large = self._around(int(here[0]), int(entries[0]) % 27)
        numbers, sizes = np.unique(group, return_inverse=True)
        for crumb in numbers[np.bincount(sizes, weights=size[here]) < CRUMB]:
            own = group == crumb
            one = here[own][0]
            others = ~own & (part[here] == part[one]) if large[one] else ~own
            if others.any():
                among = found[others]
                kin = (
                    np.bincount(among, weights=size[here[others]]).argmax()
                    if large[one]
                    else among[self._nearest(here, own, others)]
                )
                found[found == crumb] = kin
        return found

    def _around(self, blob: int, slot: int) -> tuple[Int[Array, " blobs"], Bool[Array, " blobs"]]:
        """Parts of the region around a blob's node, as numbers of the blobs in it, and whether a blob's part is larger than a crumb."""
        lowest, piece = self._blobs.lowest, self._blobs.piece
        middle = lowest[blob] + STENCIL[slot] - 1  # of the lowest nodes of those that have a share
        near = np.flatnonzero((np.abs(lowest - middle) <= 1 + AROUND).all(1) & (piece == piece[blob]))
        found = connected_components(self.chain[near][:, near], directed=False)[1]
        part, large = np.full(len(lowest), -1), np.zeros(len(lowest), dtype=bool)
        part[near] = found
        large[near] = np.bincount(found, weights=self._blobs.size[near])[found] >= CRUMB
        return part, large

    def _nearest(self, here: Array, own: Array, others: Array) -> int:
        centre = self._blobs.centre
        apart = centre[here[others]][:, None] - centre[here[own]]
        return int((apart**2).sum(-1).min(1).argmin())


def _numbered(rows: Int[Array, "rows columns"]) -> Int[Array, " rows"]:
    """Equal rows have equal numbers, from 0, in the order of the rows."""
    key = np.zeros(len(rows), dtype=np.int64)
    for column in rows.T if len(rows) else ():
        key = key * (int(np.ptp(column)) + 1) + column - column.min()
    return np.unique(key, return_inverse=True)[1].ravel()


def _symmetric(pairs: Int[Array, "pairs 2"], count: int) -> csr_matrix:
    both = np.concatenate([pairs, pairs[:, ::-1]])
    return csr_matrix((np.ones(len(both), dtype=bool), both.T), shape=(count, count))


def _chained(blobs: _Blobs) -> Int[Array, " entries"]:
    """Groups of the entries, blob by blob: neighbours are of one at every node that both have a share in."""
    one, other = blobs.pairs.T
    step = blobs.lowest[other] - blobs.lowest[one]
    links, way_of = [np.zeros((0, 2), dtype=np.int64)], _numbered(step)
    for number in range(int(way_of.max(initial=-1)) + 1):
        own = np.flatnonzero(way_of == number)
        there = STENCIL - step[own[0]]
        slots = np.flatnonzero(((there >= 0) & (there <= 2)).all(1))
        others = there[slots] @ [9, 3, 1]
        links.append(np.stack([27 * one[own, None] + slots, 27 * other[own, None] + others], -1).reshape(-1, 2))
    linked, size = np.concatenate(links), 27 * len(blobs.size)
    graph = coo_matrix((np.ones(len(linked), dtype=bool), linked.T), shape=(size, size))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _colours(groups: _Groups) -> Int[Array, " blobs"]:
    """A colour for each blob, so that at no node two groups have the same; that of most neighbours or the smallest, in the order of a walk through the
    body."""
    count, entries = len(groups.group) // 27, np.flatnonzero(groups.shared)
    colour = np.zeros(count, dtype=np.int64)
    if not len(entries):
        return colour
    apart, torn = _apart(groups, entries, count), np.unique(entries // 27)
    colour[torn] = -1
    for first in torn.tolist():
        walk = breadth_first_order(groups.chain, first, directed=False, return_predecessors=False)
        for own in walk.tolist() if colour[first] < 0 else ():
            if colour[own] < 0:
                colour[own] = _colour_of(colour[_row(apart, own)], colour[_row(groups.chain, own)])
    return colour


def _colour_of(refused: Int[Array, " refused"], around: Int[Array, " around"]) -> int:
    """The colour that most neighbours have of those that are not refused, or else the smallest that is not."""
    often = np.bincount(around[around >= 0], minlength=1)
    often[refused[(refused >= 0) & (refused < len(often))]] = 0
    return int(often.argmax()) if often.any() else int(np.setdiff1d(np.arange(len(refused) + 1), refused)[0])


def _apart(groups: _Groups, entries: Int[Array, " entries"], count: int) -> csr_matrix:
    """Pairs of blobs that are of different groups at one node at least."""
    node = np.unique(groups.node[entries], return_inverse=True)[1]
    both = _numbered(np.stack([groups.node[entries], groups.group[entries]], 1))
    shares = [
        csr_matrix((np.ones(len(entries), dtype=np.int32), (entries // 27, label)), shape=(count, label.max() + 1))
        for label in (node, both)
    ]
    at_nodes, in_groups = (own @ own.T for own in shares)
    found = csr_matrix(at_nodes - in_groups)
    found.eliminate_zeros()
    return found


def _row(matrix: csr_matrix, number: int) -> Int[Array, " columns"]:
    return matrix.indices[matrix.indptr[number] : matrix.indptr[number + 1]]
