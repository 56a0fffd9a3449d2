"""What moves in a video, as far as it can be seen: along the flow, and only where there is texture to see motion by."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.flow import pixel_grid, round_trip_error, sample
from physreal_core.perception.settings import MotionSettings


@dataclass(frozen=True)
class Motion:
    """How the pixels of frame 0 move.

    Attributes:
        distance: how far each gets from its place in the video, until it is lost [px].
        textured: whether it has texture; the flow on a bare table or in a soft shadow is no motion.
        places: where each is in S later frames (u, v) [px].
        held: whether it was followed there without loss.
    """

    distance: Float[Array, "H W"]
    textured: Bool[Array, "H W"]
    places: Float[Array, "S H W 2"]
    held: Bool[Array, "S H W"]

    @staticmethod
    def of(distance: Float[Array, "H W"]) -> "Motion":
        """A motion that is seen everywhere, and of which no later places are known."""
        shape = distance.shape
        return Motion(distance, np.ones(shape, bool), np.zeros((0, *shape, 2), np.float32), np.zeros((0, *shape), bool))

    def moving(self, reference: Bool[Array, "H W"], settings: MotionSettings) -> Bool[Array, "H W"]:
        """Textured pixels that move by more than a share of what the reference (the hand) does."""
        whole = np.quantile(self.distance[reference], settings.quantile) if reference.any() else self.distance.max()
        return self.textured & (self.distance > max(settings.least, settings.share * whole))


def watch(
    frames: Sequence[UInt8[Array, "H W 3"]],
    flow_between: Callable[[int, int], Float[Array, "H W 2"]],
    settings: MotionSettings,
) -> Motion:
    """Follow every pixel of frame 0 along the flow, until it is lost.

    Args:
        frames: the video.
        flow_between: flow from one frame to a neighbour [px].
        settings: when a pixel is lost, what texture is.
    """
    height, width = frames[0].shape[:2]
    start = pixel_grid(height, width)
    where, farthest, held = start.copy(), np.zeros((height, width)), np.ones((height, width), bool)
    later = np.unique(np.linspace(0, len(frames) - 1, settings.looks + 1).astype(int)[1:])
    places, seen = [], []
    for t in range(1, len(frames)):
        forward = flow_between(t - 1, t)
        # Table that something sweeps over would be carried along: it misses itself there and back.
        held &= sample(round_trip_error(forward, flow_between(t, t - 1)), where) < settings.round_trip
        where = where + sample(forward, where)
        farthest = np.where(held, np.maximum(farthest, np.linalg.norm(where - start, axis=-1)), farthest)
        if t in later:
            places.append(where.astype(np.float32)), seen.append(held.copy())
    empty = np.zeros((0, height, width))
    return Motion(
        farthest,
        texture(frames[0], settings.patch) > settings.texture,
        np.stack(places) if places else np.zeros((0, height, width, 2), np.float32),
        np.stack(seen) if seen else empty.astype(bool),
    )


def texture(image: UInt8[Array, "H W 3"], patch: int) -> Float[Array, "H W"]:
    """Root mean square of the grey gradient in a square of side `patch` [px] around each pixel [grey levels per px]."""
    import cv2

    grey = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32), (0, 0), 1.0)
    along, down = (cv2.Sobel(grey, -1, *order, scale=1 / 8) for order in ((1, 0), (0, 1)))
    mean = cv2.boxFilter(along**2 + down**2, -1, (patch, patch))
    return np.sqrt(np.maximum(mean, 0.0))  # a running sum may round below zero
