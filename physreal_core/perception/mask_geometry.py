"""Masks as shapes in the image: distances, boxes, points spread over them. Pixels are (u, v), their centres at integers."""

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.flow import inside_image

FARTHEST = 30.0
"""Signed distances are cut there [px]: what is farther from an edge need not be told apart."""

THIN = 1.5
"""A mask of no greater depth than this consists of lines and single pixels [px]."""


def intersection_over_union(first: Bool[Array, "H W"], second: Bool[Array, "H W"]) -> float:
    """IoU of two masks; 0 where both are empty."""
    union = (first | second).sum()
    return float((first & second).sum() / union) if union else 0.0


def signed_distance(mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """Distance to the mask's edge [px], positive inside, cut at `FARTHEST`."""
    inside, outside = _distance_to_zero(mask), _distance_to_zero(~mask)
    return np.clip(inside - outside, -FARTHEST, FARTHEST)


def distance_to(mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """Distance [px] to a mask, 0 on it."""
    return _distance_to_zero(~mask)


def _distance_to_zero(mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    import cv2

    return cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5)


def spread_points(mask: Bool[Array, "H W"], count: int, margin: float = THIN) -> Float[Array, "K 2"]:
    """At most `count` pixels (u, v) well inside a mask, the deepest first, then farthest from those chosen.

    Args:
        mask: where.
        count: how many.
        margin: least depth of a point within the mask, where the mask has any that deep [px].
    """
    depth = np.maximum(signed_distance(mask), 0)
    candidates = np.argwhere(depth >= min(margin, depth.max())) if mask.any() else np.zeros((0, 2), int)
    if len(candidates) == 0:
        return np.zeros((0, 2), np.float32)
    inside = depth[candidates[:, 0], candidates[:, 1]]
    chosen = [int(inside.argmax())]
    if margin > 0 and depth.max() < THIN:  # no depth to go by: start in the middle of the pixels
        chosen = [int(np.linalg.norm(candidates - np.median(candidates, axis=0), axis=1).argmin())]
    distance = np.full(len(candidates), np.inf)
    while len(chosen) < min(count, len(candidates)):
        distance = np.minimum(distance, np.linalg.norm(candidates - candidates[chosen[-1]], axis=1))
        chosen.append(int((distance * np.sqrt(inside)).argmax()))  # far from the others, but not on the rim
    return candidates[chosen][:, ::-1].astype(np.float32)


def box_of(mask: Bool[Array, "H W"], margin: float = 0.0) -> tuple[float, float, float, float]:
    """(u0, v0, u1, v1) [px] around a mask that is not empty, widened by `margin` of its size on each side."""
    v, u = np.nonzero(mask)
    wide, high = margin * (np.ptp(u) + 1), margin * (np.ptp(v) + 1)
    return float(u.min() - wide), float(v.min() - high), float(u.max() + wide), float(v.max() + high)


def with_pixels_of(mask: Bool[Array, "H W"], points: Float[Array, "J 2"]) -> Bool[Array, "H W"]:
    """The mask together with the pixels of the points (u, v) that lie in the image."""
    out = mask.copy()
    inside = np.rint(points[inside_image(points, *mask.shape)]).astype(int)
    out[inside[:, 1], inside[:, 0]] = True
    return out


def settle_overlaps(masks: Sequence[Bool[Array, "H W"]]) -> None:
    """Later masks take the pixels that earlier ones claim too (in place)."""
    for i, mask in enumerate(masks):
        for later in masks[i + 1 :]:
            mask &= ~later


def large_parts(mask: Bool[Array, "H W"], least: int, least_share: float) -> list[Bool[Array, "H W"]]:
    """The connected parts of a mask that have at least `least` pixels and `least_share` of the largest part's."""
    import cv2

    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = stats[1:, cv2.CC_STAT_AREA]
    return [labels == 1 + i for i in range(len(areas)) if areas[i] >= max(least, least_share * areas.max())]


def thick_parts(mask: Bool[Array, "H W"], least: float, depth: float) -> list[Bool[Array, "H W"]]:
    """The connected parts of a mask (by edges) with at least `least` pixels, without strips no deeper than `depth` [px]."""
    import cv2

    if mask.sum() < max(least, 1):
        return []
    u0, v0, u1, v1 = (int(x) for x in box_of(mask))
    crop = np.pad(mask[v0 : v1 + 1, u0 : u1 + 1], 1)  # outside of the image counts as outside of the mask
    core = _distance_to_zero(crop) > depth
    if not core.any():
        return []
    thick = crop & (_distance_to_zero(~core) <= depth + 1)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(thick.astype(np.uint8), connectivity=4)
    out = []
    for i, area in enumerate(stats[1:, cv2.CC_STAT_AREA], start=1):
        if area >= max(least, 1):
            out.append(np.zeros_like(mask))
            out[-1][v0 : v1 + 1, u0 : u1 + 1] = (labels == i)[1:-1, 1:-1]
    return out
