"""What a capture of a thin body holds beside that of a solid one: its middle as a PLY file, and its stiffnesses as truth."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from data.rig.rig_scene import RigScene
from data.rig.rope import Rope
from data.rig.thin import Cloth
from data.rig.thin_body import ThinBody
from data.rig.thin_scenes import MEASURED, PLATE_RATIO
from data.rig.trajectory import Trajectory
from physreal_core.array_types import Array, Float, Int

NAMES = {"planar": "middle_surface.ply", "linear": "centre_line.ply"}
"""The file of the middle, by geometry."""


def write_middle(folder: Path, trajectory: Trajectory, body: object, T_world_prior: Float[Array, "4 4"]) -> None:
    """The stress-free middle of a thin body, in the frame of shape_prior.glb; nothing for a solid one."""
    if trajectory.middle is None or not isinstance(body, ThinBody):
        return
    inverse = np.linalg.inv(T_world_prior)
    vertices = trajectory.middle.rest @ inverse[:3, :3].T + inverse[:3, 3]
    write_ply(folder / NAMES[body.geometry], vertices, trajectory.middle.elements)


def write_middle_at_frame_zero(folder: Path, trajectory: Trajectory, body: object) -> None:
    """The middle of a thin body as it lies at frame 0, as its shape is in a capture of tracks alone; nothing for a solid one."""
    if trajectory.middle is not None and isinstance(body, ThinBody):
        write_ply(folder / NAMES[body.geometry], trajectory.middle.vertices[0], trajectory.middle.elements)


def stated(body: object) -> dict[str, Any]:
    """What capture.json says of a thin body beside that of a solid one."""
    return {"geometry": body.geometry, "thickness": body.thickness} if isinstance(body, ThinBody) else {}


def write_ply(path: Path, vertices: Float[Array, "M 3"], elements: Int[Array, "E N"]) -> None:
    """Triangles or segments as a PLY file in ASCII: `face` with `vertex_indices`, or `edge` with `vertex1` and `vertex2`."""
    head = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    head += [f"property double {axis}" for axis in "xyz"]
    if elements.shape[1] == 3:
        head += [f"element face {len(elements)}", "property list uchar int vertex_indices"]
        rows = np.insert(elements, 0, 3, axis=1)
    else:
        head += [f"element edge {len(elements)}", "property int vertex1", "property int vertex2"]
        rows = elements
    lines = [*head, "end_header", *(" ".join(f"{x:.9g}" for x in point) for point in vertices)]
    lines += [" ".join(map(str, row)) for row in rows]
    path.write_text("\n".join(lines) + "\n")


def material_truth(scene: RigScene) -> dict[str, Any]:
    """The material, as of `CaptureTruth`: stiffnesses as measured of the elements, and as they were given to the simulator."""
    body, solid = scene.body, scene.material
    if not isinstance(body, ThinBody):
        uniform = ("youngs_modulus",) if scene.soft_part is None else ()
        names = *uniform, "poissons_ratio", "density", "damping"
        return {name: getattr(solid, name) for name in names}
    common = {"geometry": body.geometry, "thickness": body.thickness, "density": body.density, "damping": body.damping}
    if isinstance(body, Cloth):
        common |= {"areal_density": body.areal_density, "poissons_ratio": body.poissons_ratio}
        if body.equilateral:
            common |= {"bending_poissons_ratio": PLATE_RATIO}
    else:
        common |= {"mass_per_length": body.mass_per_length}
    return common | _stiffnesses(body)


def _stiffnesses(body: ThinBody) -> dict[str, float]:
    """Nominal ones, and effective ones where they have been measured."""
    nominal = {name: value for name, value in asdict(body).items() if name.endswith("_stiffness")}
    found = {f"nominal_{name}": value for name, value in nominal.items()}
    if isinstance(body, Rope) or body.equilateral:
        found |= {name: value * MEASURED[type(body)][name] for name, value in nominal.items()}
    return found


def middle_truth(trajectory: Trajectory) -> dict[str, Array]:
    """How the middle of a thin body moved, as of `CaptureTruth`; nothing of a solid one."""
    middle = trajectory.middle
    if middle is None:
        return {}
    found = {
        "middle_rest": middle.rest.astype(np.float32),
        "middle_elements": middle.elements.astype(np.int32),
        "middle_vertices": middle.vertices.astype(np.float32),
        "middle_gripped": middle.gripped.astype(np.int32),
    }
    return found | ({"middle_directors": middle.directors.astype(np.float32)} if middle.directors.size else {})
