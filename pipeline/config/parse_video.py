"""Parameters of `parse_video`: how large the frames are worked on, and what a capture must satisfy."""

from pydantic import Field

from pipeline.config._base import StageParameters


class ParseVideo(StageParameters):
    """Reading and checking a capture."""

    max_width: int = Field(640, ge=32, description="frames wider than this are scaled down to it [px]")
    max_frames: int | None = Field(None, ge=2, description="only this many frames are used; null: all")
    min_depth: float = Field(0.1, gt=0, description="nearest plausible depth reading; nearer ones are dropped [m]")
    max_depth: float = Field(8.0, gt=0, description="farthest plausible depth reading; farther ones are dropped [m]")
    plane_threshold: float = Field(0.008, gt=0, description="distance to the support plane that still counts as on it [m]")
    plane_points: int = Field(20000, ge=100, description="depth readings of frame 0 that the support plane is fitted to")
