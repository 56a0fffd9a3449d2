"""A rope as MuJoCo's discrete elastic rod: simulated as its centre line and filmed as a closed tube around it."""

import math
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from data.rig.mesh import TetMesh, surface_triangles
from data.rig.shapes import Capsule
from data.rig.thin import conforming
from physreal_core.array_types import Array, Float, Int

AROUND = 12
"""Sides of the tube. Its cross-section has the area of the rope's."""

_STIFFNESSES = ("stretching_stiffness", "bending_stiffness", "twisting_stiffness")


@dataclass(frozen=True)
class Rope:
    """A rope that lies straight.

    Attributes:
        start, end: of its centre line at rest [m].
        spacing: of the nodes, about [m].
        thickness: its diameter [m]; the stiffnesses do not follow from it.
        stretching_stiffness: E A [N].
        bending_stiffness: E I [N m^2], the same in all directions.
        twisting_stiffness: G J [N m^2].
        mass_per_length: [kg/m].
        damping: of bending and twisting stiffness [s]; stretching has none.
    """

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    spacing: float
    thickness: float
    stretching_stiffness: float
    bending_stiffness: float
    twisting_stiffness: float
    mass_per_length: float
    damping: float = 0.0

    geometry: ClassVar[str] = "linear"

    def distance(self, points: Float[Array, "... 3"]) -> Float[Array, "..."]:
        """Signed distance of `points` [m] from its surface [m]; its ends are round."""
        return Capsule(self.start, self.end, self.thickness / 2).distance(points)

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Corners of the box around it [m]; its ends are flat."""
        ends = np.array([self.start, self.end])
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        beyond = self.thickness / 2 * np.sqrt(np.maximum(1 - along**2, 0))
        return ends.min(axis=0) - beyond, ends.max(axis=0) + beyond

    def middle(self) -> Float[Array, "3"]:
        """Centre of volume [m]."""
        return np.add(self.start, self.end) / 2

    def stiffened(self, share: float) -> "Rope":
        """The same with all of its stiffnesses so many times as large."""
        return replace(self, **{name: share * getattr(self, name) for name in _STIFFNESSES})

    @property
    def density(self) -> float:
        """Of the rope as a solid round bar [kg/m^3]."""
        return self.mass_per_length / (math.pi * self.thickness**2 / 4)

    def mesh(self) -> "Line":
        """Its centre line at rest."""
        count = round(math.dist(self.start, self.end) / self.spacing)
        share = np.linspace(0, 1, count + 1)[:, None]
        vertices = (1 - share) * np.asarray(self.start) + share * np.asarray(self.end)
        return Line(vertices, self.mass_per_length, self.thickness)

    def elasticity(self) -> str:
        """Attributes of MuJoCo's elasticity: of the solid round bar of this thickness that has both stiffnesses."""
        fourth = math.pi * (self.thickness / 2) ** 4
        young, shear = 4 * self.bending_stiffness / fourth, 2 * self.twisting_stiffness / fourth
        return f'young="{young:.9g}" shear="{shear:.9g}"'


