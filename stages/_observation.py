"""Frame 0 and its camera, as the geometry stages read them."""

from pathlib import Path

import numpy as np

from physreal_core.geometry import Observation
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.stage import StageContext
from stages._camera import load_camera

HAND_MARGIN = 2  # [px] around the hand's mask where its edge may hide the object


def first_frame(context: StageContext) -> Observation:
    """Frame 0 from the outputs of parse_video and segment_and_track."""
    return read_first_frame(context.input("parse_video"), context.input("segment_and_track"))


def read_first_frame(parsed: Path, perceived: Path) -> Observation:
    """Colour, depth (zeros where the capture has none), masks and camera of frame 0."""
    import cv2

    images = FrameImages(parsed)
    rgb, depth = images.colour(0) / 255.0, images.depth(0)
    depth = np.zeros(rgb.shape[:2]) if depth is None else depth / 1000.0
    masks = Masks.load(perceived, [0])
    size = 2 * HAND_MARGIN + 1
    hidden = cv2.dilate(masks.controller[0].astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    return Observation(rgb, depth, masks.object[0] & ~hidden, hidden, load_camera(parsed))
