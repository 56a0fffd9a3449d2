"""Thin bodies: a cloth as MuJoCo's two-dimensional flex, and a rope's shape, which is meshed and simulated as a solid.

The cloth is simulated as its middle surface and filmed as a closed skin around it, so that rays, shadows and truth treat
it like any other body.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from data.rig.mesh import TetMesh, surface_triangles
from data.rig.shapes import Capsule, RoundedShape
from physreal_core.array_types import Array, Float, Int

_PRISM_TETS = np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])
"""Three tetrahedra of a prism whose lower triangle is 0, 1, 2 and whose upper one is 3, 4, 5."""


@dataclass(frozen=True)
class Cloth:
    """A rectangular sheet that lies level, its edges along x and y turned about its middle.

    Attributes:
        middle: of the sheet [m].
        size: edges [m].
        spacing: of the nodes, about [m].
        thickness: of the sheet, for bending and for the skin that is filmed [m].
        youngs_modulus, poissons_ratio: of its material [Pa]; membrane and bending stiffness follow from the thickness.
        areal_density: mass of a square metre [kg/m^2].
        damping: of its stiffness [s].
        turn: about the vertical [rad].
    """

    middle: tuple[float, float, float] = (0.0, 0.0, 0.004)
    size: tuple[float, float] = (0.26, 0.20)
    spacing: float = 0.0125
    thickness: float = 0.0015
    youngs_modulus: float = 8e4
    poissons_ratio: float = 0.2
    areal_density: float = 0.35
    damping: float = 0.003
    turn: float = 0.0


@dataclass(frozen=True)
class Sheet:
    """Triangles of a middle surface at rest; reads like a `TetMesh` where a world needs one.

    Attributes:
        vertices: [V, 3] m.
        triangles: [F, 3] vertex indices, counter-clockwise seen from above.
        areal_density: mass of a square metre [kg/m^2].
        thickness: [m].
    """

    vertices: Float[Array, "V 3"]
    triangles: Int[Array, "F 3"]
    areal_density: float
    thickness: float

    def lumped_mass(self, density: float) -> Float[Array, " V"]:
        """A third of each triangle's mass at each of its nodes [kg]; `density` of the solid is not asked."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2
        third = np.repeat(area * self.areal_density / 3, 3)
        return np.bincount(self.triangles.ravel(), third, minlength=len(self.vertices))

    def skin(self) -> TetMesh:
        """The closed body around the sheet at rest: nodes of the lower side, then of the upper."""
        count = len(self.vertices)
        corners = np.concatenate([self.triangles, self.triangles + count], axis=1)
        tets = _conforming(corners)
        return TetMesh(self.thickened(self.vertices), tets, surface_triangles(tets))

    def thickened(self, vertices: Float[Array, "*T V 3"]) -> Float[Array, "*T W 3"]:
        """Both sides of the skin [m] where the middle surface is at `vertices` [m]."""
        normal = np.zeros_like(vertices)
        a, b, c = (vertices[..., self.triangles[:, k], :] for k in range(3))
        across = np.cross(b - a, c - a)
        for k in range(3):
            np.add.at(normal, (..., self.triangles[:, k], slice(None)), across)
        normal *= self.thickness / 2 / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        return np.concatenate([vertices - normal, vertices + normal], axis=-2)


def mesh_cloth(cloth: Cloth) -> Sheet:
    """A regular grid of triangles whose diagonals alternate, so that no direction is preferred."""
    columns, rows = (max(2, round(edge / cloth.spacing)) for edge in cloth.size)
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.5, 0.5, rows + 1))
    flat = np.stack([u.ravel() * cloth.size[0], v.ravel() * cloth.size[1]], axis=1)
    cos, sin = np.cos(cloth.turn), np.sin(cloth.turn)
    flat = flat @ np.array([[cos, sin], [-sin, cos]])
    vertices = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1) + cloth.middle
    number = np.arange(len(flat)).reshape(rows + 1, columns + 1)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    row, column = np.indices((rows, columns)).reshape(2, -1)
    odd = ((row + column) % 2 == 1)[:, None]
    first = np.where(odd, np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    second = np.where(odd, np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    return Sheet(vertices, np.concatenate([first, second]), cloth.areal_density, cloth.thickness)


def rope_body(path: Float[Array, "N 2"], radius: float = 0.007) -> RoundedShape:
    """A rope that lies on z = 0 along `path` (x, y) [m]."""
    points = [(float(x), float(y), radius) for x, y in path]
    pairs = pairwise(points)
    return RoundedShape(tuple(Capsule(start, end, radius) for start, end in pairs), blend=0.002)


def _conforming(prisms: Int[Array, "F 6"]) -> Int[Array, "M 4"]:
    """Tetrahedra of prisms; each prism begins at its corner of least number, so that neighbours share diagonals."""
    turns = np.argsort(prisms[:, :3], axis=1)
    even = np.linalg.det(np.eye(3)[turns]) > 0
    low, high = (np.take_along_axis(side, turns, axis=1) for side in (prisms[:, :3], prisms[:, 3:]))
    tets = np.concatenate([low, high], axis=1)[:, _PRISM_TETS]
    tets[~even] = tets[~even][..., [0, 2, 1, 3]]
    return tets.reshape(-1, 4)