@dataclass(frozen=True)
class Line:
    """A straight centre line at rest; reads like a `TetMesh` where a world needs one.

    Attributes:
        vertices: [V, 3] m, in order and evenly spaced.
        mass_per_length: [kg/m].
        thickness: diameter [m].
    """

    vertices: Float[Array, "V 3"]
    mass_per_length: float
    thickness: float

    @property
    def elements(self) -> Int[Array, "S 2"]:
        """Vertex indices of the segments."""
        first = np.arange(len(self.vertices) - 1)
        return np.stack([first, first + 1], axis=1)

    @property
    def spacing(self) -> float:
        """Length of a segment [m]."""
        return float(np.linalg.norm(self.vertices[1] - self.vertices[0]))

    def lumped_mass(self, density: float) -> Float[Array, " V"]:
        """Half of each segment's mass at each of its nodes [kg]; `density` of the solid is not asked."""
        return self.surface_shares() * self.mass_per_length * self.spacing * len(self.elements)

    def volumes(self) -> Float[Array, " S"]:
        """Of each segment [m^3]."""
        return np.full(len(self.elements), math.pi * self.thickness**2 / 4 * self.spacing)

    def centres(self) -> Float[Array, "S 3"]:
        """Middle of each segment [m]."""
        return self.vertices[self.elements].mean(axis=1)

    def shared(self, density: Float[Array, " S"]) -> Float[Array, " V"]:
        """Share of the mass at each node where each segment has a density of its own; sums to one."""
        mass = np.bincount(self.elements.ravel(), np.repeat(density, 2), minlength=len(self.vertices))
        return mass / mass.sum()

    def surface_shares(self) -> Float[Array, " V"]:
        """Share of the surface's area at each node; sums to one."""
        return self.shared(np.ones(len(self.elements)))

    def resting_areas(self) -> Float[Array, " V"]:
        """Area with which each node lies on the table [m^2]: that of a square rope of the same section, as high as it is thick."""
        section = math.pi * self.thickness / 4
        return self.surface_shares() * section * self.spacing * len(self.elements)

    def directors(self) -> Float[Array, "S 3"]:
        """A unit vector across every segment at rest."""
        tangent = (self.vertices[1] - self.vertices[0]) / self.spacing
        across = np.cross(tangent, [0.0, 0.0, 1.0] if abs(tangent[2]) < 0.9 else [1.0, 0.0, 0.0])
        return np.tile(across / np.linalg.norm(across), (len(self.elements), 1))

    def skin(self) -> TetMesh:
        """The closed tube at rest: at every node of the line a node in its middle and `AROUND` nodes around it."""
        ring = np.arange(AROUND)
        wedge = np.stack([np.zeros_like(ring), 1 + ring, 1 + (ring + 1) % AROUND], axis=1)
        first = (AROUND + 1) * np.arange(len(self.elements))[:, None, None]
        prisms = np.concatenate([first + wedge, first + wedge + AROUND + 1], axis=2).reshape(-1, 6)
        tets = conforming(prisms)
        return TetMesh(self.thickened(self.vertices, self.directors()), tets, surface_triangles(tets))

    def skin_nodes(self, nodes: Int[Array, " B"]) -> Int[Array, " C"]:
        """The nodes of the skin that belong to nodes of the centre line."""
        return ((AROUND + 1) * nodes[:, None] + np.arange(AROUND + 1)).ravel()

    def thickened(self, vertices: Float[Array, "*T V 3"], directors: Float[Array, "*T S 3"]) -> Float[Array, "*T W 3"]:
        """The skin [m] where the centre line is at `vertices` [m] and its segments are turned to unit `directors`."""
        tangent = _at_nodes(np.diff(vertices, axis=-2))
        across = _at_nodes(directors)
        across = _unit(across - (across * tangent).sum(axis=-1, keepdims=True) * tangent)
        third = np.cross(tangent, across)
        angle = 2 * np.pi * np.arange(AROUND) / AROUND
        radius = self.thickness / 2 * math.sqrt(2 * math.pi / (AROUND * math.sin(2 * math.pi / AROUND)))
        ring = np.cos(angle)[:, None] * across[..., None, :] + np.sin(angle)[:, None] * third[..., None, :]
        skin = vertices[..., None, :] + np.concatenate([np.zeros_like(ring[..., :1, :]), radius * ring], axis=-2)
        return skin.reshape(*vertices.shape[:-2], -1, 3)


def _at_nodes(of_segments: Float[Array, "*T S 3"]) -> Float[Array, "*T V 3"]:
    """Unit vectors at nodes, each the mean of those of the segments that meet there."""
    one = _unit(of_segments)
    return _unit(np.concatenate([one[..., :1, :], one[..., 1:, :] + one[..., :-1, :], one[..., -1:, :]], axis=-2))


def _unit(vectors: Float[Array, "... 3"]) -> Float[Array, "... 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
