"""The object's shape and appearance in a frame of its own, before its pose is known."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.geometry.mesh import Mesh, load_mesh, save_mesh
from physreal_core.rendering.gaussians import Gaussians
from pipeline.products._files import run_again, write_record
from pipeline.products.gaussians import load_gaussians, save_gaussians
from pipeline.reading.text import read_record, understood

MESH, FACTS = "object.glb", "object.json"


@dataclass(frozen=True)
class BuiltObject:
    """object.glb, gaussians.ply and object.json of build_object.

    Attributes:
        mesh: closed, or the middle surface of a cloth; in `frame`.
        gaussians: in `frame`.
        source: what the mesh was made from, in words.
        frame: canonical (centroid at the origin, longest side of the box 1) or world [m].
        gaussians_from: the prior's own, or spread over the mesh's surface, without colours of their own.
        coloured: whether the mesh has colours.
        T_object_prior: [4, 4], takes the prior (rotation, translation, scale) to `frame`.
        thickness: of the cloth whose middle surface was measured, in `frame`; None where the mesh tells it, or nobody.
    """

    mesh: Mesh
    gaussians: Gaussians
    source: str
    frame: Literal["canonical", "world"]
    gaussians_from: Literal["prior", "surface"]
    coloured: bool
    T_object_prior: Float[Array, "4 4"]
    thickness: float | None = None

    @property
    def shape(self) -> Literal["given", "seen"]:
        """As of `shape_of`."""
        return shape_of(self.source)

    @property
    def far_side_guessed(self) -> bool:
        """Whether what the camera did not see in frame 0 was made up, by a rule or a generator."""
        return self.shape == "seen"

    def save(self, folder: Path) -> None:
        """Write the three files; object.json also says, for the reader, how large and how whole the mesh is."""
        save_mesh(folder / MESH, self.mesh)
        save_gaussians(folder, self.gaussians)
        facts = {
            "source": self.source,
            "frame": self.frame,
            "gaussians": self.gaussians_from,
            "coloured": self.coloured,
            "watertight": self.mesh.open_edges() == 0,
            "volume": self.mesh.volume,
            "extents": np.ptp(self.mesh.vertices, axis=0).tolist(),
            "T_object_prior": self.T_object_prior.tolist(),
        }
        if self.thickness is not None:
            facts["thickness"] = self.thickness
        write_record(folder / FACTS, facts)

    @classmethod
    def load(cls, folder: Path) -> "BuiltObject":
        """Read the three files, InputError where one or a key is missing."""
        facts, mesh, gaussians = read_facts(folder), load_mesh(folder / MESH), load_gaussians(folder)
        with understood(folder / FACTS, run_again("build_object")):
            return cls(
                mesh=mesh,
                gaussians=gaussians,
                source=facts["source"],
                frame=facts["frame"],
                gaussians_from=facts["gaussians"],
                coloured=facts["coloured"],
                T_object_prior=np.array(facts["T_object_prior"], dtype=np.float64).reshape(4, 4),
                thickness=facts.get("thickness"),
            )


def shape_of(source: str) -> Literal["given", "seen"]:
    """Of `BuiltObject.source`: whether somebody gave the shape, or it was made from frame 0, by a rule or a generator."""
    return "given" if source.startswith("prior") else "seen"


def read_facts(folder: Path) -> dict:
    """object.json: what `BuiltObject` holds beside shape and appearance, and of the mesh extents and volume."""
    keys = ("source", "frame", "gaussians", "coloured", "T_object_prior")
    return read_record(folder / FACTS, keys, run_again("build_object"))
