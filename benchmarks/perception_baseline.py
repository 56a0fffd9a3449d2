"""A plain way to the same masks and tracks, to compare with: chained DIS flow, and SAM 2 asked by the carried mask.

Frame 0's mask and points are given. From frame to frame the points and the mask go along the flow; every few frames SAM 2
is asked by the carried mask's box and three points on it, and its answer with the best score stands. A point is lost for
good where flow there and back misses by more than a pixel, where it leaves the image, or where it leaves the mask.
"""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.flow import DisFlow, inside_image, pixel_grid, round_trip_error, sample
from physreal_core.perception.mask_geometry import box_of, signed_distance, spread_points
from physreal_core.perception.perceive import Video
from physreal_core.perception.segmenter import Prompt, Segmenter
from physreal_core.perception.tracker import Tracks


@dataclass(frozen=True)
class Baseline:
    """The numbers of the plain way.

    Attributes:
        stride: SAM 2 is asked every so many frames.
        round_trip: largest miss there and back [px].
        margin: widening of the box on each side [share of its size].
        tolerance: how far outside the mask a point still counts as seen [px].
    """

    stride: int = 5
    round_trip: float = 1.0
    margin: float = 0.05
    tolerance: float = 2.0


def follow(
    video: Video,
    segmenter: Segmenter,
    first: Bool[Array, "H W"],
    queries: Float[Array, "J 2"],
    own: Baseline = Baseline(),
) -> tuple[Bool[Array, "T H W"], Tracks]:
    """Masks and tracks from the mask and the points of frame 0."""
    flow = DisFlow()
    height, width = first.shape
    masks, points, visible = [first], [queries.astype(np.float32)], [np.ones(len(queries), bool)]
    for t in range(1, len(video.frames)):
        forward, backward = flow(*video.frames[t - 1 : t + 1]), flow(*video.frames[t - 1 : t + 1][::-1])
        carried = sample(masks[-1].astype(np.float32), pixel_grid(height, width) + backward) > 0.5
        masks.append(_asked(video.frames[t], segmenter, carried, own) if t % own.stride == 0 else carried)
        moved = points[-1] + sample(forward, points[-1])
        held = sample(round_trip_error(forward, backward), points[-1]) < own.round_trip
        on = sample(signed_distance(masks[-1]).astype(np.float32), moved) > -own.tolerance
        visible.append(visible[-1] & held & on & inside_image(moved, height, width))
        points.append(moved)
    return np.stack(masks), Tracks(np.stack(points), np.stack(visible))


def track_back(video: Video, points: Float[Array, "J 2"]) -> Float[Array, "J 2"]:
    """Where points of the last frame come from in frame 0, along chained flow [px]."""
    flow = DisFlow()
    for now, before in zip(video.frames[:0:-1], video.frames[-2::-1], strict=True):
        points = points + sample(flow(now, before), points)
    return points


def _asked(image: Array, segmenter: Segmenter, carried: Array, own: Baseline) -> Array:
    """SAM 2's best mask for the carried one; the carried one where there is nothing to ask by."""
    if not carried.any():
        return carried
    on = spread_points(carried, 3)
    found = segmenter.candidates(image, [Prompt(on, np.ones(len(on), int), box_of(carried, own.margin))])
    return found.masks[int(np.argmax(found.scores))] if len(found) else carried
