"""The surface of a volume: triangles between its outermost particles.

Neighbouring particles span tetrahedra, and the faces of a single one of these are the surface. Each particle stands off what it touches by half
of its size, and by less where the body at rest is nearer to itself than that, so that a body at rest does not push itself apart.
"""

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int
from physreal_core.simulation.contact.reference import nearest_on_faces
from physreal_core.simulation.contact.surface import SHARE, Surface, never_touching
from physreal_core.simulation.pieces import NEAR

PATH = 2.5
"""Spacings through the body within which particles never touch: what is as thin as that is as thick as its particles, squeezed or not."""
SHIFT = 1e-3
"""Spacings by which particles are moved to tell which of the many tetrahedra in a lattice's cells to take."""


def volume_surface(
    x0: Float[Array, "particles 3"],
    volume: Float[Array, " particles"],
    reach: Float[Array, " particles"],
    piece: Int[Array, " particles"],
    spacing: float,
) -> Surface:
    """What a volume touches itself with.

    Args:
        x0: particles at rest [m].
        volume: of each [m3].
        reach: half of the size of each [m].
        piece: which it belongs to.
        spacing: between neighbours [m].
    """
    from scipy.spatial import cKDTree

    links = cKDTree(x0).query_pairs(NEAR * spacing, p=np.inf, output_type="ndarray")
    links = links[piece[links[:, 0]] == piece[links[:, 1]]].astype(np.int64).reshape(-1, 2)
    tetrahedra = _tetrahedra(x0, spacing, piece)
    faces = _boundary(tetrahedra)
    edges = np.unique(np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    outside = np.ones(len(x0), dtype=bool)
    outside[tetrahedra] = False  # what no tetrahedron has is a point by itself
    outside[faces] = True
    weight = np.where(outside, volume / spacing**3, 0.0)
    lengths = np.linalg.norm(x0[links[:, 1]] - x0[links[:, 0]], axis=1)
    near = never_touching(links, lengths, PATH * spacing, weight)
    reach = _apart_at_rest(x0, reach, faces, *near)
    return Surface(faces, edges, reach, SHARE * spacing, weight, near, spacing, sides=1)


def _tetrahedra(
    x0: Float[Array, "particles 3"], spacing: float, piece: Int[Array, " particles"]
) -> Int[Array, "tetrahedra 4"]:
    """Those of which all corners are neighbours."""
    from scipy.spatial import Delaunay

    if len(x0) < 5:
        return np.zeros((0, 4), dtype=np.int64)
    shift = np.random.default_rng(0).uniform(-SHIFT, SHIFT, x0.shape) * spacing
    found = Delaunay(x0 + shift).simplices.astype(np.int64)
    extent = np.ptp(x0[found], axis=1).max(1)
    return found[(extent <= NEAR * spacing) & (np.ptp(piece[found], axis=1) == 0)]


def _boundary(tetrahedra: Int[Array, "tetrahedra 4"]) -> Int[Array, "faces 3"]:
    """Faces of a single tetrahedron."""
    faces = np.sort(tetrahedra[:, [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]]].reshape(-1, 3), axis=1)
    single, times = np.unique(faces, axis=0, return_counts=True)
    return single[times == 1]


def _apart_at_rest(
    x0: Float[Array, "particles 3"],
    reach: Float[Array, " particles"],
    faces: Int[Array, "faces 3"],
    bounds: Int[Array, " bounds"],
    near: Int[Array, " neighbours"],
) -> Float[Array, " particles"]:
    """How far particles stand off, such that at rest none touches a face."""
    from scipy.sparse import csr_matrix
    from scipy.spatial import cKDTree

    centre = x0[faces].mean(1)
    radius = np.linalg.norm(x0[faces] - centre[:, None], axis=-1).max(initial=0.0)
    points = np.flatnonzero(np.diff(bounds) > 1)
    around = cKDTree(centre).query_ball_point(x0[points], 2.0 * reach.max() + radius) if len(faces) else []
    one = np.repeat(points, [len(found) for found in around]).astype(np.int64)
    other = np.concatenate([*around, []]).astype(np.int64)
    together = csr_matrix((np.ones(len(near), dtype=bool), near, bounds), shape=(len(x0),) * 2)
    apart = ~np.stack([np.asarray(together[one, corner]).ravel() for corner in faces[other].T]).any(0)
    one, other = one[apart], faces[other[apart]]
    distance = nearest_on_faces(torch.from_numpy(x0[one]), torch.from_numpy(x0[other]))[0].numpy()
    share = np.minimum(1.0, distance / (reach[one] + reach[other].max(1, initial=0.0)))
    least = np.ones(len(x0))
    np.minimum.at(least, one, share)
    np.minimum.at(least, other, share[:, None])
    return least * reach
