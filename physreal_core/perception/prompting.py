"""How a segmenter is asked for a thing: by points and boxes, in a window of the image that holds the whole thing."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.mask_geometry import box_of, distance_to, spread_points, with_pixels_of
from physreal_core.perception.segmenter import Prompt
from physreal_core.perception.settings import DEFAULTS, PromptSettings, WindowSettings

Window = tuple[int, int, int, int]
"""(u0, v0, u1, v1): from the first pixel to before the second [px]."""


def make_prompts(
    mine: Bool[Array, "H W"],
    others: Sequence[Bool[Array, "H W"]],
    voters: Float[Array, "J 2"] | None = None,
    settings: PromptSettings = DEFAULTS.association.prompts,
) -> list[Prompt]:
    """Several ways to ask for the same thing, so that C_t is a choice: box and points, points, box, one point.

    Args:
        mine: where the thing is expected.
        others: where the other things are; they give points that are not on it.
        voters: its visible tracks. They are asked with as well, since the expected mask may have been left behind.
        settings: how many points, how wide the boxes.
    """
    free, off = _free_and_off(mine, others, settings)
    prompts: list[Prompt] = []
    sources = [(free, settings.margin)]
    if voters is not None:
        taken = np.any([np.zeros_like(mine), *others], axis=0)
        sources.append((with_pixels_of(np.zeros_like(mine), voters) & ~taken, settings.margin_of_tracks))
    for where, margin in sources:
        if not where.any():
            continue
        on, box = spread_points(where, settings.points), box_of(where, margin)
        prompts += [_prompt(on[: settings.points_in_box], off, box), _prompt(on, off), _prompt(on[:1], off, box)]
    return prompts


def prompts_for_carried(
    mine: Bool[Array, "H W"],
    others: Sequence[Bool[Array, "H W"]],
    voters: Float[Array, "J 2"],
    beside: Float[Array, "K 2"],
    settings: PromptSettings = DEFAULTS.association.prompts,
) -> list[Prompt]:
    """Few ways to ask for a thing that was carried here: with its mask, with points all over it, with its box, its tracks.

    Args:
        mine: where the thing is expected.
        others: where the other things are; they give points that are not on it.
        voters: its visible tracks (u, v) [px].
        beside: points known to lie on the background (u, v) [px]; the nearest around the thing say what is not meant.
        settings: how many points, how wide the boxes.
    """
    free, off = _free_and_off(mine, others, settings)
    if not free.any():
        return []
    on, box = spread_points(free, settings.points_in_whole), box_of(free, settings.margin)
    rim = np.concatenate([off, _around(free, beside, settings)])
    whole = _prompt(on, rim, box)
    prompts = [replace(whole, mask=free), whole, _prompt(on[: settings.points_in_box], off, box)]
    seen = with_pixels_of(np.zeros_like(mine), voters) & ~np.any([np.zeros_like(mine), *others], axis=0)
    if seen.any():
        prompts.append(_prompt(spread_points(seen, settings.points), off, box_of(seen, settings.margin_of_tracks)))
    return prompts


def _free_and_off(mine: Array, others: Sequence[Array], settings: PromptSettings) -> tuple[Array, Float[Array, "K 2"]]:
    """What of a mask no other one claims, and points on the others."""
    free = mine & ~np.any([np.zeros_like(mine), *others], axis=0)
    points = (spread_points(o & ~mine, settings.points_off) for o in others)
    return free if free.any() else mine, np.concatenate([np.zeros((0, 2), np.float32), *points])


def _around(mine: Array, beside: Array, settings: PromptSettings) -> Float[Array, "K 2"]:
    """Background points that lie around a mask, well apart from each other."""
    away = distance_to(mine)
    near = (away > settings.rim_gap) & (away < settings.rim_reach * np.sqrt(mine.sum()))
    return spread_points(with_pixels_of(np.zeros_like(mine), beside) & near, settings.points_rim, margin=0.0)


def _prompt(on: Array, off: Array, box: tuple[float, float, float, float] | None = None) -> Prompt:
    return Prompt(np.concatenate([on, off]), np.r_[np.ones(len(on), int), np.zeros(len(off), int)], box)


def window_around(mask: Bool[Array, "H W"], settings: WindowSettings = DEFAULTS.association.window) -> Window:
    """The window around a mask that is not empty; the whole image if nearly so."""
    height, width = mask.shape
    u0, v0, u1, v1 = box_of(mask, settings.margin)
    half_u, half_v = max((u1 - u0) / 2, settings.least * width / 2), max((v1 - v0) / 2, settings.least * height / 2)
    middle_u, middle_v = (u0 + u1) / 2, (v0 + v1) / 2
    low = max(int(middle_u - half_u), 0), max(int(middle_v - half_v), 0)
    high = min(int(middle_u + half_u) + 1, width), min(int(middle_v + half_v) + 1, height)
    if (high[0] - low[0]) * (high[1] - low[1]) > settings.whole * width * height:
        return 0, 0, width, height
    return *low, *high


def in_wide_enough_window(
    choose: Callable[[Window], Array | None], window: Window, settings: WindowSettings = DEFAULTS.association.window
) -> Array | None:
    """A mask chosen inside a window, the window widened as long as it cuts the mask off."""
    wide = replace(settings, margin=settings.wider)
    mask = choose(window)
    for _ in range(settings.widenings):
        if mask is None or not _cut_off(mask, window, settings.cut):
            break
        wider = window_around(mask, wide)
        window = (0, 0, *mask.shape[::-1]) if wider == window else wider
        mask = choose(window)
    return mask


def _cut_off(mask: Array, window: Window, tolerated: int) -> bool:
    """Whether a mask ends at a side of the window that is not a side of the image."""
    height, width = mask.shape
    u0, v0, u1, v1 = window
    sides = ((u0 > 0, mask[:, u0]), (v0 > 0, mask[v0]), (u1 < width, mask[:, u1 - 1]), (v1 < height, mask[v1 - 1]))
    return any(inner and line.sum() > tolerated for inner, line in sides)
