"""Which particles of a volume hang together, and where it is too thin for its spacing.

Particles beside each other in a lattice of the spacing are connected, over its diagonals too. What is not connected falls apart, unless it is
smaller than two particles along each axis: such a crumb belongs to what is nearest.
"""

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError

NEAR = 1.4
"""Spacings along each axis up to which particles are connected: between those of a lattice, 1, and those of two blocks with half a spacing
of air between them, 1.5."""
CRUMB, CRUMB_REACH = 8, 1.8
"""Particles below which a piece is joined to what lies within so many spacings: a limb thinner than the spacing has one in so many."""
AROUND, LAYER = 2.5, 0.12
"""Of the particles within AROUND spacings the smallest principal variance, in squares of the spacing: 0 of one layer, 0.25 of two, 0.37
below a plane face. Below LAYER the body is one particle thick there."""
THIN_SHARE = 0.5
"""Share of the volume from which on a body that is one particle thick is refused."""


def pieces_of(x0: Float[Array, "particles 3"], spacing: float) -> Int[Array, " particles"]:
    """Number of each particle's piece, from 0, in the order of their first particles.

    Args:
        x0: particles at rest [m].
        spacing: between neighbours [m].
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(x0)
    label = _connected(len(x0), tree.query_pairs(NEAR * spacing, p=np.inf, output_type="ndarray"))
    small = np.bincount(label)[label] < CRUMB
    if label.max() == 0 or not small.any():
        return label
    pairs = tree.query_pairs(CRUMB_REACH * spacing, output_type="ndarray")
    pairs = pairs[small[pairs].any(axis=1)]
    return _connected(len(x0), np.concatenate([label[pairs], [[0, 0]]]), label)


def _connected(count: int, pairs: Int[Array, "pairs 2"], label: Int[Array, " particles"] | None = None) -> Array:
    """Components of a graph, numbered in the order of their first members; of the groups `label` where it is given."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    size = count if label is None else int(label.max()) + 1
    graph = coo_matrix((np.ones(len(pairs), dtype=bool), (pairs[:, 0], pairs[:, 1])), shape=(size, size))
    found = connected_components(graph, directed=False)[1]
    return numbered(found if label is None else found[label])


def numbered(label: Int[Array, " particles"]) -> Int[Array, " particles"]:
    """Labels as numbers from 0 in the order in which they first occur."""
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse].astype(np.int64)


def one_particle_thick(x0: Float[Array, "particles 3"], spacing: float) -> Bool[Array, " particles"]:
    """Whether the body is one particle thick in some direction around each particle.

    Args:
        x0: particles at rest [m].
        spacing: between neighbours [m].
    """
    from scipy.spatial import cKDTree

    pairs = cKDTree(x0).query_pairs(AROUND * spacing, output_type="ndarray")
    one, other = np.concatenate([pairs, pairs[:, ::-1]]).T
    way = (x0[other] - x0[one]) / spacing
    number = 1.0 + np.bincount(one, minlength=len(x0))  # with the particle itself
    columns = np.c_[way, way[:, [0, 1, 2, 0, 1, 2]] * way[:, [0, 1, 2, 1, 2, 0]]]
    means = np.stack([np.bincount(one, column, len(x0)) for column in columns.T], axis=1) / number[:, None]
    xx, yy, zz, xy, yz, zx = means[:, 3:].T
    second = np.stack([np.stack([xx, xy, zx], -1), np.stack([xy, yy, yz], -1), np.stack([zx, yz, zz], -1)], -2)
    variance = second - means[:, :3, None] * means[:, None, :3]
    return np.linalg.eigvalsh(variance)[:, 0] < LAYER


def require_thickness(
    x0: Float[Array, "particles 3"], volume: Float[Array, " particles"], spacing: float, where: str
) -> float:
    """Share of the volume that is one particle thick in some direction: the grid carries no bending there.

    Args:
        x0: particles at rest [m].
        volume: of each [m3].
        spacing: between neighbours [m].
        where: what an error names.

    Raises:
        InputError: that share is larger than a half.
    """
    thin = one_particle_thick(x0, spacing)
    share = float(volume[thin].sum() / volume.sum())
    if share > THIN_SHARE:
        thickness = float(np.median(volume[thin])) / spacing**2
        raise InputError(
            f"{100 * share:.0f} % of the volume is one particle thick: about {1e3 * thickness:.2g} mm or less at a spacing"
            f" of {1e3 * spacing:.3g} mm",
            where=where,
            expected="at least two particles across; three cells, of two spacings each, for bending to be right",
            remedy=f"a spacing of {1e3 * thickness / 2:.2g} mm or less, or a shell (planar geometry) or rod (linear geometry)",
        )
    return share
