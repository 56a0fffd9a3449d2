"""Frame 0 and its camera, as the geometry stages read them."""

from pathlib import Path

import numpy as np

from physreal_core.geometry import Observation
from pipeline.capture import read_capture
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.stage import StageContext
from stages._camera import load_camera
from stages._resting import resting_of

HAND_MARGIN = 2  # [px] around the hand's mask where its edge may hide the object


def first_frame(context: StageContext) -> Observation:
    """Frame 0 from the outputs of parse_video and segment_and_track."""
    return read_first_frame(context.input("parse_video"), context.input("segment_and_track"))


def read_first_frame(parsed: Path, perceived: Path) -> Observation:
    """Colour, depth, masks and camera of frame 0.

    Without a depth image the depth of the object is that of one that lies on the support plane, as its silhouette has it.
    """
    import cv2

    images = FrameImages(parsed)
    rgb, depth = images.colour(0) / 255.0, images.depth(0)
    masks, camera = Masks.load(perceived, [0]), load_camera(parsed)
    if depth is not None:
        depth = depth / 1000.0
    elif resting := resting_of(read_capture(parsed), has_depth=False):
        depth = resting.depth(masks.object[0], camera.K.numpy(), camera.T_world_camera.numpy())
    else:
        depth = np.zeros(rgb.shape[:2])
    size = 2 * HAND_MARGIN + 1
    hidden = cv2.dilate(masks.controller[0].astype(np.uint8), np.ones((size, size), np.uint8)) > 0
    return Observation(rgb, depth, masks.object[0] & ~hidden, hidden, camera)
