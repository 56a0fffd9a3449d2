"""Thin bodies: a cloth as MuJoCo's two-dimensional flex, and a rope's shape, which is meshed and simulated as a solid.

The cloth is simulated as its middle surface and filmed as a closed skin around it, so that rays, shadows and truth treat
it like any other body. Ropes that bend right are in `rope.py`.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

import numpy as np

from data.rig.mesh import TetMesh, surface_triangles
from data.rig.shapes import Block, Capsule, RoundedShape
from physreal_core.array_types import Array, Float, Int

_PRISM_TETS = np.array([[0, 1, 2, 5], [0, 1, 5, 4], [0, 4, 5, 3]])
"""Three tetrahedra of a prism whose lower triangle is 0, 1, 2 and whose upper one is 3, 4, 5."""


@dataclass(frozen=True)
class Cloth:
    """A rectangular sheet that lies level, its edges along x and y turned about its middle.

    Attributes:
        centre: of the sheet [m].
        size: edges [m].
        spacing: of the nodes, about [m].
        thickness: of the skin that is filmed [m]; the stiffnesses do not follow from it.
        membrane_stiffness: E t [N/m], the force on a metre of edge for a unit of strain.
        bending_stiffness: D [N m], the moment on a metre of edge for a unit of curvature.
        poissons_ratio: of the membrane.
        areal_density: mass of a square metre [kg/m^2].
        damping: of its stiffness [s].
        turn: about the vertical [rad].
        equilateral: triangles with equal sides, on which the hinges of MuJoCo are an isotropic plate of the stiffness D, and
            a hold that ends at its nodes. False: a square grid, on which they are a softer plate that is no isotropic one;
            the sequences for perception were made with it.
    """

    centre: tuple[float, float, float] = (0.0, 0.0, 0.004)
    size: tuple[float, float] = (0.26, 0.20)
    spacing: float = 0.0125
    thickness: float = 0.0015
    membrane_stiffness: float = 120.0
    bending_stiffness: float = 2.34375e-5
    poissons_ratio: float = 0.2
    areal_density: float = 0.35
    damping: float = 0.003
    turn: float = 0.0
    equilateral: bool = False

    geometry: ClassVar[str] = "planar"

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance of `points` [m] from its surface [m]."""
        cos, sin = math.cos(self.turn), math.sin(self.turn)
        own = np.subtract(points, self.centre) @ np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        half = np.array([*self.size, self.thickness]) / 2
        return Block(tuple(-half), tuple(half)).distance(own)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Corners of the box around it [m]."""
        cos, sin = abs(math.cos(self.turn)), abs(math.sin(self.turn))
        length, width = self.size
        half = np.array([cos * length + sin * width, sin * length + cos * width, self.thickness]) / 2
        return self.centre - half, self.centre + half

    def middle(self) -> Float[Array, "3"]:
        """Centre of volume [m]."""
        return np.asarray(self.centre, float)

    def stiffened(self, share: float) -> "Cloth":
        """The same with both of its stiffnesses so many times as large."""
        return replace(
            self,
            membrane_stiffness=share * self.membrane_stiffness,
            bending_stiffness=share * self.bending_stiffness,
        )

    @property
    def density(self) -> float:
        """Of the sheet as a solid [kg/m^3]."""
        return self.areal_density / self.thickness

    def mesh(self) -> "Sheet":
        """Its middle surface at rest."""
        return mesh_cloth(self)

    def elasticity(self) -> str:
        """Attributes of MuJoCo's elasticity: of the solid sheet that has both stiffnesses."""
        thickness = math.sqrt(12 * (1 - self.poissons_ratio**2) * self.bending_stiffness / self.membrane_stiffness)
        return (
            f'young="{self.membrane_stiffness / thickness:.9g}" poisson="{self.poissons_ratio}" '
            f'thickness="{thickness:.9g}" elastic2d="both"'
        )


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

    @property
    def elements(self) -> Int[Array, "F 3"]:
        """Vertex indices of the triangles."""
        return self.triangles

    def skin_nodes(self, nodes: Int[Array, " B"]) -> Int[Array, " C"]:
        """The nodes of the skin that belong to nodes of the middle surface."""
        return np.concatenate([nodes, nodes + len(self.vertices)])

    def lumped_mass(self, density: float) -> Float[Array, " V"]:
        """A third of each triangle's mass at each of its nodes [kg]; `density` [kg/m^3] of a solid is not asked."""
        return self.surface_shares() * self.areal_density * self.volumes().sum() / self.thickness

    def volumes(self) -> Float[Array, " F"]:
        """Of each triangle, as thick as the sheet [m^3]."""
        a, b, c = (self.vertices[self.triangles[:, k]] for k in range(3))
        return self.thickness * np.linalg.norm(np.cross(b - a, c - a), axis=1) / 2

    def centres(self) -> Float[Array, "F 3"]:
        """Middle of each triangle [m]."""
        return self.vertices[self.triangles].mean(axis=1)

    def shared(self, density: Float[Array, " F"]) -> Float[Array, " V"]:
        """Share of the mass at each node where each triangle has a density of its own; sums to one."""
        mass = np.bincount(self.triangles.ravel(), np.repeat(self.volumes() * density, 3), minlength=len(self.vertices))
        return mass / mass.sum()

    def surface_shares(self) -> Float[Array, " V"]:
        """Share of the surface's area at each node; sums to one."""
        return self.shared(np.ones(len(self.triangles)))

    def resting_areas(self) -> Float[Array, " V"]:
        """Area with which each node lies on the table [m^2]."""
        return self.surface_shares() * self.volumes().sum() / self.thickness

    def skin(self) -> TetMesh:
        """The closed body around the sheet at rest: nodes of the lower side, then of the upper."""
        count = len(self.vertices)
        corners = np.concatenate([self.triangles, self.triangles + count], axis=1)
        tets = conforming(corners)
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
    """The middle surface at rest, level, turned about its middle."""
    flat, triangles = (_equilateral if cloth.equilateral else _square)(cloth.size, cloth.spacing)
    cos, sin = np.cos(cloth.turn), np.sin(cloth.turn)
    flat = flat @ np.array([[cos, sin], [-sin, cos]])
    vertices = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1) + cloth.centre
    return Sheet(vertices, triangles, cloth.areal_density, cloth.thickness)


