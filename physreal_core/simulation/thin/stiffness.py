"""Stiffness of a shell's triangles from the parameters of its vertices, differentiable, and the fastest vibration that it allows.

With t the thickness, E and nu of a vertex averaged over the triangle's corners, the membrane has under plane stress

    C11 = E t / (1 - nu^2) ,  C22 = weft C11 ,  C12 = nu sqrt(weft) C11 ,  C33 = shear sqrt(weft) E t / (2 (1 + nu)) ,

and the plate `bending` t^2 / 12 times that: with all ratios one a homogeneous isotropic sheet. A fabric's threads slip over each other, so its
shear and its bending are far softer than that.

A membrane stiffer than `Shell.largest_stiffness` counts as that stiff: C11, C22 and C12 are scaled down to it, and C33 by itself to half of it. The
plate is that of the given E.

Viscosity, with eta the shear and zeta the volume viscosity of sigma = 2 eta D + zeta tr(D) 1, has under plane stress

    C11 = C22 = t (2 eta + c) ,  C12 = t c ,  C33 = t eta ,  c = 2 eta zeta / (2 eta + zeta) ,

and bending again `bending` t^2 / 12 times that. The membrane's acts as far as the substep of its elastic waves can bear it (`MEMBRANE_DECAY`).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.rows import SHELL_STIFFNESS

if TYPE_CHECKING:
    from physreal_core.simulation.thin.shell import Shell


ROWS = SHELL_STIFFNESS.count
MEMBRANE_DECAY = 0.7
"""Of the frequency of a triangle's membrane: how fast its viscosity may let it decay. Up to it steps are 0.7 of those without viscosity.
A membrane's waves are far faster than the swings of a sheet, in which it hardly takes part; all of its viscosity would ask for steps that are
tens of times shorter."""


def shell_stiffness(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness triangles"]:
    """Rows as `shell_stiffness` of the layout: C11, C22, C12, C33 [N/m], then the bending energy's second derivatives by the curvatures k_e of
    the three edges (shell.py) and by those of edges 1 and 2, 2 and 0, 0 and 1 [N m3]. With viscosity the same ten of it follow,
    [N s/m] and [N s m3].

    Args:
        shell: the triangles.
        parameters: complete, of its vertices.
    """
    C, ratio = _plane_stress(shell, parameters), _of_triangles(shell, parameters.bending_ratio)
    plate = shell.thickness**2 / 12.0 * (torch.ones_like(C[..., 0, 0]) if ratio is None else ratio)[..., None, None]
    curvature = _curvature(shell, C)
    membrane = _limited(shell, C)
    elastic = _rows(membrane, _bending(shell, curvature, plate * C))
    if parameters.viscosity is None:
        return elastic
    R = _viscous_plane_stress(shell, parameters)
    viscous = _rows(_borne(shell, membrane, R)[..., None, None] * R, _bending(shell, curvature, plate * R))
    return torch.cat([elastic, viscous], -2)


def shell_frequency(shell: Shell, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
    """2 over the longest stable substep at rest [rad/s], of many rollouts the largest; without viscosity an upper bound of the fastest vibration.

    No vibration of a body is faster than the fastest of one of its elements by itself (Irons and Treharne 1971), with the vertices' mass shared
    out among elements; those of membrane and plate add up in squares, each with all of the mass. So do decays. A mode of frequency w that decays
    with g is stable while (w dt)^2 + 2 g dt < 4.

    Args:
        shell: the triangles.
        parameters: complete.
        mass: of the vertices [kg].
    """
    with torch.no_grad():
        rows = shell_stiffness(shell, parameters).double()
        squared = _squares(shell, rows[..., :ROWS, :], mass)
        if parameters.viscosity is None:
            return float(squared.max()) ** 0.5
        decay = _squares(shell, rows[..., ROWS:, :], mass)
        return float((decay + (decay**2 + 4.0 * squared).sqrt()).max()) / 2.0


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


def _limited(shell: Shell, C: Float[Tensor, "*rollouts triangles 3 3"]) -> Float[Tensor, "*rollouts triangles 3 3"]:
    """C, scaled down where it is stiffer along warp or weft than the membrane may be; shear by itself, to half of that."""
    if shell.largest_stiffness is None:
        return C
    stretch = (shell.largest_stiffness / torch.maximum(C[..., 0, 0], C[..., 1, 1])).clamp(max=1.0)
    shear = (shell.largest_stiffness / 2.0 / C[..., 2, 2]).clamp(max=1.0)
    root = torch.stack([stretch.sqrt(), stretch.sqrt(), shear.sqrt()], -1)
    return root[..., :, None] * C * root[..., None, :]


def _viscous_plane_stress(shell: Shell, parameters: Parameters) -> Float[Tensor, "*rollouts triangles 3 3"]:
    shear, volume = (_of_triangles(shell, value) for value in parameters.viscosity.unbind(-1))
    sum_ = 2.0 * shear + volume
    across = torch.where(sum_ != 0.0, 2.0 * shear * volume / torch.where(sum_ != 0.0, sum_, 1.0), 0.0)
    along, zero = 2.0 * shear + across, torch.zeros_like(shear)
    rows = [along, across, zero], [across, along, zero], [zero, zero, shear]
    return shell.thickness * torch.stack([torch.stack(row, -1) for row in rows], -2)


def _curvature(shell: Shell, C: Float[Tensor, "*rollouts triangles 3 3"]) -> Float[Tensor, "*rollouts triangles 3 3"]:
    """The curvature (11, 22, twice 12) by the k_e of a triangle's edges; those of free edges are such that no moment acts across them."""
    directions = _like(C, shell.curvatures)
    free = torch.as_tensor(shell.free_edges, device=C.device)
    if not bool(free.any()):
        return directions.mT.expand_as(C)
    G = directions @ (C / C[..., :1, :1]) @ directions.mT
    inside = torch.diag_embed((~free).to(G))
    among = torch.where(free[:, :, None] & free[:, None, :], G, inside)
    towards = torch.where(free[:, :, None] & ~free[:, None, :], G, 0.0)
    return directions.mT @ (inside - torch.linalg.solve(among, towards))


