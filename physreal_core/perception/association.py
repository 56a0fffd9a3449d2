"""One mask per frame: candidates re-prompted by the tracks on keyframes, chosen by track votes (eq. mask_tracking),
carried by the flow in between."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.flow import inside_image, pixel_grid, sample
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, zoomed_candidates
from physreal_core.perception.tracker import Tracks

FlowBetween = Callable[[int, int], Float[Array, "H W 2"]]


def count_votes(masks: Bool[Array, "N H W"], points: Float[Array, "J 2"], visible: Bool[Array, " J"]) -> Array:
    """How many visible points lie in each mask: sum_j omega_j 1(u_j in m), eq. mask_tracking [N]."""
    height, width = masks.shape[1:]
    use = visible & inside_image(points, height, width)
    pixel = np.rint(points[use]).astype(int)
    return masks[:, pixel[:, 1], pixel[:, 0]].sum(1)


def choose_by_votes(
    candidates: Candidates,
    votes_for: Float[Array, "J 2"],
    votes_against: Float[Array, "K 2"],
    expected: Bool[Array, "H W"] | None = None,
    *,
    tie: float = 0.03,
) -> int | None:
    """Index of the candidate with the most votes (eq. mask_tracking), None without candidates or without a vote.

    The paper's candidates do not overlap; SAM 2's do, and the whole image would win every vote. So points that are
    known to lie on something else vote against, one against one. Candidates within `tie` (a share of the voters) of the best count are equal;
    among them the likeness to the expected mask (IoU) and the network's own score decide.
    """
    if len(candidates) == 0 or len(votes_for) == 0:
        return None
    everyone = np.ones(max(len(votes_for), len(votes_against)), bool)
    count_for = count_votes(candidates.masks, votes_for, everyone[: len(votes_for)])
    votes = count_for - count_votes(candidates.masks, votes_against, everyone[: len(votes_against)])
    if count_for.max() <= 0:
        return None
    quality = candidates.scores.astype(float)
    if expected is not None and expected.any():
        quality = quality * np.array([0.3 + intersection_over_union(m, expected) for m in candidates.masks])
    equal = votes >= votes.max() - tie * len(votes_for)
    return int(np.argmax(np.where(equal & (count_for > 0), quality, -1.0)))


def intersection_over_union(first: Bool[Array, "H W"], second: Bool[Array, "H W"]) -> float:
    """IoU of two masks; 0 where both are empty."""
    union = (first | second).sum()
    return float((first & second).sum() / union) if union else 0.0


@dataclass
class Thing:
    """Something followed through the video: its name, its mask in frame 0, and the tracks that vote for it."""

    name: str
    mask: Bool[Array, "H W"]
    tracks: Tracks


def follow_masks(
    frames: Sequence[UInt8[Array, "H W 3"]],
    things: Sequence[Thing],
    background: Tracks,
    segmenter: Segmenter,
    flow_between: FlowBetween,
    *,
    stride: int,
    tick: Callable[[], None] = lambda: None,
) -> tuple[Mapping[str, Bool[Array, "T H W"]], Mapping[str, list[int]]]:
    """Masks of all things in all frames.

    Args:
        frames: T images.
        things: what to follow; earlier ones lose pixels that later ones claim too (so: object, then hand).
        background: tracks that belong to none of them and vote against all.
        segmenter: proposes masks on keyframes.
        flow_between: flow from one frame to a neighbour [px].
        stride: keyframe distance [frames].
        tick: called after each keyframe.

    Returns:
        Masks by name, and by name the keyframes on which no candidate won, so that the carried mask stood.
    """
    count = len(frames)
    keys = sorted({*range(0, count, stride), count - 1})
    masks = {x.name: np.zeros((count, *frames[0].shape[:2]), bool) for x in things}
    unanswered: dict[str, list[int]] = {x.name: [] for x in things}
    for x in things:
        masks[x.name][0] = x.mask
    for start, stop in pairwise(keys):
        soft = {x.name: _carry_through(masks[x.name][start], start, stop, flow_between) for x in things}
        expected = {name: s[-1] > 0 for name, s in soft.items()}
        for x in things:
            chosen = _answer(frames[stop], stop, x, things, background, expected, segmenter)
            if chosen is None:
                unanswered[x.name].append(stop)
            masks[x.name][stop] = expected[x.name] if chosen is None else chosen
        _settle_overlaps([masks[x.name][stop] for x in things])
        for x in things:
            back = _carry_through(masks[x.name][stop], stop, start, flow_between)[::-1]
            for t in range(start + 1, stop):
                late = (t - start) / (stop - start)
                masks[x.name][t] = (1 - late) * soft[x.name][t - start] + late * back[t - start] > 0
        for t in range(start + 1, stop):
            _settle_overlaps([masks[x.name][t] for x in things])
        tick()
    _look_again(frames[0], things, masks, background, segmenter, flow_between, keys[1:4])
    return masks, unanswered


def _look_again(
    frame: Array,
    things: Sequence[Thing],
    masks: Mapping[str, Array],
    background: Tracks,
    segmenter: Segmenter,
    flow_between: FlowBetween,
    keys: Sequence[int],
) -> None:
    """Frame 0 answered once more (in place), now that the keyframes after it say what belongs together."""
    expected = {}
    for x in things:
        told = [_carry_through(masks[x.name][k], k, 0, flow_between)[-1] > 0 for k in keys]
        expected[x.name] = np.mean([x.mask, *told], axis=0) > 0.5
    # Points sampled as background may lie on parts of the object that frame 0's first mask missed.
    claimed = sample(np.any(list(expected.values()), axis=0).astype(np.float32), background.points[0]) > 0
    against = Tracks(background.points[:1], background.visible[:1] & ~claimed)
    for x in things:
        chosen = _answer(frame, 0, x, things, against, expected, segmenter)
        masks[x.name][0] = expected[x.name] if chosen is None else chosen
    _settle_overlaps([masks[x.name][0] for x in things])


def signed_distance(mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """Distance to the mask's edge [px], positive inside, cut at 30 px."""
    import cv2

    inside, outside = (cv2.distanceTransform(m.astype(np.uint8), cv2.DIST_L2, 5) for m in (mask, ~mask))
    return np.clip(inside - outside, -30, 30)


