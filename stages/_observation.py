"""Frame 0 and its camera, as the geometry stages read them."""

from pathlib import Path

import numpy as np

from physreal_core.geometry import Observation
from physreal_core.rendering import load_camera
from pipeline.frames import read_colour, read_depth, read_grey
from pipeline.stage import StageContext

FRAME_0 = "000000.png"
HAND_MARGIN = 2  # [px] around the hand's mask where its edge may hide the object


def first_frame(context: StageContext) -> Observation:
    """Frame 0 from the outputs of parse_video and segment_and_track."""
    return read_first_frame(context.input("parse_video"), context.input("segment_and_track") / "masks")


def read_first_frame(video: Path, masks: Path) -> Observation:
    """Colour, depth (zeros where the capture has none), masks and camera of frame 0."""
    import cv2

    camera = load_camera(video / "camera.json")
    rgb = read_colour(video / "color" / FRAME_0) / 255.0
    depth_file = video / "depth" / FRAME_0
    depth = read_depth(depth_file, (0.0, np.inf)) / 1000.0 if depth_file.exists() else np.zeros(rgb.shape[:2])
    mask = read_grey(masks / "object" / FRAME_0) > 127
    hand_file = masks / "controller" / FRAME_0
    hand = read_grey(hand_file) > 127 if hand_file.exists() else np.zeros_like(mask)
    size = 2 * HAND_MARGIN + 1
    hidden = cv2.dilate(hand.astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    return Observation(rgb, depth, mask & ~hidden, hidden, camera)