def _bending(shell: Shell, curvature: Tensor, plate: Tensor) -> Float[Tensor, "*rollouts triangles 3 3"]:
    """Second derivatives of the bending energy by k_e."""
    return _like(plate, shell.area)[:, None, None] * curvature.mT @ plate @ curvature


def _rows(membrane: Tensor, bending: Tensor) -> Float[Tensor, "*rollouts 10 triangles"]:
    rows = [membrane[..., 0, 0], membrane[..., 1, 1], membrane[..., 0, 1], membrane[..., 2, 2]]
    rows += [bending[..., e, e] for e in range(3)] + [bending[..., (e + 1) % 3, (e + 2) % 3] for e in range(3)]
    return torch.stack(rows, -2)


def _borne(shell: Shell, C: Tensor, R: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    """Share of the membrane's viscosity that acts, see `MEMBRANE_DECAY`."""
    if shell.density is None:
        return torch.ones_like(R[..., 0, 0])
    largest = lambda matrix: torch.maximum(matrix[..., 0, 0], matrix[..., 1, 1]) + matrix[..., 0, 1]
    flexibility = _like(C, shell.membrane_flexibility / (shell.density * shell.thickness))
    allowed, decay = MEMBRANE_DECAY * (flexibility * largest(C)).sqrt(), flexibility * largest(R)
    return torch.where(decay > allowed, allowed / torch.where(decay > allowed, decay, 1.0), 1.0)


def _squares(shell: Shell, rows: Tensor, mass: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    """Upper bounds of the squared frequencies of every triangle with these rows [1/s2]."""
    C = torch.zeros(*rows.shape[:-2], rows.shape[-1], 3, 3, dtype=rows.dtype, device=rows.device)
    C[..., 0, 0], C[..., 1, 1], C[..., 2, 2] = rows[..., 0, :], rows[..., 1, :], rows[..., 3, :]
    C[..., 0, 1] = C[..., 1, 0] = rows[..., 2, :]
    return _membrane_squares(shell, C, mass) + _bending_squares(shell, rows, mass)


def _membrane_squares(shell: Shell, C: Tensor, mass: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    gradients = _like(C, shell.gradients)  # [M, corner, axis]
    B = C.new_zeros(len(shell.triangles), 3, 3, 2)  # of the strains by the corners' places in the plane
    B[:, 0, :, 0], B[:, 1, :, 1] = gradients[..., 0], gradients[..., 1]
    B[:, 2, :, 0], B[:, 2, :, 1] = gradients[..., 1], gradients[..., 0]
    area = _like(C, shell.area)
    vertex_area = torch.as_tensor(shell.vertex_area[shell.triangles]).to(C)
    share = _at(mass, shell.triangles).to(C) * area[:, None] / 3.0 / vertex_area  # of every corner
    return _largest(C, (B / share[..., None, :, None]).flatten(-2) @ B.flatten(-2).mT * area[:, None, None])


def _bending_squares(shell: Shell, rows: Tensor, mass: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    G = torch.zeros(*rows.shape[:-2], rows.shape[-1], 3, 3, dtype=rows.dtype, device=rows.device)
    for e in range(3):
        a, b = (e + 1) % 3, (e + 2) % 3
        G[..., e, e] = rows[..., 4 + e, :]
        G[..., a, b] = G[..., b, a] = rows[..., 7 + e, :]
    count = torch.bincount(torch.as_tensor(shell.corners.ravel()), minlength=len(shell.rest)).to(rows)
    share = _at(mass, shell.corners).to(rows) / _at(count, shell.corners)
    slopes = _like(rows, shell.angle_slopes)  # [M, edge, corner]
    return _largest(G, (slopes / share[..., None, :]) @ slopes.mT)


def _largest(stiffness: Tensor, flexibility: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    """Of every element the largest eigenvalue of the product of two symmetric matrices, both without negative ones."""
    values, vectors = torch.linalg.eigh(flexibility)
    root = vectors * values.clamp_min(0.0).sqrt()[..., None, :]
    return torch.linalg.eigvalsh(root.mT @ stiffness @ root)[..., -1]


def _at(values: Float[Tensor, "*rollouts vertices"], corners: Array) -> Tensor:
    return values[..., torch.as_tensor(corners, device=values.device)]


def _like(tensor: Tensor, array: Array) -> Tensor:
    return torch.as_tensor(array, dtype=tensor.dtype, device=tensor.device)