def spread_points(mask: Bool[Array, "H W"], count: int, margin: float = 1.5) -> Float[Array, "K 2"]:
    """At most `count` pixels (u, v) well inside a mask, the deepest first, then farthest from those chosen."""
    depth = np.maximum(signed_distance(mask), 0)
    candidates = np.argwhere(depth >= min(margin, depth.max())) if mask.any() else np.zeros((0, 2), int)
    if len(candidates) == 0:
        return np.zeros((0, 2), np.float32)
    inside = depth[candidates[:, 0], candidates[:, 1]]
    chosen = [int(inside.argmax())]
    if margin > 0 and depth.max() < 1.5:  # single pixels: start in the middle of them
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


def window_around(mask: Bool[Array, "H W"], margin: float = 0.3, least: float = 0.3) -> tuple[int, int, int, int]:
    """Window (u0, v0, u1, v1) around a mask, at least `least` of the image's sides; the whole image if nearly so."""
    height, width = mask.shape
    u0, v0, u1, v1 = box_of(mask, margin)
    half_u, half_v = max((u1 - u0) / 2, least * width / 2), max((v1 - v0) / 2, least * height / 2)
    middle_u, middle_v = (u0 + u1) / 2, (v0 + v1) / 2
    low = max(int(middle_u - half_u), 0), max(int(middle_v - half_v), 0)
    high = min(int(middle_u + half_u) + 1, width), min(int(middle_v + half_v) + 1, height)
    if (high[0] - low[0]) * (high[1] - low[1]) > 0.7 * width * height:
        return 0, 0, width, height
    return *low, *high


