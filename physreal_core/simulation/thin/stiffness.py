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


def shell_stiffness(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts 10 triangles"]:
    """Rows as `shell_stiffness` of the layout: C11, C22, C12, C33 [N/m], then the bending energy's second derivatives by the curvatures k_e of
    the three edges (shell.py) and by those of edges 1 and 2, 2 and 0, 0 and 1 [N m3].

    Args:
        shell: the triangles.
        parameters: complete, of its vertices.
    """
    C = _plane_stress(shell, parameters)
    ratio = _of_triangles(shell, parameters.bending_ratio)
    thickness = shell.thickness**2 / 12.0 * (1.0 if ratio is None else ratio)
    G = _bending(shell, thickness[..., None, None] * C if ratio is not None else thickness * C)
    rows = [C[..., 0, 0], C[..., 1, 1], C[..., 0, 1], C[..., 2, 2]]
    rows += [G[..., e, e] for e in range(3)] + [G[..., (e + 1) % 3, (e + 2) % 3] for e in range(3)]
    return torch.stack(rows, -2)


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
    squared = _membrane_squares(shell, rows, mass) + _bending_squares(shell, rows, mass)
    return float(squared.max()) ** 0.5


def _plane_stress(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts triangles 3 3"]:
    E, nu = (_of_triangles(shell, p) for p in (parameters.youngs_modulus, parameters.poissons_ratio))
    weft, shear = (_of_triangles(shell, p) for p in (parameters.weft_ratio, parameters.shear_ratio))
    root = torch.ones_like(E) if weft is None else weft.sqrt()
    first, zero = E * shell.thickness / (1.0 - nu**2), torch.zeros_like(E)
    third = (1.0 if shear is None else shear) * root * E * shell.thickness / (2.0 * (1.0 + nu))
    across = nu * root * first
    return torch.stack(
        [torch.stack(row, -1) for row in ([first, across, zero], [across, root**2 * first, zero], [zero, zero, third])],
        -2,
    )


def _of_triangles(shell: Shell, values: Tensor | None) -> Tensor | None:
    """The mean over each triangle's corners."""
    return None if values is None else values[..., torch.as_tensor(shell.triangles, device=values.device)].mean(-1)


def _bending(shell: Shell, plate: Float[Tensor, "*rollouts triangles 3 3"]) -> Float[Tensor, "*rollouts triangles 3 3"]:
    """Second derivatives of the bending energy by k_e; those of free edges are such that it is smallest, and have none left."""
    directions, area = _like(plate, shell.curvatures), _like(plate, shell.area)
    G = area[:, None, None] * directions @ plate @ directions.mT
    outer = np.flatnonzero(shell.free_edges.any(1))
    if len(outer) == 0:
        return G
    free, outer = (torch.as_tensor(array, device=plate.device) for array in (shell.free_edges[outer], outer))
    own = G.index_select(-3, outer)
    inside = torch.diag_embed((~free).to(G))
    among = torch.where(free[:, :, None] & free[:, None, :], own, inside)
    towards = torch.where(free[:, :, None] & ~free[:, None, :], own, 0.0)
    left = own - towards.mT @ torch.linalg.solve(among, towards)
    return G.index_copy(-3, outer, torch.where(~free[:, :, None] & ~free[:, None, :], left, 0.0))


def _membrane_squares(shell: Shell, rows: Tensor, mass: Tensor) -> Tensor:
    C = torch.zeros(*rows.shape[:-2], rows.shape[-1], 3, 3, dtype=rows.dtype, device=rows.device)
    C[..., 0, 0], C[..., 1, 1], C[..., 2, 2] = rows[..., 0, :], rows[..., 1, :], rows[..., 3, :]
    C[..., 0, 1] = C[..., 1, 0] = rows[..., 2, :]
    gradients = _like(rows, shell.gradients)  # [M, corner, axis]
    B = rows.new_zeros(len(shell.triangles), 3, 3, 2)  # of the strains by the corners' places in the plane
    B[:, 0, :, 0], B[:, 1, :, 1] = gradients[..., 0], gradients[..., 1]
    B[:, 2, :, 0], B[:, 2, :, 1] = gradients[..., 1], gradients[..., 0]
    area = _like(rows, shell.area)
    vertex_area = torch.as_tensor(shell.vertex_area[shell.triangles]).to(rows)
    share = _at(mass, shell.triangles).to(rows) * area[:, None] / 3.0 / vertex_area  # of every corner
    return _largest(C, (B / share[..., None, :, None]).flatten(-2) @ B.flatten(-2).mT * area[:, None, None])


def _bending_squares(shell: Shell, rows: Tensor, mass: Tensor) -> Tensor:
    G = torch.zeros(*rows.shape[:-2], rows.shape[-1], 3, 3, dtype=rows.dtype, device=rows.device)
    for e in range(3):
        a, b = (e + 1) % 3, (e + 2) % 3
        G[..., e, e] = rows[..., 4 + e, :]
        G[..., a, b] = G[..., b, a] = rows[..., 7 + e, :]
    count = torch.bincount(torch.as_tensor(shell.corners.ravel()), minlength=len(shell.rest)).to(rows)
    share = _at(mass, shell.corners).to(rows) / _at(count, shell.corners)
    slopes = _like(rows, shell.angle_slopes)  # [M, edge, corner]
    return _largest(G, (slopes / share[..., None, :]) @ slopes.mT)


def _largest(stiffness: Tensor, flexibility: Tensor) -> Tensor:
    """The largest eigenvalue of the product of two symmetric 3x3 matrices, both without negative ones, of all elements.

    That of a matrix whose eigenvalues are real follows from its invariants (Smith, Comm. ACM 4, 1961), to 1e-8 where it repeats.
    """
    product = stiffness @ flexibility
    mean = product.diagonal(dim1=-2, dim2=-1).sum(-1) / 3.0
    shifted = product - mean[..., None, None] * torch.eye(3).to(product)
    size = ((shifted * shifted.mT).sum((-2, -1)) / 6.0).clamp_min(0.0).sqrt()
    angle = torch.acos((_determinant(shifted) / (2.0 * size**3).clamp_min(1e-300)).clamp(-1.0, 1.0))
    return (mean + 2.0 * size * torch.cos(angle / 3.0)).amax()


def _determinant(A: Float[Tensor, "*batch 3 3"]) -> Tensor:
    a, b, c = A.unbind(-1)
    return (torch.linalg.cross(a, b) * c).sum(-1)


def _at(values: Float[Tensor, "*rollouts vertices"], corners: Array) -> Tensor:
    return values[..., torch.as_tensor(corners, device=values.device)]


def _like(tensor: Tensor, array: Array) -> Tensor:
    return torch.as_tensor(array, dtype=tensor.dtype, device=tensor.device)
