"""Frame 0 and its camera, as the geometry stages read them."""

from pathlib import Path

import numpy as np

from physreal_core.errors import InputError
from physreal_core.geometry import Observation
from physreal_core.rendering import load_camera
from pipeline.stage import StageContext

HAND_MARGIN = 2  # [px] around the hand's mask where its edge may hide the object


def first_frame(context: StageContext) -> Observation:
    """Frame 0 from the outputs of parse_video and segment_and_track."""
    return read_first_frame(context.input("parse_video"), context.input("segment_and_track") / "masks")


def read_first_frame(video: Path, masks: Path) -> Observation:
    """Colour, depth (zeros where the capture has none), masks and camera of frame 0."""
    import cv2

    camera = load_camera(video / "camera.json")
    rgb = _read(video / "color" / "000000.png", cv2.IMREAD_COLOR)[..., ::-1] / 255.0
    depth_file = video / "depth" / "000000.png"
    depth = _read(depth_file, cv2.IMREAD_UNCHANGED) / 1000.0 if depth_file.exists() else np.zeros(rgb.shape[:2])
    mask = _read(masks / "object" / "000000.png", cv2.IMREAD_GRAYSCALE) > 127
    hand_file = masks / "controller" / "000000.png"
    hand = _read(hand_file, cv2.IMREAD_GRAYSCALE) > 127 if hand_file.exists() else np.zeros_like(mask)
    size = 2 * HAND_MARGIN + 1
    hidden = cv2.dilate(hand.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    return Observation(rgb, depth, mask & ~hidden, hidden, camera)


def _read(path: Path, mode: int) -> np.ndarray:
    import cv2

    image = cv2.imread(str(path), mode)
    if image is None:
        raise InputError("not a readable image", where=str(path), remedy="rerun the stage that wrote it")
    return image
