"""Which pixels of frame 0 are tracked: on the object, on the hand near it, on what stands still around them."""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.mask_geometry import distance_to, signed_distance
from physreal_core.perception.settings import QuerySettings


def spread_over(mask: Bool[Array, "H W"], count: int, settings: QuerySettings) -> Float[Array, "J 2"]:
    """About `count` pixels (u, v), evenly spread over a mask within its rim."""
    inner = signed_distance(mask) > settings.rim
    inner = inner if inner.sum() >= settings.least_inner else mask
    pixels = np.argwhere(inner)[:, ::-1]
    if len(pixels) <= count:
        return pixels.astype(np.float32)
    cell = np.sqrt(len(pixels) / count)
    cells = np.floor(pixels / cell).astype(int)
    centre = np.abs((pixels + 0.5) / cell - cells - 0.5).sum(1)
    order = np.lexsort((centre, cells[:, 0], cells[:, 1]))
    keep = np.r_[True, (np.diff(cells[order], axis=0) != 0).any(1)]
    return pixels[order][keep].astype(np.float32)


def hand_queries(
    hand: Bool[Array, "H W"],
    thing: Bool[Array, "H W"],
    count: int,
    reach: float,
    settings: QuerySettings,
) -> Float[Array, "J 2"]:
    """About `count` pixels (u, v) of a hand near the object: that part moves as the grip does.

    Args:
        hand, thing: masks of the hand and of the object.
        count: how many pixels.
        reach: how near [share of the image's diagonal].
        settings: how few pixels near the object are too few.
    """
    near = hand & (distance_to(thing) < reach * np.hypot(*hand.shape))
    return spread_over(near if near.sum() >= settings.least_near else hand, count, settings)


def background_queries(things: Bool[Array, "H W"], settings: QuerySettings) -> Float[Array, "J 2"]:
    """Pixels (u, v) off the things: spread over the image, denser in their neighbourhood."""
    away = distance_to(things)
    near = settings.background_near * np.hypot(*things.shape)
    return np.concatenate(
        [
            spread_over((away > settings.background_gap) & (away < near), settings.background_near_count, settings),
            spread_over(away > near, settings.background_far_count, settings),
        ]
    )
