"""Parameters of `segment_and_track`: which networks see, how densely, and how tracks become 3D points."""

from pathlib import PurePosixPath
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from pipeline.config._base import StageParameters

OWN_NETWORKS = PurePosixPath("data/models")
"""Where own networks lie: DVC watches what is in this folder, so that other content makes the stage run again."""


def _watched(path: str) -> str:
    parts = PurePosixPath(path).parts
    inside = parts[:2] == OWN_NETWORKS.parts and len(parts) > 2 and parts[2] != "optional" and ".." not in parts
    if not inside:
        raise ValueError(
            f"a file in {OWN_NETWORKS}/, by its path from the project's root; put it there, or a link to it"
        )
    return path


NetworkFile = Annotated[str, AfterValidator(_watched)]


class SegmentAndTrack(StageParameters):
    """Masks, tracks and controller points."""

    segmenter: Literal["sam2", "candidates", "none"] = Field(
        "sam2",
        description="sam2: SAM 2, prompted; candidates: an entity segmenter, segmenter_onnx; none: the capture gives masks",
    )
    segmenter_onnx: NetworkFile | None = Field(
        None, description="own entity segmenter (.onnx): image [1,3,H,W] in 0-1 -> masks [1,N,h,w], scores [1,N]"
    )
    sam2_encoder_onnx: NetworkFile | None = Field(
        None, description="own SAM 2 encoder; null: the one of `physreal models`"
    )
    sam2_decoder_onnx: NetworkFile | None = Field(
        None, description="own SAM 2 decoder; null: the one of `physreal models`"
    )
    min_candidate_score: float = Field(0.5, ge=0, le=1, description="least score of an entity segmenter's mask")
    keyframe_stride: int = Field(
        8,
        ge=1,
        description="masks are proposed and voted on every so many frames at least, more often where flow is lost [frames]",
    )

    hand_finder: Literal["mediapipe", "none"] = Field(
        "mediapipe", description="who finds the controller where the capture has no hint for it"
    )

    target: Literal["touch", "text", "clip"] = Field(
        "touch",
        description=(
            "who finds the object where the capture has no hint for it. touch: what the hand touches and moves; "
            "text: that and the description, read by small networks (`physreal models text`); clip: the same with clip_*"
        ),
    )
    clip_image_onnx: NetworkFile | None = Field(
        None, description="own image encoder (CLIP): image [n,3,S,S], RGB with CLIP's mean and deviation -> [n,D]"
    )
    clip_text_onnx: NetworkFile | None = Field(
        None, description="own text encoder (CLIP): input_ids [1,L], attention_mask if asked for -> [1,D]"
    )
    clip_tokenizer: NetworkFile | None = Field(None, description="tokenizer.json that belongs to clip_text_onnx")

    tracker: Literal["flow", "onnx"] = Field("flow", description="flow: chained optical flow; onnx: tracker_onnx")
    tracker_onnx: NetworkFile | None = Field(
        None, description="own tracker (CoTracker3): video [1,T,3,H,W], queries [1,J,3] -> tracks [1,T,J,2], visibility"
    )
    flow: Literal["dis", "gmflow"] = Field(
        "dis",
        description="dis: to about 10 px a frame; gmflow: large motion, seconds a pair (`physreal models gmflow`)",
    )
    track_count: int = Field(400, ge=10, description="points tracked on the object, about")
    hand_track_count: int = Field(200, ge=4, description="points tracked on the controller, about")
    hand_reach: float = Field(
        0.25,
        gt=0,
        description="the controller is tracked within this distance of the object [share of the image's diagonal]",
    )
    max_round_trip: float = Field(1.0, gt=0, description="flow there and back misses by more: the point is lost [px]")
    min_likeness: float = Field(
        0.85, gt=0, lt=1, description="least correlation with a point's patch for it to be corrected (0 to 1)"
    )

    max_depth_edge: float = Field(
        0.02, gt=0, description="depth spread in 3 x 3 pixels beyond which a point is on an edge, not lifted [m]"
    )
    max_stray: float = Field(0.02, gt=0, description="motion unlike the neighbours' by more: misread or occluded [m]")
    depth_noise: float = Field(0.001, gt=0, description="standard deviation of a depth reading, constant part [m]")
    depth_noise_quadratic: float = Field(0.0015, ge=0, description="and the part that grows with depth squared [1/m]")
    pixel_noise: float = Field(0.3, gt=0, description="standard deviation of a track [px]")

    controller_count: int = Field(30, ge=3, description="controller points on the hand's seen face")
    controller_reach: float = Field(
        0.05, gt=0, description="they lie on the hand within this distance of the object [m]"
    )
    controller_thickness: float = Field(
        0.05, ge=0, description="of the hand behind its seen face, where further points stand for it [m]"
    )
    controller_smoothing: float = Field(
        0.5, ge=0, description="standard deviation of the temporal smoothing of the hand's motion [frames]"
    )
    overlay_scale: int = Field(2, ge=1, le=4, description="enlargement of overlay.mp4")
    threads: int = Field(0, ge=0, description="threads of ONNX Runtime; 0: as many as there are cores")

    def files(self) -> tuple[str, ...]:
        names = [name for name in type(self).model_fields if name.endswith("_onnx") or name == "clip_tokenizer"]
        return tuple(sorted({path for name in names if (path := getattr(self, name))}))
