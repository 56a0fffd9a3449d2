"""Parameters of `build_object`: what to do with a shape prior, and how to build an object without one."""

from typing import Literal

from pydantic import Field

from pipeline.config._base import StageParameters


class BuildObject(StageParameters):
    """Mesh and Gaussians of the object, from shape_prior.glb / .ply, from a generator, or from frame 0."""

    close_holes: bool = Field(
        False, description="cap the holes of a prior mesh that is not closed, instead of refusing it"
    )
    generator: str | None = Field(
        None,
        description="of a volume without a prior, what makes its whole shape from frame 0 and the object's mask: an .onnx file, or a "
        "command with {image}, {mask} and {output} in it; null closes what frame 0 shows by a rule",
    )
    gaussians: int = Field(4000, ge=100, le=200_000, description="Gaussians on the surface where the prior brings none")
    voxels_across: int = Field(
        64, ge=16, le=256, description="voxels along the longest side of a mesh made from Gaussians"
    )
    voxel: float = Field(
        0.004, gt=0, description="voxel edge of a mesh built from frame 0; of a cloth, the spacing of its vertices [m]"
    )
    sheet_thickness: float = Field(
        0.002,
        gt=0,
        description="of a cloth built from frame 0, where neither capture.json states its thickness nor enough of it lies "
        "on the support plane to measure it [m]",
    )
    underside: Literal["round", "flat"] = Field(
        "round",
        description="unseen underside of a mesh built from frame 0: round mirrors the seen upper side about half the "
        "height beside it, flat goes straight down to the support plane",
    )
