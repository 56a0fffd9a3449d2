"""A shell: triangles with membrane and bending stiffness, whose vertices are the particles of a body.

Membrane: St. Venant-Kirchhoff under plane stress, constant in a triangle. Bending: Kirchhoff's plate on hinges without further
unknowns (as Onate and Zarate, Int. J. Numer. Meth. Eng. 47, 2000: rotation-free triangles). With theta_e the angle between the normals on
both sides of edge e, h and h' the heights of its two triangles over it and n_e its normal in the triangle's plane, the curvature of a triangle is

    kappa = sum_e k_e n_e n_e^T ,   k_e = 2 (theta_e - rest angle) / (h + h') ,

that of the normals which go linearly from centre to centre. Where a hand's hold ends, k_e is 2 (theta_e - rest angle) / h of the triangle outside and
nothing of the one inside, which does not bend. At a free edge k_e is what leaves no moment across it. Where all triangles are
alike (equilateral, or cells cut along diagonals of one direction) it is exact for every quadratic surface. On other meshes it depends on them:
moving the vertices of such a mesh by a fifth of a cell makes it a few per cent too stiff, and where diagonals alternate it is 2.5 times too stiff
against twisting (docs/simulation.md).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch

from physreal_core.array_types import Array, Float, Int, Tensor
from physreal_core.errors import InputError
from physreal_core.simulation.body import Body
from physreal_core.simulation.contact.surface import PATH, SHARE, Surface, never_touching
from physreal_core.simulation.parameters import Parameters
from physreal_core.simulation.thin.incidence import Incidence
from physreal_core.simulation.thin.rows import SHELL, SHELL_STIFFNESS
from physreal_core.simulation.thin.stiffness import shell_fastest, shell_stiffness
from physreal_core.simulation.thin.triangles import Triangles

STRETCH_LIMIT = 0.001
"""Of a sheet that hangs by its longest side's width: by how much its own weight may stretch it where it is held, at least. A stiffer membrane
counts as one that stretches so much, so that steps need not be shorter (docs/simulation.md, "Stiff fabric")."""
STANDARD_GRAVITY = 9.81


@dataclass(frozen=True)
class Shell(Triangles):
    """The triangles of a body of vertices, with the stiffness of a sheet; see `Triangles` for the arguments."""

    element = "Shell"
    framed = False
    terms = ("bending", "fabric", "fibres", "viscosity", "surface_drag")
    stiffness_rows = SHELL_STIFFNESS.count
    drag_rows = 1

    # --- as the step sees it ------------------------------------------------------------------------------------

    def constants(self) -> Float[Array, "rows triangles"]:
        """Rows `SHELL` of every triangle."""
        columns = {
            "inverse": self.inverse.reshape(-1, 4),
            "area": self.area[:, None],
            "width": self.widths,
            "rest_angle": self.rest_angles,
            "neighbour": ~self.free_edges,
        }
        return np.concatenate([columns[name].astype(np.float64) for name, _ in SHELL.sizes], axis=1).T

    @property
    def own(self) -> Int[Array, "triangles 3"]:
        """See `Elements`."""
        return self.triangles

    @property
    def half_height(self) -> float:
        """Half of the thickness [m]."""
        return self.thickness / 2.0

    @cached_property
    def surface(self) -> Surface:
        """What layers touch with."""
        start, end = (np.roll(self.triangles, -k, axis=1).ravel() for k in (1, 2))
        edges, first = np.unique(np.sort(np.stack([start, end], 1), axis=1), axis=0, return_index=True)
        lengths = np.linalg.norm(self._edges, axis=-1).ravel()[first]
        weight = self.vertex_area / self.vertex_area.mean()
        near = never_touching(edges, lengths, PATH * self.thickness, weight)
        reach, usual = np.full(len(weight), self.half_height), float(np.median(lengths))
        return Surface(self.triangles, edges, reach, SHARE * self.thickness, weight, near, usual)

    def stiffness(self, parameters: Parameters) -> Float[Tensor, "*rollouts stiffness triangles"]:
        """Rows `SHELL_STIFFNESS`, see `shell_stiffness`."""
        return shell_stiffness(self, parameters)

    @property
    def drag_area(self) -> Float[Array, " vertices"]:
        """A third of the triangles around each vertex [m2]."""
        return self.vertex_area

    def drag(self, coefficient: Float[Tensor, "*rollouts vertices"]) -> Float[Tensor, "*rollouts 1 triangles"]:
        """The mean over each triangle's corners [kg/m3]."""
        return coefficient[..., torch.as_tensor(self.triangles, device=coefficient.device)].mean(-1)[..., None, :]

    def fastest(self, parameters: Parameters, mass: Float[Tensor, "*rollouts vertices"]) -> tuple[float, float]:
        """Upper bounds of the squared frequency [1/s2] and of the decay [1/s], see `shell_fastest`."""
        return shell_fastest(self, parameters, mass)

    # --- its motion ---------------------------------------------------------------------------------------------

    def deformation(
        self, x: Float[Tensor, "*batch vertices 3"], director: None = None
    ) -> Float[Tensor, "*batch vertices 3 3"]:
        """Deformation gradients of the vertices at x [m], the mean of the triangles around each; a normal stays as long as it is."""
        flat = x.reshape(-1, *x.shape[-2:])
        first_axes = flat.movedim((1, 2), (0, 1))  # [N, 3, all others]: rows of memory are gathered
        a, b, c = self._incidence.at_corners(first_axes)
        ways = b - a, c - a, _unit(torch.linalg.cross(b - a, c - a, dim=1))
        directions = torch.as_tensor(self._weighed_directions[..., None, :, None]).to(x)
        F = sum(way[:, :, None] * along for way, along in zip(ways, directions, strict=True))
        mean = self._incidence.around(F) / torch.as_tensor(3.0 * self.vertex_area[:, None, None, None]).to(x)
        return mean.movedim(3, 0).reshape(*x.shape, 3)

    @cached_property
    def _weighed_directions(self) -> Float[Array, "3 triangles axes"]:
        """What the ways along two edges and the normal are multiplied by in the deformation gradient, times the area."""
        normal = self._normal / np.linalg.norm(self._normal, axis=1, keepdims=True)
        return self.area[:, None] * np.stack([*np.moveaxis(self.inverse @ self.axes, 1, 0), normal])

    @cached_property
    def _incidence(self) -> Incidence:
        return Incidence(self.triangles, len(self.rest))


