"""Stiffness of a shell's triangles from the parameters of its vertices, differentiable, and the fastest vibration that it allows.

With t the thickness, E and nu of a vertex averaged over the triangle's corners, the membrane has under plane stress

    C11 = E t / (1 - nu^2) ,  C22 = weft C11 ,  C12 = nu sqrt(weft) C11 ,  C33 = shear sqrt(weft) E t / (2 (1 + nu)) ,

and the plate `bending` t^2 / 12 times that: with all ratios one a homogeneous isotropic sheet. A fabric's threads slip over each other, so its
shear and its bending are far softer than that.

Fibres along a with the modulus k have the energy t k / 8 (|F a|^2 - 1)^2 of an area, as in a volume. With a = c warp + s weft they add

    t k (c^4, s^4, c^2 s^2, c^2 s^2, c^3 s, c s^3)   to   C11, C22, C12, C33, C13, C23 ,

the last two of which couple stretch and shear and are zero without them; they go through the whole thickness and bend with it.

A membrane stiffer than `Triangles.largest_stiffness` counts as that stiff: C11, C22 and C12 are scaled down to it, and C33 by itself to half of it. The
plate is that of the given E.

Viscosity, with eta the shear and zeta the volume viscosity of sigma = 2 eta D + zeta tr(D) 1, has under plane stress

    C11 = C22 = t (2 eta + c) ,  C12 = t c ,  C33 = t eta ,  c = 2 eta zeta / (2 eta + zeta) ,

and bending again `bending` t^2 / 12 times that. The membrane's acts as far as the substep of its elastic waves can bear it (`MEMBRANE_DECAY`).
"""

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.rows import SHELL_STIFFNESS
from physreal_core.simulation.thin.symmetric import PAIRS, PLACES
from physreal_core.simulation.thin.triangles import Triangles

ROWS = SHELL_STIFFNESS.count
MEMBRANE_DECAY = 0.7
"""Of the frequency of a triangle's membrane: how fast its viscosity may let it decay. Up to it steps are 0.7 of those without viscosity.
A membrane's waves are far faster than the swings of a sheet, in which it hardly takes part; all of its viscosity would ask for steps that are
tens of times shorter."""


def shell_stiffness(shell: Triangles, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness triangles"]:
    """Rows as `shell_stiffness` of the layout: C11, C22, C12, C33, C13, C23 [N/m], then the bending energy's second derivatives by the
    curvatures k_e of the three edges (shell.py) and by those of edges 1 and 2, 2 and 0, 0 and 1 [N m3]. With viscosity the same twelve
    of it follow, [N s/m] and [N s m3].

    Args:
        shell: the triangles.
        parameters: complete, of its vertices.
    """
    C, ratio = _plane_stress(shell, parameters), _of_triangles(shell, parameters.bending_ratio)
    plate = shell.thickness**2 / 12.0 * (torch.ones_like(C[..., :1, :]) if ratio is None else ratio[..., None, :])
    curvature, membrane = _outer_curvature(shell, C), _limited(shell, C)
    elastic = torch.cat([membrane, _bending(shell, curvature, plate * C)], -2)
    if parameters.viscosity is None:
        return elastic
    R = _viscous_plane_stress(shell, parameters)
    viscous = [_borne(shell, membrane, R)[..., None, :] * R, _bending(shell, curvature, plate * R)]
    return torch.cat([elastic, *viscous], -2)


def shell_fastest(
    shell: Triangles, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]
) -> tuple[float, float]:
    """Upper bounds at rest of the fastest vibration's squared frequency [1/s2] and of the decay by viscosity [1/s], of many rollouts the largest.

    No vibration of a body is faster than the fastest of one of its elements by itself (Irons and Treharne 1971), with the vertices' mass shared
    out among elements; those of membrane and plate add up in squares, each with all of the mass. So do decays.

    Args:
        shell: the triangles.
        parameters: complete.
        mass: of the vertices [kg].
    """
    with torch.no_grad():
        rows = shell_stiffness(shell, parameters).double()
        squared = _largest_square(shell, rows[..., :ROWS, :], mass)
        if parameters.viscosity is None:
            return float(squared), 0.0
        return float(squared), float(_largest_square(shell, rows[..., ROWS:, :], mass))


def _largest_square(shell: Triangles, rows: Float[Tensor, "*rollouts 12 triangles"], mass: Tensor) -> Float[Tensor, ""]:
    """Upper bound of the squared frequencies with these rows [1/s2]."""
    C11, C22, C12, C33, C13, C23 = rows[..., :6, :].unbind(-2)
    membrane = torch.stack([C11, C22, C33, C23, C13, C12], -2)
    squared = _largest(membrane, shell.membrane_flexibility(mass.to(rows)))
    return squared + _largest(rows[..., 6:, :], shell.bending_flexibility(mass.to(rows)))


def _plane_stress(shell: Triangles, parameters: Parameters) -> Float[Tensor, "*rollouts 6 triangles"]:
    """C11, C22, C12, C33, C13, C23."""
    E, nu = (_of_triangles(shell, p) for p in (parameters.youngs_modulus, parameters.poissons_ratio))
    weft, shear = (_of_triangles(shell, p) for p in (parameters.weft_ratio, parameters.shear_ratio))
    root = torch.ones_like(E) if weft is None else weft.sqrt()
    first = E * shell.thickness / (1.0 - nu**2)
    third = (1.0 if shear is None else shear) * root * E * shell.thickness / (2.0 * (1.0 + nu))
    zero = torch.zeros_like(third)
    C = torch.stack([first, root**2 * first, nu * root * first, third, zero, zero], -2)
    return C if parameters.fibre_modulus is None else C + _of_fibres(shell, parameters)


