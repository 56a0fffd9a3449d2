"""Stiffness of a shell's triangles from the parameters of its vertices, differentiable, and the fastest vibration that it allows.

With t the thickness, E and nu of a vertex averaged over the triangle's corners, the membrane has under plane stress

    C11 = E t / (1 - nu^2) ,  C22 = weft C11 ,  C12 = nu sqrt(weft) C11 ,  C33 = shear sqrt(weft) E t / (2 (1 + nu)) ,

and the plate `bending` t^2 / 12 times that: with all ratios one a homogeneous isotropic sheet. A fabric's threads slip over each other, so its
shear and its bending are far softer than that.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.simulation.parameters import Parameters

if TYPE_CHECKING:
    from physreal_core.simulation.thin.shell import Shell

PAIRS = ((0, 0), (1, 1), (2, 2), (1, 2), (2, 0), (0, 1))
"""The six numbers of a symmetric 3x3 matrix, in order."""
PLACES = [[0, 5, 4], [5, 1, 3], [4, 3, 2]]
"""Where among these each entry of the matrix is."""


def shell_stiffness(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts 10 triangles"]:
    """Rows as `shell_stiffness` of the layout: C11, C22, C12, C33 [N/m], then the bending energy's second derivatives by the curvatures k_e of
    the three edges (shell.py) and by those of edges 1 and 2, 2 and 0, 0 and 1 [N m3].

    Args:
        shell: the triangles.
        parameters: complete, of its vertices.
    """
    C = _plane_stress(shell, parameters)
    ratio = _of_triangles(shell, parameters.bending_ratio)
    plate = shell.thickness**2 / 12.0 * (C if ratio is None else ratio[..., None, :] * C)
    return torch.cat([C, _bending(shell, plate)], -2)


def shell_frequency(shell: Shell, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
    """Upper bound of the fastest vibration at rest [rad/s], of many rollouts the largest.

    No vibration of a body is faster than the fastest of one of its elements by itself (Irons and Treharne 1971), with the vertices' mass shared
    out among elements; those of membrane and plate add up in squares, each with all of the mass.

    Args:
        shell: the triangles.
        parameters: complete.
        mass: of the vertices [kg].
    """
    with torch.no_grad():
        rows = shell_stiffness(shell, parameters).double()
    C11, C22, C12, C33 = rows[..., :4, :].unbind(-2)
    zero = torch.zeros_like(C12)
    membrane = torch.stack([C11, C22, C33, zero, zero, C12], -2)
    squared = _largest(membrane, shell.membrane_flexibility(mass.to(rows)))
    squared = squared + _largest(rows[..., 4:, :], shell.bending_flexibility(mass.to(rows)))
    return float(squared) ** 0.5


def pairs_of(vectors: Float[Array, "*batch 3"]) -> Array:
    """The six numbers of the products of vectors with themselves, shape [6, ...]."""
    return np.stack([vectors[..., i] * vectors[..., j] for i, j in PAIRS])


def _plane_stress(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts 4 triangles"]:
    """C11, C22, C12, C33."""
    E, nu = (_of_triangles(shell, p) for p in (parameters.youngs_modulus, parameters.poissons_ratio))
    weft, shear = (_of_triangles(shell, p) for p in (parameters.weft_ratio, parameters.shear_ratio))
    root = torch.ones_like(E) if weft is None else weft.sqrt()
    first = E * shell.thickness / (1.0 - nu**2)
    third = (1.0 if shear is None else shear) * root * E * shell.thickness / (2.0 * (1.0 + nu))
    return torch.stack([first, root**2 * first, nu * root * first, third], -2)


def _of_triangles(shell: Shell, values: Tensor | None) -> Tensor | None:
    """The mean over each triangle's corners."""
    return None if values is None else values[..., torch.as_tensor(shell.triangles, device=values.device)].mean(-1)


def _bending(shell: Shell, plate: Float[Tensor, "*rollouts 4 triangles"]) -> Float[Tensor, "*rollouts 6 triangles"]:
    """Second derivatives of the bending energy by k_e; those of free edges are such that it is smallest, and have none left."""
    G = (torch.as_tensor(shell.plate_forms).to(plate) * plate[..., None, :, :]).sum(-2)
    outer = np.flatnonzero(shell.free_edges.any(1))
    if len(outer) == 0:
        return G
    free, outer = (torch.as_tensor(array, device=plate.device) for array in (shell.free_edges[outer], outer))
    own = _matrices(G.index_select(-1, outer)).movedim(-1, -3)
    inside = torch.diag_embed((~free).to(G))
    among = torch.where(free[:, :, None] & free[:, None, :], own, inside)
    towards = torch.where(free[:, :, None] & ~free[:, None, :], own, 0.0)
    left = own - towards.mT @ torch.linalg.solve(among, towards)
    left = torch.where(~free[:, :, None] & ~free[:, None, :], left, 0.0)
    return G.index_copy(-1, outer, torch.stack([left[..., i, j] for i, j in PAIRS], -2))


def _matrices(rows: Float[Tensor, "*rollouts 6 triangles"]) -> Float[Tensor, "*rollouts 3 3 triangles"]:
    return rows[..., PLACES, :]


def _largest(stiffness: Float[Tensor, "*rollouts 6 n"], flexibility: Float[Tensor, "*others 6 n"]) -> Float[Tensor, ""]:
    """The largest eigenvalue of the products of n pairs of symmetric 3x3 matrices, all without negative eigenvalues.

    That of a matrix whose eigenvalues are real follows from its invariants (Smith, Comm. ACM 4, 1961), to 1e-8 where it repeats.
    """
    product = (_matrices(stiffness)[..., None, :] * _matrices(flexibility)[..., None, :, :, :]).sum(-3)
    mean = (product[..., 0, 0, :] + product[..., 1, 1, :] + product[..., 2, 2, :]) / 3.0
    shifted = product - mean[..., None, None, :] * torch.eye(3).to(product)[..., None]
    size = ((shifted * shifted.transpose(-3, -2)).sum((-3, -2)) / 6.0).clamp_min(0.0).sqrt()
    a, b, c = shifted.unbind(-2)
    determinant = (torch.linalg.cross(a, b, dim=-2) * c).sum(-2)
    angle = torch.acos((determinant / (2.0 * size**3).clamp_min(1e-300)).clamp(-1.0, 1.0))
    return (mean + 2.0 * size * torch.cos(angle / 3.0)).amax()
