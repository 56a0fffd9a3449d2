"""Tetrahedra in a closed triangle mesh, by the mesher of the rig."""

import numpy as np

from data.rig.mesh import TetMesh, mesh_shape
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.geometry.mesh import Mesh

CUBES = 600
"""About how many cubes, of five tetrahedra each, fill the body."""
_LEAST = 0.5  # of a cube, the thinnest body
_STEP = 1e-4  # [m], of the gradient's difference


class Inside:
    """What a closed mesh encloses, as the mesher asks for it.

    Args:
        mesh: closed, [m].
    """

    def __init__(self, mesh: Mesh) -> None:
        import open3d as o3d

        self._mesh, self._centre = mesh, mesh.vertices.mean(axis=0)
        self._tensor, self._scene = o3d.core.Tensor, o3d.t.geometry.RaycastingScene()
        vertices, faces = (mesh.vertices - self._centre).astype(np.float32), mesh.faces.astype(np.uint32)
        self._scene.add_triangles(self._tensor(vertices), self._tensor(faces))

    def bounds(self) -> tuple[Float[Array, "3"], Float[Array, "3"]]:
        """Corners of the box around it [m]."""
        return self._mesh.bounds

    def distance(self, points: Float[Array, "P 3"]) -> Float[Array, " P"]:
        """Signed distance of points [m] from the surface [m], negative inside."""
        return self._scene.compute_signed_distance(self._tensor((points - self._centre).astype(np.float32))).numpy()

    def gradient(self, points: Float[Array, "P 3"]) -> Float[Array, "P 3"]:
        """Central difference of the distance, shape [P, 3]."""
        sides = [self.distance(points + axis) - self.distance(points - axis) for axis in _STEP * np.eye(3)]
        return np.stack(sides, axis=-1) / (2 * _STEP)


def edge_of(mesh: Mesh, cubes: int = CUBES) -> float:
    """Edge of a cube [m] of which so many have the volume of a closed mesh [m]."""
    return float(np.cbrt(mesh.volume / cubes))


def tetrahedra(mesh: Mesh, edge: float) -> TetMesh:
    """Fills a closed mesh [m] with cubes of an edge [m], five tetrahedra each, their outer nodes drawn onto its surface.

    Raises:
        InputError: the body is thinner than half of a cube; twice its volume over its surface is the thickness of a plate.
    """
    thickness = 2.0 * mesh.volume / mesh.area
    if thickness < _LEAST * edge:
        raise InputError(
            f"the body is about {1e3 * thickness:.1f} mm thick, and the cubes that fill it {1e3 * edge:.1f} mm",
            where="physreal export",
            expected=f"at least {_LEAST:g} of a cube",
            remedy="fit it with `geometry: planar` or `linear` in params.yaml, if it is a cloth or a rope",
        )
    return mesh_shape(Inside(mesh), edge)
