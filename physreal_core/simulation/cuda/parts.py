"""Which particles leave their shares together, and which of these parts are a node's (parts.h)."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Int
from physreal_core.simulation.lattice import Lattice, nodes_around

WARP = 32  # threads; those of one rollout begin with a warp of their own
LARGEST_GROUP = 8  # particles, as many as a cell holds at the usual spacing
NODE_THREADS = 8  # of a GPU for each node, which has some forty parts


@dataclass(frozen=True)
class Parts:
    """The groups of a body's particles, in the order of their cells, and the nodes' parts.

    A group is a run of at most `LARGEST_GROUP` particles in one warp with the same 27 nodes.

    Args:
        group: of each particle.
        following: particles that come after it in its group.
        begin: number of each node's first part, and of the end of the last.
        of_nodes: for each part of a node, the group that leaves it.
        which: and which of the group's 27 it is.
    """

    group: Int[Array, " particles"]
    following: Int[Array, " particles"]
    begin: Int[Array, " bounds"]
    of_nodes: Int[Array, " parts"]
    which: Int[Array, " parts"]

    @property
    def groups(self) -> int:
        """Number of all."""
        return int(self.group[-1]) + 1

    @classmethod
    def of(cls, base: Int[Array, "particles 3"], lattice: Lattice) -> "Parts":
        """Those of particles, by the lowest of each one's nodes, where equal ones follow one another."""
        number = np.arange(len(base))
        begins = np.append(True, (base[1:] != base[:-1]).any(1)) | (number % WARP == 0)
        place = number - np.maximum.accumulate(np.where(begins, number, 0))  # in its run
        heads = place % LARGEST_GROUP == 0
        group = np.cumsum(heads) - 1
        following = np.bincount(group)[group] - place % LARGEST_GROUP - 1
        part, nodes = _given_to_copies(nodes_around(base[heads], lattice).ravel(), lattice)
        order = np.argsort(nodes, kind="stable")
        begin = np.searchsorted(nodes[order], np.arange(lattice.nodes + 1))
        return cls(group, following, begin, part[order] // 27, part[order] % 27)


def _given_to_copies(
    nodes: Int[Array, " parts"], lattice: Lattice
) -> tuple[Int[Array, " given"], Int[Array, " given"]]:
    """Numbers of parts and the nodes that they are given to: the node of each, and with it all of its copies; of one node in the order of the
    parts."""
    first, following = lattice.first_copy[nodes], lattice.next_copy
    part, given = np.arange(len(nodes)), [(np.arange(len(nodes)), first)]
    while len(part):
        part, node = given[-1]
        more = following[node] >= 0
        part, node = part[more], following[node[more]]
        given.append((part, node))
    part, node = (np.concatenate(columns) for columns in zip(*given, strict=True))
    order = np.argsort(part, kind="stable")
    return part[order], node[order]


def threads_of(particles: int) -> int:
    """Threads of a rollout's particles: whole warps."""
    return -(-particles // WARP) * WARP
