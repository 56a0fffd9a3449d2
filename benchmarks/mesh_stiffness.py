"""How much stiffer a mesh of linear tetrahedra bends than the continuum it stands for.

A truth of finite elements with a modulus E bends like a continuum of a larger one. The body is clamped where it is held and loaded by its
weight; its mean deflection with the mesh as it is and with every tetrahedron cut in eight gives that of the continuum, for the error of linear
elements falls with the square of their size (Richardson's extrapolation). Small strain, so MuJoCo's law does not matter.
"""

import itertools

import numpy as np
from scipy import sparse
from scipy.sparse.linalg import cg

from physreal_core.array_types import Array, Bool, Float, Int

LOAD = np.array([0.0, 0.0, -1.0])
PRECISION = 1e-9


def stiffness_over_continuum(
    vertices: Float[Array, "V 3"], tets: Int[Array, "E 4"], held: Int[Array, " held"], poissons_ratio: float
) -> float:
    """Deflection of the continuum over that of the mesh under its weight.

    Args:
        vertices: free of stress [m].
        tets: their corners.
        held: vertices that are clamped.
        poissons_ratio: of the material, the same everywhere.
    """
    fixed = np.zeros(len(vertices), bool)
    fixed[held] = True
    coarse = _deflection(vertices, tets, fixed, poissons_ratio)
    fine = _deflection(*_cut_in_eight(vertices, tets, fixed), poissons_ratio)
    return (fine + (fine - coarse) / 3.0) / coarse


def _deflection(
    vertices: Float[Array, "V 3"], tets: Int[Array, "E 4"], fixed: Bool[Array, " V"], poissons_ratio: float
) -> float:
    """Mean displacement along the load, by volume, of a body of modulus 1 and density 1."""
    corners = vertices[tets]
    edges = corners[:, 1:] - corners[:, :1]
    volume = np.abs(np.linalg.det(edges)) / 6.0
    slopes = np.linalg.inv(edges).transpose(0, 2, 1)
    slopes = np.concatenate([-slopes.sum(1, keepdims=True), slopes], axis=1)  # of the shape functions, [E, 4, 3]
    lame = poissons_ratio / ((1 + poissons_ratio) * (1 - 2 * poissons_ratio))
    shear = 0.5 / (1 + poissons_ratio)
    dots = np.einsum("eai,ebi->eab", slopes, slopes)
    blocks = lame * np.einsum("eai,ebj->eaibj", slopes, slopes) + shear * np.einsum("eaj,ebi->eaibj", slopes, slopes)
    blocks += shear * np.einsum("eab,ij->eaibj", dots, np.eye(3))
    dofs = (3 * tets[:, :, None] + np.arange(3)).reshape(len(tets), 12)
    rows, columns = np.repeat(dofs, 12, axis=1).ravel(), np.tile(dofs, 12).ravel()
    entries = (volume[:, None, None] * blocks.reshape(len(tets), 12, 12)).ravel()
    K = sparse.csr_matrix((entries, (rows, columns)), shape=(3 * len(vertices),) * 2)
    mass = np.bincount(tets.ravel(), np.repeat(volume / 4.0, 4), len(vertices))
    free = np.flatnonzero(np.repeat(~fixed, 3))
    load = (mass[:, None] * LOAD).ravel()
    K = K[free][:, free]
    moved, failed = cg(K, load[free], rtol=PRECISION, maxiter=50_000, M=sparse.diags(1.0 / K.diagonal()))
    if failed:
        raise RuntimeError("the deflection did not converge")
    return float(load[free] @ moved) / float(mass.sum())


def _cut_in_eight(vertices: Array, tets: Array, fixed: Array) -> tuple[Array, Array, Array]:
    """The mesh with a vertex on every edge; one between two that are fixed is fixed."""
    pairs = np.sort(tets[:, list(itertools.combinations(range(4), 2))].reshape(-1, 2), axis=1)
    edges, number = np.unique(pairs, axis=0, return_inverse=True)
    middle = len(vertices) + number.reshape(-1, 6)
    a, b, c, d = tets.T
    ab, ac, ad, bc, bd, cd = middle.T
    cut = [(a, ab, ac, ad), (ab, b, bc, bd), (ac, bc, c, cd), (ad, bd, cd, d)]
    cut += [(ab, ac, ad, bd), (ab, ac, bc, bd), (ac, ad, bd, cd), (ac, bc, bd, cd)]
    tets = np.concatenate([np.stack(one, axis=1) for one in cut])
    return np.concatenate([vertices, vertices[edges].mean(1)]), tets, np.concatenate([fixed, fixed[edges].all(1)])
