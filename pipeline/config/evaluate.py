"""Parameters of `evaluate`: what the metrics are computed on."""

from typing import Literal

from pydantic import Field

from pipeline.config._base import StageParameters


class Evaluate(StageParameters):
    """Scoring every fitted model on observed and future frames."""

    device: Literal["cpu", "cuda:0"] = Field("cpu", description="where frames are rendered")
    surface_points: int = Field(
        20_000, ge=100, description="points on the simulated surface that distances are taken to"
    )
    depth_edge: float = Field(
        0.02, gt=0, description="measured pixels with a larger spread of depth around are left out [m]"
    )
    mask_margin: int = Field(1, ge=0, description="pixels along the mask's rim whose depth is left out [px]")
    settled_frames: int = Field(5, ge=1, description="last frames, the object at rest, for the static deflection")
    swing_frames: int = Field(
        72, ge=2, description="last frames over which a swinging tip is averaged, captures of tracks"
    )
    min_sag: float = Field(0.005, gt=0, description="true static deflection below which none is compared [m]")
    video_scale: int = Field(1, ge=1, le=4, description="size of the side-by-side video relative to the frames")
