"""Parameters of `parse_video`: how large the frames are worked on, and what a capture must satisfy."""

from pydantic import Field, model_validator

from pipeline.config._base import StageParameters


class ParseVideo(StageParameters):
    """Reading and checking a capture, setting the world."""

    max_width: int = Field(640, ge=32, description="frames wider than this are scaled down to it [px]")
    max_frames: int | None = Field(None, ge=2, description="only so many frames are used; null: all")
    min_depth: float = Field(0.1, gt=0, description="nearest plausible depth; nearer readings are dropped [m]")
    max_depth: float = Field(8.0, gt=0, description="farthest plausible depth; farther readings are dropped [m]")
    plane_tolerance: float = Field(0.006, gt=0, description="a point so near the support plane is on it [m]")

    @model_validator(mode="after")
    def _range_in_order(self) -> "ParseVideo":
        if not self.min_depth < self.max_depth:
            raise ValueError("min_depth below max_depth")
        return self