def _of_fibres(shell: Triangles, parameters: Parameters) -> Float[Tensor, "*rollouts 6 triangles"]:
    """What fibres add; their direction is that of the corners' mean, of which the part in the triangle's plane counts."""
    axes = torch.as_tensor(shell.axes, device=parameters.fibre_direction.device).to(parameters.fibre_direction)
    of_corners = parameters.fibre_direction[..., torch.as_tensor(shell.triangles, device=axes.device), :]
    c, s = (axes @ of_corners.mean(-2)[..., None])[..., 0].unbind(-1)
    forms = torch.stack([c**4, s**4, c**2 * s**2, c**2 * s**2, c**3 * s, c * s**3], -2)
    return shell.thickness * _of_triangles(shell, parameters.fibre_modulus)[..., None, :] * forms


def _of_triangles(shell: Triangles, values: Tensor | None) -> Tensor | None:
    """The mean over each triangle's corners."""
    return None if values is None else values[..., torch.as_tensor(shell.triangles, device=values.device)].mean(-1)


def _limited(shell: Triangles, C: Float[Tensor, "*rollouts 6 triangles"]) -> Float[Tensor, "*rollouts 6 triangles"]:
    """C, scaled down where it is stiffer along warp or weft than the membrane may be; shear by itself, to half of that, and what couples
    both by the root of either."""
    if shell.largest_stiffness is None:
        return C
    stretch = (shell.largest_stiffness / torch.maximum(C[..., 0, :], C[..., 1, :])).clamp(max=1.0)
    shear = (shell.largest_stiffness / 2.0 / C[..., 3, :]).clamp(max=1.0)
    coupling = (stretch * shear).sqrt()
    return C * torch.stack([stretch, stretch, stretch, shear, coupling, coupling], -2)


def _viscous_plane_stress(shell: Triangles, parameters: Parameters) -> Float[Tensor, "*rollouts 6 triangles"]:
    shear, volume = (_of_triangles(shell, value) for value in parameters.viscosity.unbind(-1))
    sum_ = 2.0 * shear + volume
    across = torch.where(sum_ != 0.0, 2.0 * shear * volume / torch.where(sum_ != 0.0, sum_, 1.0), 0.0)
    along = 2.0 * shear + across
    zero = torch.zeros_like(shear)
    return shell.thickness * torch.stack([along, along, across, shear, zero, zero], -2)


def _borne(shell: Triangles, C: Tensor, R: Tensor) -> Float[Tensor, "*rollouts triangles"]:
    """Share of the membrane's viscosity that acts, see `MEMBRANE_DECAY`."""
    if shell.density is None:
        return torch.ones_like(R[..., 0, :])
    largest = lambda rows: torch.maximum(rows[..., 0, :], rows[..., 1, :]) + rows[..., 2, :]  # of stretching
    flexibility = torch.as_tensor(shell.flexibility_alone / (shell.density * shell.thickness)).to(C)
    allowed, decay = MEMBRANE_DECAY * (flexibility * largest(C)).sqrt(), flexibility * largest(R)
    return torch.where(decay > allowed, allowed / torch.where(decay > allowed, decay, 1.0), 1.0)


def _outer_curvature(shell: Triangles, C: Float[Tensor, "*rollouts 6 triangles"]) -> Float[Tensor, "*rollouts n 3 3"]:
    """Of the n triangles with free edges the curvature (11, 22, twice 12) by the k_e, such that no moment acts across free edges."""
    outer = np.flatnonzero(shell.free_edges.any(1))
    free, directions = (torch.as_tensor(a[outer], device=C.device) for a in (shell.free_edges, shell.curvatures))
    directions = directions.to(C)
    plate = _plates((C / C[..., :1, :]).index_select(-1, torch.as_tensor(outer, device=C.device)))
    G = directions @ plate @ directions.mT
    inside = torch.diag_embed((~free).to(G))
    among = torch.where(free[:, :, None] & free[:, None, :], G, inside)
    towards = torch.where(free[:, :, None] & ~free[:, None, :], G, 0.0)
    return directions.mT @ (inside - torch.linalg.solve(among, towards))


def _plates(rows: Float[Tensor, "*rollouts 6 n"]) -> Float[Tensor, "*rollouts n 3 3"]:
    """C11, C22, C12, C33, C13, C23 as matrices."""
    C11, C22, C12, C33, C13, C23 = rows.unbind(-2)
    return torch.stack([torch.stack(r, -1) for r in ([C11, C12, C13], [C12, C22, C23], [C13, C23, C33])], -2)


def _bending(
    shell: Triangles, curvature: Float[Tensor, "*rollouts n 3 3"], plate: Float[Tensor, "*rollouts 6 triangles"]
) -> Float[Tensor, "*rollouts 6 triangles"]:
    """Second derivatives of the bending energy by k_e.

    Args:
        shell: the triangles.
        curvature: of those with free edges, see `_outer_curvature`.
        plate: C11, C22, C12, C33, C13, C23 of the plate [N m].
    """
    G = (torch.as_tensor(shell.plate_forms).to(plate) * plate[..., None, :, :]).sum(-2)
    numbers = np.flatnonzero(shell.free_edges.any(1))
    outer, area = (torch.as_tensor(array, device=plate.device) for array in (numbers, shell.area[numbers]))
    left = area.to(G)[:, None, None] * curvature.mT @ _plates(plate.index_select(-1, outer)) @ curvature
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
