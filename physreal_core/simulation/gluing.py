"""Parts of a body that share nodes of the grid although they hang together only farther away: legs side by side, the prongs of a fork.

The grid joins what lies within its reach, so such parts move as if they were glued.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Int
from physreal_core.simulation.body import Body
from physreal_core.simulation.lattice import base_nodes, lattice_of
from physreal_core.simulation.pieces import CRUMB, NEAR

REACH = 2
"""Steps along each axis between the lowest nodes of two particles up to which they share nodes."""

PARTED = 5.0
"""Spacings of air from which on two parts share no node, however the lattice lies: three cells between their outermost particles."""


@dataclass(frozen=True)
class Glued:
    """Where a volume is joined through the air.

    Attributes:
        particles: which share nodes with another part.
        gap: least air between two such parts [m]; infinite where there are none.
    """

    particles: Bool[Array, " particles"]
    gap: float

    @property
    def parting(self) -> float:
        """Spacing that parts them [m]."""
        return self.gap / PARTED


def glued(body: Body) -> Glued:
    """Of a volume at rest. Two particles are of one part if a chain of neighbours leads from one to the other within the reach of the grid."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    lattice = lattice_of(body, ())
    lowest, tree = base_nodes(lattice.place, lattice), cKDTree(body.x0)
    beside = tree.query_pairs(NEAR * body.spacing, p=np.inf, output_type="ndarray")
    chain = coo_matrix((np.ones(len(beside), bool), beside.T), shape=(len(lowest),) * 2).tocsr()
    cells, cell = np.unique(lowest, axis=0, return_inverse=True)
    members = _members(cell.ravel(), len(cells))
    found, gap = np.zeros(len(lowest), bool), np.inf
    for own, around in enumerate(cKDTree(cells).query_ball_point(cells, REACH, p=np.inf)):
        near = np.concatenate([members[number] for number in around])
        count, part = connected_components(chain[near][:, near], directed=False)
        large = np.flatnonzero(np.bincount(part, minlength=count) >= CRUMB)
        if len(large) < 2:
            continue
        here = np.isin(near, members[own])
        for one in large:
            if not here[part == one].any():
                continue
            others = near[np.isin(part, large) & (part != one)]
            found[near[here & (part == one)]] = True
            gap = min(gap, cKDTree(body.x0[near[part == one]]).query(body.x0[others])[0].min() - body.spacing)
    return Glued(found, float(gap))


def _members(label: Int[Array, " particles"], count: int) -> list[Int[Array, " members"]]:
    """Numbers of the particles with each label."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.cumsum(np.bincount(label, minlength=count))[:-1])