def _carry_through(mask: Array, start: int, stop: int, flow_between: FlowBetween) -> list[Float[Array, "H W"]]:
    """Signed distances of a mask carried by the flow from frame `start` to each frame up to `stop`."""
    import cv2

    step = 1 if stop > start else -1
    soft = [signed_distance(mask)]
    for t in range(start, stop, step):
        where = pixel_grid(*mask.shape) + flow_between(t + step, t)
        carried = cv2.remap(soft[-1], where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        soft.append(carried)
    return soft


def _answer(
    frame: Array,
    t: int,
    thing: Thing,
    things: Sequence[Thing],
    background: Tracks,
    expected: Mapping[str, Array],
    segmenter: Segmenter,
) -> Array | None:
    """The voted candidate for a thing on a keyframe."""
    mine, voters = expected[thing.name], _seen(thing.tracks, t)
    if len(voters) < 3:
        return None
    mine = mine & _near(voters, mine.shape)
    others = [x for x in things if x is not thing]
    prompts = make_prompts(mine, [expected[x.name] for x in others], voters)
    against = np.concatenate([_seen(background, t), *(_seen(x.tracks, t) for x in others)])

    def choose(window: tuple[int, int, int, int]) -> Array | None:
        carried = Candidates(mine[None], np.array([0.3], np.float32), np.array([-1]))
        candidates = Candidates.join([zoomed_candidates(segmenter, frame, prompts, window), carried])
        best = choose_by_votes(candidates, voters, against, expected=mine)
        return None if best is None else candidates.masks[best]

    # One window for all things, so that the image is encoded once.
    everything = _covering(
        np.concatenate([_seen(x.tracks, t) for x in things]), np.any(list(expected.values()), axis=0)
    )
    return in_wide_enough_window(choose, window_around(everything, 0.15))


def in_wide_enough_window(
    choose: Callable[[tuple[int, int, int, int]], Array | None], window: tuple[int, int, int, int]
) -> Array | None:
    """A mask chosen inside a window, the window widened as long as it cuts the mask off."""
    mask = choose(window)
    for _ in range(3):
        if mask is None or not _cut_off(mask, window):
            break
        wider = window_around(mask, 0.5)
        window = (0, 0, *mask.shape[::-1]) if wider == window else wider
        mask = choose(window)
    return mask


def _cut_off(mask: Array, window: tuple[int, int, int, int]) -> bool:
    """Whether a mask ends at a side of the window that is not a side of the image."""
    height, width = mask.shape
    u0, v0, u1, v1 = window
    sides = ((u0 > 0, mask[:, u0]), (v0 > 0, mask[v0]), (u1 < width, mask[:, u1 - 1]), (v1 < height, mask[v1 - 1]))
    return any(inner and line.sum() > 2 for inner, line in sides)


def _seen(tracks: Tracks, t: int) -> Array:
    return tracks.points[t][tracks.visible[t]]


def _near(points: Array, shape: tuple[int, int]) -> Array:
    """Pixels not far from visible tracks: what the flow left behind on the table has none."""
    import cv2
    from scipy.spatial import cKDTree

    spacing = np.median(cKDTree(points).query(points, k=min(3, len(points)))[0][:, -1])
    away = ~_covering(points, np.zeros(shape, bool))
    return cv2.distanceTransform(away.astype(np.uint8), cv2.DIST_L2, 5) < max(6.0, 3.0 * spacing)


def _covering(points: Array, mask: Array) -> Array:
    """The mask together with the points' pixels."""
    out = mask.copy()
    inside = np.rint(points[inside_image(points, *mask.shape)]).astype(int)
    out[inside[:, 1], inside[:, 0]] = True
    return out


def make_prompts(
    mine: Bool[Array, "H W"], others: Sequence[Bool[Array, "H W"]], voters: Float[Array, "J 2"] | None = None
) -> list[Prompt]:
    """Several ways to ask for the same thing, so that C_t is a choice: box and points, points, box, one point.

    Args:
        mine: where the thing is expected.
        others: where the other things are; they give points that are not on it.
        voters: its visible tracks. They are asked with as well, since the expected mask may have been left behind.
    """
    taken = np.any([np.zeros_like(mine), *others], axis=0)
    off = np.concatenate([np.zeros((0, 2), np.float32), *(spread_points(o & ~mine, 2) for o in others)])
    prompts: list[Prompt] = []
    sources = [(mine & ~taken if (mine & ~taken).any() else mine, 0.03)]
    if voters is not None:
        sources.append((_covering(voters, np.zeros_like(mine)) & ~taken, 0.06))
    for where, margin in sources:
        if not where.any():
            continue
        on, box = spread_points(where, 6), box_of(where, margin)
        prompts += [_prompt(on[:3], off, box), _prompt(on, off), _prompt(on[:1], off, box)]
    return prompts


def _prompt(on: Array, off: Array, box: tuple[float, float, float, float] | None = None) -> Prompt:
    return Prompt(np.concatenate([on, off]), np.r_[np.ones(len(on), int), np.zeros(len(off), int)], box)


def _settle_overlaps(masks: Sequence[Array]) -> None:
    """Later masks take the pixels that earlier ones claim too (in place)."""
    for i, mask in enumerate(masks):
        for later in masks[i + 1 :]:
            mask &= ~later
