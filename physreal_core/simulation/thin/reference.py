"""Energies, dissipation, drag and invariants of thin bodies in plain torch, for tests and notebooks; the step has them in C++ (`shell.h`,
`rod.h`, `surface_drag.h`)."""

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.simulation.thin.rod import Rod
from physreal_core.simulation.thin.shell import Shell


def shell_energy(
    shell: Shell, x: Float[Tensor, "vertices 3"], stiffness: Float[Tensor, "rows triangles"]
) -> Float[Tensor, ""]:
    """Elastic energy [J] of a shell with its vertices at x [m].

    Args:
        shell: the triangles.
        x: where the vertices are.
        stiffness: as of `stiffness.shell_stiffness`; its first twelve rows count.
    """
    return shell_energies(shell, x, stiffness).sum()


def shell_energies(
    shell: Shell, x: Float[Tensor, "vertices 3"], stiffness: Float[Tensor, "rows triangles"]
) -> Float[Tensor, "2 triangles"]:
    """The same of every triangle, of its membrane and of its bending [J]."""
    return _half_squares(shell, shell_strains(shell, x), stiffness[:12])


def shell_dissipation(
    shell: Shell,
    x: Float[Tensor, "vertices 3"],
    v: Float[Tensor, "vertices 3"],
    stiffness: Float[Tensor, "rows triangles"],
) -> Float[Tensor, ""]:
    """Half of the power [W] that a shell's viscosity takes (Rayleigh), whose derivative by v are minus its forces.

    Args:
        shell: the triangles.
        x, v: places [m] and velocities [m/s] of the vertices.
        stiffness: as of `stiffness.shell_stiffness` with viscosity; its last twelve rows count.
    """
    rates = torch.func.jvp(lambda x: shell_strains(shell, x), (x,), (v,))[1]
    return _half_squares(shell, rates, stiffness[12:]).sum()


def shell_strains(shell: Shell, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "6 triangles"]:
    """Green's strains 11, 22 and twice 12, and k_e of the three edges [1/m], of vertices at x [m]."""
    like = lambda array: torch.as_tensor(array).to(x)
    corners = x[torch.as_tensor(shell.corners)]
    edges = torch.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], -1)
    F = edges @ like(shell.inverse)
    green = 0.5 * (F.mT @ F - torch.eye(2).to(x))
    normal = torch.linalg.cross(edges[..., 0], edges[..., 1])
    bent = [_bent(shell, corners, normal, e) for e in range(3)]
    return torch.stack([green[:, 0, 0], green[:, 1, 1], 2.0 * green[:, 0, 1], *bent])


def shell_invariants(shell: Shell, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "3 triangles"]:
    """tr E, |E|^2 and |K|^2 [1/m2] of the triangles, with the curvature K = sum of k_e n_e n_e^T (shell.py), k_e zero over free edges."""
    e0, e1, e2, *bent = shell_strains(shell, x)
    second, third = torch.as_tensor(shell.inverse).to(x).unbind(1)
    slopes = torch.stack([-(second + third), second, third])
    normals = slopes / slopes.norm(dim=-1, keepdim=True)
    curvature = sum(k[:, None, None] * n[:, :, None] * n[:, None, :] for k, n in zip(bent, normals, strict=True))
    return torch.stack([e0 + e1, e0**2 + e1**2 + e2**2 / 2.0, curvature.square().sum((-2, -1))])


def rod_invariants(rod: Rod, x: Float[Tensor, "vertices 3"]) -> Float[Tensor, "3 bends"]:
    """The mean stretch of both segments, the mean of their squares, and the square of the curvature [1/m2], at the vertices between two."""
    corners = x[torch.as_tensor(rod.corners)]
    segments = corners[:, 1:] - corners[:, :-1]
    lengths = segments.norm(dim=-1)
    stretch = lengths / torch.as_tensor(rod.rest_lengths[rod.bend_segments]).to(x) - 1.0
    cosine = (segments[:, 0] * segments[:, 1]).sum(1) / lengths.prod(1)
    tangent_squared = (1.0 - cosine) / (1.0 + cosine)  # of half of the angle
    curvature_squared = 4.0 * tangent_squared / torch.as_tensor(rod.bend_lengths).to(x) ** 2
    return torch.stack([stretch.mean(1), stretch.square().mean(1), curvature_squared])


