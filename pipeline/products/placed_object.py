"""The object where it lies in frame 0, in the size it has."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.geometry.mesh import Mesh, load_mesh, save_mesh
from physreal_core.rendering.gaussians import Gaussians
from pipeline.products._files import run_again, write_record
from pipeline.products.gaussians import load_gaussians, save_gaussians
from pipeline.reading.text import read_record, understood

MESH, POSE = "mesh.glb", "pose.json"
_MATRICES = ("T_world_object", "T_world_prior")


@dataclass(frozen=True)
class PlacedObject:
    """mesh.glb, gaussians.ply and pose.json of fit_pose; world frame [m].

    Attributes:
        mesh: closed, or the middle surface of a cloth.
        gaussians: with the colours of frame 0.
        T_world_object: [4, 4], rigid; with `scale` it takes what build_object made to the world.
        scale: of the object [m per unit of its own frame].
        T_world_prior: [4, 4], takes the capture's shape_prior (rotation, translation, scale) to the world.
        notes: how the pose was found and how well frame 0 is reproduced; nothing computes with it.
        thickness: of the cloth whose middle surface was measured [m]; None where the mesh tells it, or nobody.
        far_side_guessed: whether what the camera did not see in frame 0 was made up, by a rule or a generator.
    """

    mesh: Mesh
    gaussians: Gaussians
    T_world_object: Float[Array, "4 4"]
    scale: float
    T_world_prior: Float[Array, "4 4"]
    notes: dict[str, Any] = field(default_factory=dict)
    thickness: float | None = None
    far_side_guessed: bool = False

    def save(self, folder: Path) -> None:
        """Write the three files."""
        save_mesh(folder / MESH, self.mesh)
        save_gaussians(folder, self.gaussians)
        pose = {
            "T_world_object": self.T_world_object.tolist(),
            "scale": self.scale,
            "T_world_prior": self.T_world_prior.tolist(),
            "far_side_guessed": self.far_side_guessed,
        }
        if self.thickness is not None:
            pose["thickness"] = self.thickness
        write_record(folder / POSE, {**pose, **self.notes})

    @classmethod
    def load(cls, folder: Path) -> "PlacedObject":
        """Read the three files, InputError where one or a key is missing."""
        record = read_record(folder / POSE, (*_MATRICES, "scale", "far_side_guessed"), run_again("fit_pose"))
        with understood(folder / POSE, run_again("fit_pose")):
            matrices = {name: np.array(record.pop(name), dtype=np.float64).reshape(4, 4) for name in _MATRICES}
            scale, thickness = float(record.pop("scale")), record.pop("thickness", None)
            guessed = bool(record.pop("far_side_guessed"))
        mesh, gaussians = load_mesh(folder / MESH), load_gaussians(folder)
        return cls(
            mesh, gaussians, scale=scale, notes=record, thickness=thickness, far_side_guessed=guessed, **matrices
        )
