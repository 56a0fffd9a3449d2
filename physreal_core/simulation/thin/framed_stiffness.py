"""Stiffness of the vertices of a rod with directors from their parameters, differentiable, and the longest stable substep.

With r the radius, E and nu of the vertices, a homogeneous round rod has E A = E pi r^2, E I = E pi r^4 / 4 and G J = E / (2 (1 + nu)) pi r^4 / 2;
`bending_ratio` and `twisting_ratio` are how many times that a rope or a cable has.
"""

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.segments import Segments

BEND = 2.0
"""Times the curvature at rest or at the start up to which that couples bending and twisting."""


def framed_stiffness(rod: Segments, parameters: Parameters) -> Float[Tensor, "*rollouts 8 bends"]:
    """Rows `FRAMED_ROD_STIFFNESS` of every vertex between two segments.

    Args:
        rod: the segments.
        parameters: complete, of its vertices.
    """
    E, nu = parameters.youngs_modulus, parameters.poissons_ratio
    corners = torch.as_tensor(rod.corners, device=E.device)
    middle = corners[:, 1]
    of_segments = (E[..., corners[:, :2]] + E[..., corners[:, 1:]]) / 2.0
    stretching = of_segments * (np.pi * rod.radius**2) * torch.as_tensor(rod.shares).to(E)
    bending = E * (np.pi * rod.radius**4 / 4.0) * _or(parameters.bending_ratio, 1.0)
    twisting = E / (1.0 + nu) * (np.pi * rod.radius**4 / 4.0) * _or(parameters.twisting_ratio, 1.0)
    zeros = torch.zeros_like(E)[..., None].expand(*E.shape, 2)
    pairs = [_or(pair, zeros) for pair in (parameters.rest_curvature, parameters.retardation_time)]
    own = torch.stack([bending, twisting, *(value for pair in pairs for value in pair.unbind(-1))], -2)[..., middle]
    return torch.cat([stretching.mT, own], -2)


def _or(value: Tensor | None, absent: Tensor | float) -> Tensor | float:
    return absent if value is None else value


def framed_frequency(rod: Segments, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> float:
    """2 over the longest stable substep [rad/s], of many rollouts the largest.

    No vibration is faster than the fastest of one element by itself (Irons and Treharne 1971), with the mass of vertices and the inertia of
    segments shared out among elements. Curvature, counted up to BEND times that at rest or at the start, couples bending and twisting. With
    retardation times T a substep h is stable while (w h)^2 + 2 T w^2 h < 4, where its
    amplification is -1.

    Args:
        rod: the segments.
        parameters: complete.
        mass: of the vertices [kg].
    """
    with torch.no_grad():
        rows = framed_stiffness(rod, parameters).double()
    like = lambda array: torch.as_tensor(array, device=mass.device)
    corners, lengths = like(rod.corners), like(rod.rest_lengths[rod.bend_segments])
    length = like(rod.bend_lengths)
    share = (mass / torch.bincount(corners.flatten(), minlength=sum(rod.rows)).to(mass))[..., corners]
    stretching = (rows[..., :2, :].mT / lengths * (1.0 / share[..., :2] + 1.0 / share[..., 1:])).sum(-1)
    slopes = torch.stack([1.0 / lengths[:, 0], -(1.0 / lengths).sum(1), 1.0 / lengths[:, 1]], -1)
    density = mass / like(np.pi * rod.radius**2 * rod.vertex_length)
    mobility = rod.mobility(density)[..., corners[:, :2]] / like(rod.shares)
    curved = torch.maximum(rows[..., 4:6, :].square().sum(-2), like(_curvature_at_start(rod)) ** 2)
    coupling = (0.5 * BEND * length) ** 2 * curved
    moving, turning = (slopes**2 / share).sum(-1), mobility.sum(-1)
    bending, twisting = rows[..., 2, :] / length, rows[..., 3, :] / length
    bend_times, twist_times = rows[..., 6, :] * bending, rows[..., 7, :] * twisting
    squared = _largest(stretching, bending, twisting, moving, turning, coupling)
    lag = _largest(torch.zeros_like(stretching), bend_times, twist_times, moving, turning, coupling)
    return float(0.5 * (lag + (lag**2 + 4.0 * squared).sqrt()).max())


def _largest(
    stretching: Tensor, bending: Tensor, twisting: Tensor, moving: Tensor, turning: Tensor, coupling: Tensor
) -> Tensor:
    """Bound of the largest eigenvalue over the ways of the vertices and the turns of the segments; curvature couples them."""
    of_ways = stretching + (bending + coupling * twisting) * moving
    of_turns = (twisting + coupling * bending) * turning
    across = (bending + twisting).square() * coupling * moving * turning
    return 0.5 * (of_ways + of_turns + ((of_ways - of_turns) ** 2 + 4.0 * across).sqrt())


def _curvature_at_start(rod: Segments) -> Float[np.ndarray, " bends"]:
    """Of the centre line where it starts [1/m]."""
    a, b = (np.diff(rod.start[rod.corners[:, i : i + 2]], axis=1)[:, 0] for i in (0, 1))
    product = np.linalg.norm(a, axis=1) * np.linalg.norm(b, axis=1)
    binormal = 2.0 * np.linalg.norm(np.cross(a, b), axis=1) / (product + np.einsum("mi,mi->m", a, b))
    return binormal / rod.bend_lengths