def _half_squares(shell: Shell, strains: Tensor, stiffness: Tensor) -> Float[Tensor, "2 triangles"]:
    e0, e1, e2 = strains[:3]
    C11, C22, C12, C33, C13, C23 = stiffness[:6]
    membrane = 0.5 * (C11 * e0**2 + C22 * e1**2 + C33 * e2**2) + C12 * e0 * e1 + (C13 * e0 + C23 * e1) * e2
    bent = strains[3:]
    bending = 0.5 * (stiffness[6:9] * bent**2).sum(0)
    for e in range(3):
        bending = bending + stiffness[9 + e] * bent[(e + 1) % 3] * bent[(e + 2) % 3]
    return torch.stack([torch.as_tensor(shell.area).to(strains) * membrane, bending])


def _bent(shell: Shell, corners: Tensor, normal: Tensor, e: int) -> Float[Tensor, " triangles"]:
    """k_e of every triangle; zero over free edges."""
    a, b, d = corners[:, (e + 1) % 3], corners[:, (e + 2) % 3], corners[:, 3 + e]
    other, edge = torch.linalg.cross(b - d, a - d), b - a
    sine = (torch.linalg.cross(normal, other) * edge).sum(-1) / edge.norm(dim=-1)
    angle = torch.atan2(sine, (normal * other).sum(-1))
    like = lambda array: torch.as_tensor(array).to(corners)
    bent = like(shell.widths[:, e]) * (angle - like(shell.rest_angles[:, e]))
    return torch.where(torch.as_tensor(shell.free_edges[:, e]), 0.0, bent)


def rod_energy(rod: Rod, x: Float[Tensor, "vertices 3"], stiffness: Float[Tensor, "3 bends"]) -> Float[Tensor, ""]:
    """Elastic energy [J] of a rod with its vertices at x [m].

    Args:
        rod: the segments.
        x: where the vertices are.
        stiffness: as of `Rod.stiffness`.
    """
    return rod_energies(rod, x, stiffness).sum()


def rod_energies(
    rod: Rod, x: Float[Tensor, "vertices 3"], stiffness: Float[Tensor, "3 bends"]
) -> Float[Tensor, "2 bends"]:
    """The same at every vertex between two segments, of stretching and of bending [J]."""
    corners = x[torch.as_tensor(rod.corners)]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 1]
    rest_a, rest_b = torch.as_tensor(rod.rest_lengths[rod.bend_segments]).to(x).unbind(1)
    stretching = stiffness[0] * rest_a * (a.norm(dim=1) / rest_a - 1.0) ** 2
    stretching = stretching + stiffness[1] * rest_b * (b.norm(dim=1) / rest_b - 1.0) ** 2
    cosine = (a * b).sum(1) / (a.norm(dim=1) * b.norm(dim=1))
    length = torch.as_tensor(rod.bend_lengths).to(x)
    bending = stiffness[2] * 4.0 * (1.0 - cosine) / (1.0 + cosine) / length
    return 0.5 * torch.stack([stretching, bending])


def framed_rod_energy(
    rod: Rod,
    x: Float[Tensor, "vertices 3"],
    director: Float[Tensor, "vertices 3"],
    stiffness: Float[Tensor, "8 bends"],
) -> Float[Tensor, ""]:
    """Elastic energy [J] of a framed rod with its vertices at x [m].

    Args:
        rod: the segments.
        x: where the vertices are.
        director: of the segments, at the first vertex of each; only its direction across the segment counts.
        stiffness: as of `Rod.stiffness`.
    """
    strains = rod_strains(rod, x, director)
    length = torch.as_tensor(rod.bend_lengths).to(x)
    rest = torch.as_tensor(rod.rest_lengths[rod.bend_segments]).to(x)
    stretching = (stiffness[:2] * rest.T * strains[:2] ** 2).sum()
    bending = (stiffness[2] / length * (strains[2:4] - length * stiffness[4:6]) ** 2).sum()
    return 0.5 * (stretching + bending + (stiffness[3] / length * strains[4] ** 2).sum())