def _equilateral(size: tuple[float, float], spacing: float) -> tuple[Float[Array, "V 2"], Int[Array, "F 3"]]:
    """Rows along y, every other one shifted by half a triangle; half triangles along the two edges that cross the rows."""
    rows, columns = round(size[0] / (spacing * math.sqrt(3) / 2)), round(size[1] / spacing)
    even = np.linspace(-0.5, 0.5, columns + 1)
    odd = np.concatenate([even[:1], (even[:-1] + even[1:]) / 2, even[-1:]])
    places = [even if row % 2 == 0 else odd for row in range(rows + 1)]
    starts = np.cumsum([0, *map(len, places)])
    across, column = np.arange(columns), np.arange(columns + 1)
    triangles = []
    for row in range(rows):
        e, o = (starts[row], starts[row + 1]) if row % 2 == 0 else (starts[row + 1], starts[row])
        part = np.concatenate(
            [
                np.stack([e + across, o + across + 1, e + across + 1], axis=1),
                np.stack([e + column, o + column, o + column + 1], axis=1),
            ]
        )
        triangles.append(part if row % 2 == 0 else part[:, [0, 2, 1]])
    along = np.repeat(np.linspace(-0.5, 0.5, rows + 1), [len(place) for place in places])
    return np.stack([along * size[0], np.concatenate(places) * size[1]], axis=1), np.concatenate(triangles)


def _square(size: tuple[float, float], spacing: float) -> tuple[Float[Array, "V 2"], Int[Array, "F 3"]]:
    """A regular grid of triangles whose diagonals alternate, so that no direction is preferred."""
    columns, rows = (max(2, round(edge / spacing)) for edge in size)
    u, v = np.meshgrid(np.linspace(-0.5, 0.5, columns + 1), np.linspace(-0.5, 0.5, rows + 1))
    flat = np.stack([u.ravel() * size[0], v.ravel() * size[1]], axis=1)
    number = np.arange(len(flat)).reshape(rows + 1, columns + 1)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1]))
    row, column = np.indices((rows, columns)).reshape(2, -1)
    odd = ((row + column) % 2 == 1)[:, None]
    first = np.where(odd, np.stack([a, b, d], 1), np.stack([a, b, c], 1))
    second = np.where(odd, np.stack([b, c, d], 1), np.stack([a, c, d], 1))
    return flat, np.concatenate([first, second])


def rope_body(path: Float[Array, "N 2"], radius: float = 0.007) -> RoundedShape:
    """A rope that lies on z = 0 along `path` (x, y) [m]."""
    points = [(float(x), float(y), radius) for x, y in path]
    pairs = pairwise(points)
    return RoundedShape(tuple(Capsule(start, end, radius) for start, end in pairs), blend=0.002)


def conforming(prisms: Int[Array, "F 6"]) -> Int[Array, "M 4"]:
    """Tetrahedra of prisms; each prism begins at its corner of least number, so that neighbours share diagonals."""
    turns = np.argsort(prisms[:, :3], axis=1)
    even = np.linalg.det(np.eye(3)[turns]) > 0
    low, high = (np.take_along_axis(side, turns, axis=1) for side in (prisms[:, :3], prisms[:, 3:]))
    tets = np.concatenate([low, high], axis=1)[:, _PRISM_TETS]
    tets[~even] = tets[~even][..., [0, 2, 1, 3]]
    return tets.reshape(-1, 4)
