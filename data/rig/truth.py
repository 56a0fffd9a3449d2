"""What is known by construction about a capture of the rig: true tracks, masks and shapes. Read for scoring alone."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.rig.raycast import Raycaster, pixel_rays
from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError


@dataclass(frozen=True)
class SurfacePoints:
    """Material points on the object's surface: a triangle (index into `Truth.faces`) and the weights of its corners."""

    triangles: Int[Array, " P"]
    weights: Float[Array, "P 3"]


@dataclass(frozen=True)
class Truth:
    """The contents of truth.npz.

    Attributes:
        youngs_modulus, poissons_ratio, density, friction_coefficient, damping: [Pa], 1, [kg/m^3], 1, [s].
        rest_vertices: [V, 3] m, stress-free; in the world frame, where the object lay before it sank under its weight.
        tets: [M, 4] and faces: [F, 3], vertex indices.
        vertices: [T, V, 3] m, world.
        gripped: vertices that the hand holds.
        hand: [T, 3] m, displacement of the hand since frame 0.
        hand_vertices: [H, 3] m at frame 0, and hand_faces [G, 3].
        T_world_prior: takes shape_prior.glb (rotation, translation, scale) onto `rest_vertices`.
        fps: frames per second.
    """

    youngs_modulus: float
    poissons_ratio: float
    density: float
    friction_coefficient: float
    damping: float
    rest_vertices: Float[Array, "V 3"]
    tets: Int[Array, "M 4"]
    faces: Int[Array, "F 3"]
    vertices: Float[Array, "T V 3"]
    gripped: Int[Array, " B"]
    hand: Float[Array, "T 3"]
    hand_vertices: Float[Array, "H 3"]
    hand_faces: Int[Array, "G 3"]
    T_world_prior: Float[Array, "4 4"]
    fps: float

    def attach(self, points: Float[Array, "P 3"], frame: int = 0) -> SurfacePoints:
        """The material points nearest to `points` [m, world] at `frame`."""
        near = Raycaster(self.vertices[frame], self.faces).closest(points)
        return SurfacePoints(near.triangle, near.weights)

    def follow(self, points: SurfacePoints) -> Float[Array, "T P 3"]:
        """Where material points are in every frame [m, world]."""
        corners = self.vertices[:, self.faces[points.triangles]]
        return np.einsum("tpck,pc->tpk", corners, points.weights)

    def masks(
        self, K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"], width: int, height: int, frame: int
    ) -> tuple[Bool[Array, "H W"], Bool[Array, "H W"]]:
        """True masks of the object and of the hand as the camera sees them, each hiding the other."""
        points = np.concatenate([self.vertices[frame], self.hand_vertices + self.hand[frame]])
        faces = np.concatenate([self.faces, self.hand_faces + len(self.vertices[frame])])
        eye, directions, _ = pixel_rays(K, T_world_camera, width, height)
        hits = Raycaster(points, faces).cast(np.broadcast_to(eye, directions.shape), directions)
        triangle = hits.triangle.reshape(height, width)
        return (triangle >= 0) & (triangle < len(self.faces)), triangle >= len(self.faces)

    def visible(
        self, points: SurfacePoints, T_world_camera: Float[Array, "4 4"], frame: int, tolerance: float = 0.003
    ) -> Bool[Array, " P"]:
        """Whether material points are seen from the camera at `frame`: nothing is more than `tolerance` [m] before
        them."""
        eye, here = T_world_camera[:3, 3], self.follow(points)[frame]
        everything = np.concatenate([self.vertices[frame], self.hand_vertices + self.hand[frame]])
        faces = np.concatenate([self.faces, self.hand_faces + len(self.vertices[frame])])
        reach = np.linalg.norm(here - eye, axis=1)
        hits = Raycaster(everything, faces).cast(np.broadcast_to(eye, here.shape), (here - eye) / reach[:, None])
        return hits.distance > reach - tolerance


_NAMES = {"youngs_modulus": "E", "poissons_ratio": "nu", "friction_coefficient": "friction"}


def load_truth(path: Path) -> Truth:
    """Reads truth.npz.

    Raises:
        InputError: the file is missing or lacks a field.
    """
    if not Path(path).is_file():
        raise InputError("no truth.npz", where=str(path), remedy="only captures made by the rig have one")
    fields = {}
    with np.load(path, allow_pickle=False) as file:
        for name in Truth.__dataclass_fields__:
            key = _NAMES.get(name, name)
            if key not in file:
                raise InputError(f"no field {key!r}", where=str(path), remedy="make the capture again with the rig")
            fields[name] = float(file[key]) if file[key].ndim == 0 else file[key]
    return Truth(**fields)
