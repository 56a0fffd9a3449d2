"""What is known by construction about a capture of the rig: true tracks, masks and shapes. Read for scoring alone."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from data.rig.raycast import Raycaster, pixel_rays
from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.errors import InputError
from pipeline.products.truth import CaptureTruth

SOLID = ("youngs_modulus", "poissons_ratio")
"""What the rig knows of a solid body's material alone, as of `CaptureTruth`; of one with a soft part `moduli` in place of the first."""

SIMULATED = (
    "density",
    "friction_coefficient",
    "damping",
    "rest_vertices",
    "tets",
    "faces",
    "vertices",
    "gripped",
    "hand",
    "hand_vertices",
    "hand_faces",
    "T_world_prior",
    "fps",
)
"""What the rig knows of every capture, as of `CaptureTruth`."""


@dataclass(frozen=True)
class SurfacePoints:
    """Material points on the object's surface: a triangle (index into `Truth.faces`) and the weights of its corners."""

    triangles: Int[Array, " P"]
    weights: Float[Array, "P 3"]


@dataclass(frozen=True)
class Truth(CaptureTruth):
    """Truth of a capture that the rig made: all that the simulation knows is there."""

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
        """True masks of the object and of all hands as the camera sees them, each hiding the other."""
        eye, directions, _ = pixel_rays(K, T_world_camera, width, height)
        hits = self._everything(frame).cast(np.broadcast_to(eye, directions.shape), directions)
        triangle = hits.triangle.reshape(height, width)
        return (triangle >= 0) & (triangle < len(self.faces)), triangle >= len(self.faces)

    def visible(
        self, points: SurfacePoints, T_world_camera: Float[Array, "4 4"], frame: int, tolerance: float = 0.003
    ) -> Bool[Array, " P"]:
        """Whether material points are seen from the camera at `frame`: nothing is more than `tolerance` [m] before
        them."""
        eye, here = T_world_camera[:3, 3], self.follow(points)[frame]
        reach = np.linalg.norm(here - eye, axis=1)
        hits = self._everything(frame).cast(np.broadcast_to(eye, here.shape), (here - eye) / reach[:, None])
        return hits.distance > reach - tolerance

    def _everything(self, frame: int) -> Raycaster:
        """The object's surface, its triangles first, and all hands'."""
        surfaces = [(self.vertices[frame], self.faces), (self.hand_vertices + self.hand[frame], self.hand_faces)]
        if self.further_hands is not None:
            surfaces.append((self.further_hands[frame], self.further_hand_faces))
        offsets = np.cumsum([0] + [len(points) for points, _ in surfaces[:-1]])
        faces = [faces + offset for (_, faces), offset in zip(surfaces, offsets, strict=True)]
        return Raycaster(np.concatenate([points for points, _ in surfaces]), np.concatenate(faces))


def load_truth(capture: Path) -> Truth:
    """The truth of a capture that the rig made.

    Raises:
        InputError: there is none, or it lacks what the rig writes.
    """
    truth = Truth.load(Path(capture))
    expected = SIMULATED if truth.geometry else SOLID + SIMULATED
    replaced = () if truth.moduli is None else ("youngs_modulus",)
    if missing := [name for name in expected if name not in replaced and getattr(truth, name) is None]:
        key = truth.key(missing[0])
        raise InputError(
            f"no field {key!r}", where=str(capture / truth.FILE), remedy="make the capture again with the rig"
        )
    return truth
