"""What stands around a twin: a box, a cup, a shelf, as a mesh file says."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.geometry.distance_lattice import distance_lattice
from physreal_core.geometry.mesh import Mesh, load_mesh
from physreal_core.geometry.separation import connected_parts
from physreal_core.geometry.surface import sample_surface, surface_gaussians
from physreal_core.rendering import Gaussians
from physreal_core.simulation import Body, Solids

LARGEST_BALL = 0.03
"""Radius of a ball that solids stop [m]; a larger one comes so near with its middle."""

_POINTS = 5000
"""Gaussians that show the surface in pictures."""

_SHADE = 0.3
"""Share of the light that comes from above."""

_CELLS = 0.4
"""Of the lattice, over the thickness of the thinnest wall."""

_GREY = 0.62
"""Colour of a mesh without one."""


@dataclass(frozen=True)
class Scene:
    """Solids that stand still.

    Attributes:
        path: of the file.
        mesh: all of them, in the world [m], with colours.
        solids: as the simulator takes them.
    """

    path: Path
    mesh: Mesh
    solids: Solids

    @classmethod
    def read(cls, path: Path, body: Body) -> Scene:
        """A mesh file in the world's frame, in metres and z up; its pieces may touch each other and overlap.

        Args:
            path: of a .glb, .stl, .obj or .ply.
            body: that it stands around. Its particles, and the thinnest wall, say how finely distances are taken.

        Raises:
            InputError: the file cannot be read, a piece is not closed, or the body begins within one.
        """
        mesh = load_mesh(path)
        if mesh.colours is None:
            mesh = replace(mesh, colours=np.full_like(mesh.vertices, _GREY))
        part = connected_parts(mesh)
        pieces = [replace(mesh, faces=mesh.faces[part == number]) for number in range(part.max() + 1)]
        cell = min(0.5 * body.spacing, *(_CELLS * _thickness(piece) for piece in pieces))
        lattice = distance_lattice(pieces, cell, max(float(body.reach.max()), LARGEST_BALL), str(path))
        solids = Solids(lattice.distance, lattice.origin, lattice.cell)
        solids.reach(body)  # raises here, before anything is simulated, where the body begins within one
        return cls(path, mesh, solids)

    @cached_property
    def look(self) -> tuple[Gaussians, Float[Tensor, "gaussians 3"]]:
        """Gaussians that show the surface in pictures, brighter where it faces up, and its normals there."""
        points = sample_surface(self.mesh, _POINTS)
        points = replace(points, colours=points.colours * (1.0 - _SHADE + _SHADE * points.normals[:, 2:].clip(min=0.0)))
        return surface_gaussians(points), torch.as_tensor(points.normals, dtype=torch.float32)


def _thickness(mesh: Mesh) -> float:
    """Of a wall that is wide for its thickness [m]: twice its volume over its area; of a ball a third of its diameter."""
    return 2.0 * abs(mesh.volume) / mesh.area