def _unit(vectors: Float[Tensor, "triangles 3 others"]) -> Float[Tensor, "triangles 3 others"]:
    return vectors / vectors.square().sum(1, keepdim=True).sqrt().clamp_min(1e-30)


def shell_body(
    vertices: Float[Array, "vertices 3"],
    triangles: Int[Array, "triangles 3"],
    thickness: float,
    density: float,
    rest: Float[Array, "vertices 3"] | None = None,
    warp: tuple[float, float, float] = (1.0, 0.0, 0.0),
    *,
    stretch_limit: float | None = STRETCH_LIMIT,
) -> Body:
    """A body that is a shell.

    Args:
        vertices: where the rollout starts [m].
        triangles: vertices of each, counter-clockwise from one side.
        thickness: [m].
        density: of the material [kg/m3]; the mass of a square metre is thickness times that.
        rest: where the vertices are without stress [m]; `vertices` by default.
        warp: direction of the first stiffness of a fabric.
        stretch_limit: by how much its own weight may stretch the sheet, hung up along an edge across its longest side, where it is held; what
            is stiffer counts as stretching so much. None for no limit: steps are then as short as the stiffness asks for.

    Raises:
        InputError: a vertex without a triangle, or triangles that are no surface.
    """
    vertices = np.asarray(vertices, dtype=np.float64)
    rest = vertices if rest is None else np.asarray(rest, dtype=np.float64)
    if stretch_limit is not None and not stretch_limit > 0:
        raise InputError(f"{stretch_limit}", where="shell_body.stretch_limit", expected="a positive share, or None")
    largest = None if stretch_limit is None else _weight(rest, thickness, density) / stretch_limit
    shell = Shell(triangles, thickness, rest, warp, float(density), largest)
    if len(shell.rest) != len(vertices):
        raise InputError(
            f"{len(shell.rest)} vertices", where="Shell.rest", expected=f"{len(vertices)}, as at the start"
        )
    if not shell.vertex_area.min() > 0:
        raise InputError(
            f"vertex {int(np.argmin(shell.vertex_area))} has no triangle",
            where="Shell.triangles",
            expected="every vertex in one at least",
        )
    volume = shell.vertex_area * thickness
    return Body(vertices, volume, np.full(len(vertices), float(density)), shell.edge_length, shell)


def _weight(rest: Float[Array, "vertices 3"], thickness: float, density: float) -> float:
    """Of a strip of the sheet a metre wide and as long as its longest side [N/m]."""
    centred = rest - rest.mean(0)
    along = centred @ np.linalg.eigh(centred.T @ centred)[1]
    return density * thickness * STANDARD_GRAVITY * float(np.ptp(along, axis=0).max())
