"""Contact in plain torch, over all pairs, for tests and notebooks; the step has it in C++ (`contact.h`)."""

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.simulation.contact.surface import Surface

SHALLOW, STEEP = 0.01, 0.1
"""sin^2 of the angle between edges from which on they count as crossing, first a little and then fully."""


def contact_energy(
    surface: Surface, x: Float[Tensor, "vertices 3"], youngs_modulus: Float[Tensor, " vertices"]
) -> Float[Tensor, ""]:
    """Energy [J] of all pairs that touch.

    Args:
        surface: of the body.
        x: where its vertices are [m].
        youngs_modulus: of the vertices [Pa].
    """
    points, faces = _points_and_faces(surface)
    pair = torch.as_tensor(np.c_[points, surface.faces[faces]])
    weight, reach = (torch.as_tensor(values).to(x) for values in (surface.weight, surface.reach))
    stiffness = surface.size * weight[pair[:, 0]] * youngs_modulus[pair].mean(1)
    distance, place = nearest_on_faces(x[pair[:, 0]], x[pair[:, 1:]])
    depth = reach[pair[:, 0]] + (place * reach[pair[:, 1:]]).sum(1) - distance
    energy = 0.5 * (stiffness * depth.clamp(min=0.0) ** 2).sum()
    one, other = _edge_pairs(surface)
    pair = torch.as_tensor(np.c_[surface.edges[one], surface.edges[other]])
    stiffness = surface.size * weight[pair].amin(1) * youngs_modulus[pair].mean(1)
    distance, place, share = _between_edges(x[pair])
    depth = (place * reach[pair]).sum(1) - distance
    return energy + 0.5 * (stiffness * share * depth.clamp(min=0.0) ** 2).sum()


def nearest_on_faces(
    point: Float[Tensor, "pairs 3"], corners: Float[Tensor, "pairs corners 3"]
) -> tuple[Float[Tensor, " pairs"], Float[Tensor, "pairs corners"]]:
    """Distances of points from segments or triangles [m], and the corners' shares in the nearest places: on an edge or within, whichever is
    nearest."""
    count = corners.shape[1]
    identity = torch.eye(count).to(corners)
    places = []
    for i in range(1 if count == 2 else 3):
        a, b = corners[:, i], corners[:, (i + 1) % count]
        along = (((point - a) * (b - a)).sum(1) / (b - a).square().sum(1)).clamp(0.0, 1.0)[:, None]
        places.append((1.0 - along) * identity[i] + along * identity[(i + 1) % count])
    if count == 3:
        a, b, c = corners.unbind(1)
        normal = torch.linalg.cross(b - a, c - a)
        sides = [(torch.linalg.cross(q - p, point - p) * normal).sum(1) for p, q in ((b, c), (c, a), (a, b))]
        within = torch.stack(sides, 1) / normal.square().sum(1, keepdim=True)
        places.append(torch.where((within > 0.0).all(1, keepdim=True), within, places[0]))
    ways = torch.stack([(point - (place[..., None] * corners).sum(1)).norm(dim=1) for place in places])
    nearest = ways.argmin(0)
    pairs = torch.arange(len(point))
    return ways[nearest, pairs], torch.stack(places)[nearest, pairs]


def _between_edges(
    x: Float[Tensor, "pairs 4 3"],
) -> tuple[Float[Tensor, " pairs"], Float[Tensor, "pairs 4"], Float[Tensor, " pairs"]]:
    """Distance of the edges' lines [m], the corners' shares in the nearest places of either, and the pair's weight W."""
    u, v, w = x[:, 1] - x[:, 0], x[:, 3] - x[:, 2], x[:, 2] - x[:, 0]
    normal = torch.linalg.cross(u, v)
    squared = normal.square().sum(1)
    sine = squared / (u.square().sum(1) * v.square().sum(1))
    safe = torch.where(sine > SHALLOW / 2, squared, 1.0)
    a = (torch.linalg.cross(w, v) * normal).sum(1) / safe
    b = (torch.linalg.cross(w, u) * normal).sum(1) / safe
    ramp = ((sine - SHALLOW) / (STEEP - SHALLOW)).clamp(0.0, 1.0)
    bump = lambda t: 16.0 * (t.clamp(0.0, 1.0) * (1.0 - t.clamp(0.0, 1.0))) ** 2
    share = bump(a) * bump(b) * ramp**2 * (3.0 - 2.0 * ramp)
    return (w * normal).sum(1).abs() / safe.sqrt(), torch.stack([1.0 - a, a, 1.0 - b, b], 1), share


def _hang_together(surface: Surface) -> Bool[Array, "vertices vertices"]:
    bounds, near = surface.near
    together = np.zeros((len(surface.weight),) * 2, dtype=bool)
    together[np.repeat(np.arange(len(bounds) - 1), np.diff(bounds)), near] = True
    return together


def _points_and_faces(surface: Surface) -> tuple[Int[Array, " pairs"], Int[Array, " pairs"]]:
    apart = ~_hang_together(surface)[:, surface.faces].any(-1)
    return np.nonzero(apart & (surface.weight > 0)[:, None])


def _edge_pairs(surface: Surface) -> tuple[Int[Array, " pairs"], Int[Array, " pairs"]]:
    edges = surface.edges
    near = _hang_together(surface)[edges[:, None, :, None], edges[None, :, None, :]].any((-1, -2))
    return np.nonzero(np.triu(~near, 1))