def rod_strains(
    rod: Rod, x: Float[Tensor, "vertices 3"], director: Float[Tensor, "vertices 3"]
) -> Float[Tensor, "5 bends"]:
    """Of the vertices between two segments the stretches of both, the curvatures by the two directors, and the twist (framedrod.h)."""
    corners = x[torch.as_tensor(rod.corners)]
    segments = corners[:, 1:] - corners[:, :-1]
    t = segments / segments.norm(dim=-1, keepdim=True)
    d = director[torch.as_tensor(rod.corners[:, :2])]
    across = d - (d * t).sum(-1, keepdim=True) * t
    m1 = across / across.norm(dim=-1, keepdim=True)
    m2 = torch.linalg.cross(t, m1)
    (ta, tb), (a1, b1), (a2, b2) = t.unbind(1), m1.unbind(1), m2.unbind(1)
    binormal = 2.0 * torch.linalg.cross(ta, tb) / (1.0 + (ta * tb).sum(-1, keepdim=True))
    rest = torch.as_tensor(rod.rest_lengths[rod.bend_segments]).to(x)
    stretches = (segments.norm(dim=-1) / rest - 1.0).T
    curvatures = torch.stack([(binormal * (a2 + b2)).sum(-1), -(binormal * (a1 + b1)).sum(-1)]) / 2.0
    axis = torch.linalg.cross(ta, tb)
    cosine = (ta * tb).sum(-1, keepdim=True)
    led = cosine * a1 + torch.linalg.cross(axis, a1) + axis * (axis * a1).sum(-1, keepdim=True) / (1.0 + cosine)
    twist = torch.atan2((torch.linalg.cross(led, b1) * tb).sum(-1), (led * b1).sum(-1))
    return torch.cat([stretches, curvatures, twist[None]])


def shell_drag(
    shell: Shell,
    x: Float[Tensor, "vertices 3"],
    v: Float[Tensor, "vertices 3"],
    coefficient: Float[Tensor, " vertices"],
) -> Float[Tensor, "vertices 3"]:
    """Drag [N] of the surroundings on the vertices of a shell: of a triangle with area A and unit normal n, whose corners have the mean
    velocity v, -c A |v . n| (v . n) n, a third at each corner.

    Args:
        shell: the triangles.
        x, v: places [m] and velocities [m/s] of the vertices.
        coefficient: c = rho C_d / 2 of the vertices [kg/m3]; of a triangle the mean of its corners'. C_d is about 1.2 for a square plate
            across the stream (Hoerner, Fluid-Dynamic Drag, 1965).
    """
    triangles = torch.as_tensor(shell.triangles)
    a, b, c = x[triangles].unbind(1)
    twice = torch.linalg.cross(b - a, c - a)
    area, normal = twice.norm(dim=1) / 2.0, twice / twice.norm(dim=1, keepdim=True)
    speed = (v[triangles].mean(1) * normal).sum(1)
    force = -(coefficient[triangles].mean(1) * area * speed.abs() * speed)[:, None] * normal
    return torch.zeros_like(x).index_add(0, triangles.ravel(), force.repeat_interleave(3, 0) / 3.0)


def rod_drag(
    rod: Rod,
    x: Float[Tensor, "vertices 3"],
    v: Float[Tensor, "vertices 3"],
    coefficient: Float[Tensor, " vertices"],
) -> Float[Tensor, "vertices 3"]:
    """Drag [N] of the surroundings on the vertices of a rod: of a segment of length l, whose ends have the mean velocity v with the part p across
    it, -c 2 r l |p| p, half at each end.

    Args:
        rod: the segments.
        x, v: places [m] and velocities [m/s] of the vertices.
        coefficient: c = rho C_d / 2 of the vertices [kg/m3]; of a segment the mean of its ends'. C_d is about 1.1 for a cylinder across the
            stream (Hoerner 1965).
    """
    segments = torch.as_tensor(rod.segments)
    way = x[segments[:, 1]] - x[segments[:, 0]]
    tangent, mean = way / way.norm(dim=1, keepdim=True), v[segments].mean(1)
    across = mean - (mean * tangent).sum(1, keepdim=True) * tangent
    area = 2.0 * rod.radius * torch.as_tensor(rod.rest_lengths).to(x)
    force = -(coefficient[segments].mean(1) * area * across.norm(dim=1))[:, None] * across
    return torch.zeros_like(x).index_add(0, segments.ravel(), force.repeat_interleave(2, 0) / 2.0)
