"""The four filmed clips, read and scaled as the pipeline does: colour alone, no hint, the true masks where there are any."""

import json

import numpy as np

from benchmarks.judged import Judged
from benchmarks.recordings import real_data
from physreal_core.perception.perceive import Video
from pipeline.config.parse_video import ParseVideo

CLIPS = ("cloth", "zebra", "dino", "pushrope")
DESCRIPTIONS = {"cloth": "a cloth", "zebra": "a stuffed zebra", "dino": "a stuffed dinosaur", "pushrope": "a rope"}
"""What a user would write; the default settings do not read it."""


def has_clip(name: str) -> bool:
    """Whether a clip is there."""
    return (real_data() / "filmed_clips" / name / "camera.json").is_file()


def load_clip(name: str, frames: int | None = None) -> Judged:
    """A clip at the width of the default settings; of the first `frames` alone where that is given."""
    import cv2

    folder = real_data() / "filmed_clips" / name
    images = [cv2.imread(str(file))[..., ::-1] for file in sorted((folder / "color").glob("*.jpg"))[:frames]]
    height, width = images[0].shape[:2]
    scale = min(1.0, ParseVideo().max_width / width)
    size = round(width * scale), round(height * scale)
    images = [np.ascontiguousarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA)) for image in images]
    ratio = np.array(size) / (width, height)
    K = np.array(json.loads((folder / "camera.json").read_text())["K"], float)
    K[:2] *= ratio[:, None]
    K[:2, 2] += 0.5 * ratio - 0.5
    video = Video(images, None, K, np.eye(4), DESCRIPTIONS[name])
    file = folder / "object_masks.npz"
    masks = np.load(file)["masks"][: len(images)] if file.is_file() else None
    return Judged(name, "clips", folder, video, masks, None)
