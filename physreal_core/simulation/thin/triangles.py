"""Triangles of a sheet: the surface without stress, and what follows from it for strains, curvatures and the share of the mass."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Bool, Float, Int, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.thin.symmetric import PAIRS, pairs_of

SMALLEST_HEIGHT = 1e-3
"""Of a triangle over its longest edge, below which it has no plane."""


@dataclass(frozen=True)
class Triangles:
    """The triangles of a body of vertices.

    Args:
        triangles: vertices of each, counter-clockwise as seen from the side to which the normal points, shape [M, 3].
        thickness: [m].
        rest: where the vertices are without stress [m], shape [N, 3].
        warp: direction in which the fabric's first stiffness counts; it is laid into each triangle's plane.
        density: of the material [kg/m3], from which follows how much viscosity the membrane can bear; None for any.
        largest_stiffness: of the membrane [N/m]; what is stiffer counts as that stiff. None for no limit. Bending has none.
        held: whether a hand holds each vertex, shape [N]; none by default. Triangles between held vertices do not bend.
    """

    triangles: Int[Array, "triangles 3"]
    thickness: float
    rest: Float[Array, "vertices 3"]
    warp: tuple[float, float, float] = (1.0, 0.0, 0.0)
    density: float | None = None
    largest_stiffness: float | None = None
    held: Bool[Array, " vertices"] | None = None

    def __post_init__(self) -> None:
        triangles = np.ascontiguousarray(self.triangles, dtype=np.int64)
        rest = np.ascontiguousarray(self.rest, dtype=np.float64)
        if triangles.ndim != 2 or triangles.shape[1] != 3 or len(triangles) == 0:
            raise InputError(f"shape {triangles.shape}", where="Shell.triangles", expected="(M, 3) with M > 0")
        if triangles.min() < 0 or triangles.max() >= len(rest):
            raise InputError(
                f"vertices {triangles.min()} to {triangles.max()}",
                where="Shell.triangles",
                expected=f"vertices within 0..{len(rest) - 1}",
            )
        if not self.thickness > 0:
            raise InputError(f"{self.thickness}", where="Shell.thickness", expected="a positive length [m]")
        object.__setattr__(self, "triangles", triangles)
        object.__setattr__(self, "rest", rest)
        self._check_heights()

    def _check_heights(self) -> None:
        longest = np.linalg.norm(self._edges, axis=-1).max(1)
        flat = 2.0 * self.area < SMALLEST_HEIGHT * longest**2
        if flat.any():
            number = int(np.argmax(flat))
            raise InputError(
                f"triangle {number} is flat",
                where="Shell.triangles",
                expected=f"heights of at least {SMALLEST_HEIGHT:g} of the longest edge",
                remedy="remesh the surface with triangles of about one size",
            )

    # --- the surface at rest ------------------------------------------------------------------------------------

    @cached_property
    def _edges(self) -> Float[Array, "triangles 3 3"]:
        """Edge e of each triangle, from its corner e + 1 to e + 2 [m]."""
        corners = self.rest[self.triangles]
        return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)

    @cached_property
    def _normal(self) -> Float[Array, "triangles 3"]:
        return np.cross(self._edges[:, 0], self._edges[:, 1])

    @cached_property
    def area(self) -> Float[Array, " triangles"]:
        """Of each triangle [m2]."""
        return np.linalg.norm(self._normal, axis=1) / 2.0

    @cached_property
    def vertex_area(self) -> Float[Array, " vertices"]:
        """A third of the area of every triangle around a vertex [m2]."""
        return np.bincount(self.triangles.ravel(), np.repeat(self.area / 3.0, 3), len(self.rest))

    @cached_property
    def edge_length(self) -> float:
        """Median of all edges [m]."""
        return float(np.median(np.linalg.norm(self._edges, axis=-1)))

    @cached_property
    def corners(self) -> Int[Array, "triangles 6"]:
        """Corners of each triangle, and opposite to them those of its neighbours; at a free edge a corner of its own."""
        M = len(self.triangles)
        start, end = (np.roll(self.triangles, -k, axis=1).ravel() for k in (1, 2))
        key = np.minimum(start, end) * len(self.rest) + np.maximum(start, end)
        order = np.argsort(key, kind="stable")
        _, first, count = np.unique(key[order], return_index=True, return_counts=True)
        if count.max() > 2:
            edge = order[first[np.argmax(count)]]
            raise InputError(
                f"{count.max()} triangles share the edge {start[edge]}, {end[edge]}",
                where="Shell.triangles",
                expected="at most two",
                remedy="split the surface where sheets meet",
            )
        other = np.arange(3 * M)
        one, two = order[first[count == 2]], order[first[count == 2] + 1]
        if (start[one] == start[two]).any():
            edge = one[np.argmax(start[one] == start[two])]
            raise InputError(
                f"triangles {edge // 3} and its neighbour over the edge {start[edge]}, {end[edge]} face to opposite sides",
                where="Shell.triangles",
                expected="all counter-clockwise from one side",
            )
        other[one], other[two] = two, one
        return np.concatenate([self.triangles, self.triangles.ravel()[other].reshape(M, 3)], axis=1)

    @cached_property
    def free_edges(self) -> Bool[Array, "triangles 3"]:
        """Whether edge e of a triangle, opposite to its corner e, has no neighbour."""
        return self.corners[:, 3:] == self.triangles

    @cached_property
    def axes(self) -> Float[Array, "triangles 2 3"]:
        """Warp and weft in each triangle's plane, unit vectors."""
        normal = self._normal / np.linalg.norm(self._normal, axis=1, keepdims=True)
        laid = np.asarray(self.warp, dtype=np.float64) - normal * (normal @ np.asarray(self.warp))[:, None]
        length = np.linalg.norm(laid, axis=1, keepdims=True)
        along_edge = self._edges[:, 2] / np.linalg.norm(self._edges[:, 2], axis=1, keepdims=True)
        warp = np.where(length > 0.1, laid / np.maximum(length, 1e-12), along_edge)
        return np.stack([warp, np.cross(normal, warp)], axis=1)

    @cached_property
    def inverse(self) -> Float[Array, "triangles 2 2"]:
        """D with [x1 - x0, x2 - x0] D the deformation gradient by warp and weft [1/m]."""
        flat = np.stack([self._edges[:, 2], -self._edges[:, 1]], axis=-1)  # x1 - x0, x2 - x0
        return np.linalg.inv(self.axes @ flat)

    @cached_property
    def gradients(self) -> Float[Array, "triangles 3 2"]:
        """Of the corners' linear functions by warp and weft [1/m]."""
        return np.concatenate([-self.inverse.sum(1, keepdims=True), self.inverse], axis=1)

    @cached_property
    def widths(self) -> Float[Array, "triangles 3"]:
        """2 / (h + h') over each edge [1/m]; at a free edge 1 / h.

        Where a hold ends only the triangle outside bends: there 2 / h for it, and zero for the one inside.
        """
        length = np.linalg.norm(self._edges, axis=-1)
        height = 2.0 * self.area[:, None] / length
        opposite = self._opposite_height
        widths = 2.0 / (height + np.where(self.free_edges, height, opposite))
        if self.held is None:
            return widths
        inside = self.held[self.triangles].all(1, keepdims=True)
        beyond = self.held[self.corners[:, 3:]] & ~self.free_edges
        along_edge = (
            np.stack([self.held[np.roll(self.triangles, -k, axis=1)] for k in (1, 2)]).all(0) & ~self.free_edges
        )
        widths = np.where(along_edge & ~inside & beyond, 2.0 / height, widths)
        return np.where(inside & along_edge & ~beyond, 0.0, widths)

    @property
    def _opposite_height(self) -> Float[Array, "triangles 3"]:
        a, b = (self.rest[np.roll(self.triangles, -k, axis=1)] for k in (1, 2))
        across = np.cross(b - a, self.rest[self.corners[:, 3:]] - a)
        return np.linalg.norm(across, axis=-1) / np.linalg.norm(b - a, axis=-1)

    @cached_property
    def rest_angles(self) -> Float[Array, "triangles 3"]:
        """Between the normals over each edge without stress [rad], as `shell.h` counts them."""
        a, b = (self.rest[np.roll(self.triangles, -k, axis=1)] for k in (1, 2))
        c, d = self.rest[self.triangles], self.rest[self.corners[:, 3:]]
        own, other, edge = np.cross(a - c, b - c), np.cross(b - d, a - d), b - a
        sine = np.einsum("mei,mei->me", np.cross(own, other), edge) / np.linalg.norm(edge, axis=-1)
        angle = np.arctan2(sine, np.einsum("mei,mei->me", own, other))
        return np.where(self.free_edges, 0.0, angle)

    @cached_property
    def flexibility_alone(self) -> Float[Array, " triangles"]:
        """Of the membrane of every triangle by itself, whose corners have a third of its mass each: squared frequency over the membrane's stiffness, for a
        density and a thickness of one [1/m2]."""
        gradients = self.gradients
        B = np.zeros((len(gradients), 3, 3, 2))  # of the strains by the corners' places in the plane
        B[:, 0, :, 0], B[:, 1, :, 1] = gradients[..., 0], gradients[..., 1]
        B[:, 2, :, 0], B[:, 2, :, 1] = gradients[..., 1], gradients[..., 0]
        flat = B.reshape(len(gradients), 3, 6)
        return 3.0 * np.linalg.eigvalsh(flat @ flat.swapaxes(1, 2))[:, -1]

    @cached_property
    def curvatures(self) -> Float[Array, "triangles 3 3"]:
        """n_e n_e^T of each edge by warp and weft, as (11, 22, twice 12)."""
        outward = -self.gradients / np.linalg.norm(self.gradients, axis=-1, keepdims=True)
        x, y = outward[..., 0], outward[..., 1]
        return np.stack([x * x, y * y, 2.0 * x * y], axis=-1)

    @cached_property
    def angle_slopes(self) -> Float[Array, "triangles 3 6"]:
        """Of k_e by the way of each of the six corners along the normal, of a surface that is nearly flat [1/m2]."""
        a, b = (self.rest[np.roll(self.triangles, -k, axis=1)] for k in (1, 2))
        edge = b - a
        squared = np.einsum("mei,mei->me", edge, edge)
        slopes = np.zeros((len(self.triangles), 3, 6))
        height = 2.0 * self.area[:, None] / np.sqrt(squared)
        sides = (self.rest[self.triangles], height, 0), (self.rest[self.corners[:, 3:]], self._opposite_height, 3)
        for place, over, first in sides:
            along = np.einsum("mei,mei->me", place - a, edge) / squared
            own = np.where(self.free_edges, 0.0, -self.widths / over)
            for e in range(3):
                slopes[:, e, first + e] += own[:, e]
                slopes[:, e, (e + 1) % 3] += (along[:, e] - 1.0) * own[:, e]
                slopes[:, e, (e + 2) % 3] -= along[:, e] * own[:, e]
        return slopes

    @cached_property
    def plate_forms(self) -> Float[Array, "6 6 triangles"]:
        """Of the six second derivatives of the bending energy by k_e (`symmetric.PAIRS`) by C11, C22, C12, C33, C13, C23 of the plate."""
        d = np.moveaxis(self.curvatures, 0, -1)  # [edge, component, triangle]
        both = lambda e, f, i, j: d[e, i] * d[f, j] + d[e, j] * d[f, i]
        products = [
            [
                *(d[e, i] * d[f, i] for i in range(2)),
                both(e, f, 0, 1),
                d[e, 2] * d[f, 2],
                both(e, f, 0, 2),
                both(e, f, 1, 2),
            ]
            for e, f in PAIRS
        ]
        return np.array(products) * self.area

    @cached_property
    def _membrane_forms(self) -> Float[Array, "6 3 triangles"]:
        """Of the membrane's flexibility by one over the mass per area of each corner."""
        x, y = self.gradients.T  # [corner, triangle]
        zero = np.zeros_like(x)
        along_x, along_y = np.stack([x, zero, y], -1), np.stack([zero, y, x], -1)  # strains by a corner's way
        return 3.0 * (pairs_of(along_x) + pairs_of(along_y))

    @cached_property
    def _bending_forms(self) -> Float[Array, "6 6 triangles"]:
        """Of the flexibility of k_e by one over each corner's share of the mass."""
        return pairs_of(self.angle_slopes.transpose(2, 0, 1))

    def membrane_flexibility(self, mass: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts 6 triangles"]:
        """Six numbers (`symmetric.PAIRS`) of each triangle's strains by forces that go with them; mass of the vertices [kg], shared out by area."""
        return self._flexibility(
            self._membrane_forms, torch.as_tensor(self.vertex_area).to(mass) / mass, self.triangles
        )

    def bending_flexibility(self, mass: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts 6 triangles"]:
        """The same of k_e; mass of the vertices [kg], shared out among the elements at each."""
        count = np.bincount(self.corners.ravel(), minlength=len(self.rest))
        return self._flexibility(self._bending_forms, torch.as_tensor(count).to(mass) / mass, self.corners)

    @staticmethod
    def _flexibility(forms: Array, inverse_mass: Tensor, corners: Array) -> Tensor:
        """The sum over corners of forms [6, C, M] times the inverse of each one's mass."""
        at = inverse_mass[..., torch.as_tensor(corners.T, device=inverse_mass.device)]
        return (torch.as_tensor(forms).to(at) * at[..., None, :, :]).sum(-2)
