"""Hands of a frame: landmarks to the mask of a hand, and to that of its arm, which moves with it and is no target."""

from collections.abc import Sequence

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from physreal_core.perception.appearance import Appearance
from physreal_core.perception.choices import Choice
from physreal_core.perception.chooser import opened
from physreal_core.perception.colour import largest_part
from physreal_core.perception.flow import inside_image, pixel_grid
from physreal_core.perception.hand_finder import Hand, HandFinder
from physreal_core.perception.mask_geometry import distance_to, large_parts
from physreal_core.perception.motion import Motion
from physreal_core.perception.prompting import Window, in_wide_enough_window, make_prompts, window_around
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, zoomed_candidates
from physreal_core.perception.settings import HandSettings, MotionSettings
from physreal_core.perception.votes import choose_by_votes

_WRIST, _MIDDLE_KNUCKLE, _KNUCKLES = 0, 9, [0, 5, 9, 13, 17]  # among MediaPipe's 21 landmarks


def find_hands(
    image: UInt8[Array, "H W 3"], finder: HandFinder, segmenter: Segmenter, settings: HandSettings
) -> list[Choice]:
    """A mask of every hand that is found, with its arm."""
    found: list[Choice] = []
    for hand in finder.find(image):
        mask = _mask_of_hand(image, hand, segmenter, settings)
        if mask is None or any((mask & f.hand).sum() >= settings.one * mask.sum() for f in found):
            continue
        arm = _arm(image, hand, mask, segmenter, settings)
        found.append(Choice(mask | arm, f"hand found, presence {hand.presence:.2f}", core=mask))
    return found


def _mask_of_hand(image: Array, hand: Hand, segmenter: Segmenter, settings: HandSettings) -> Array | None:
    """The mask that holds most of the landmarks; they vote, and the segmenter's score breaks ties."""
    low, high = hand.points.min(0), hand.points.max(0)
    wider = settings.box * (high - low)
    box = tuple(float(x) for x in (*(low - wider), *(high + wider)))
    knuckles = hand.points[_KNUCKLES] if len(hand.points) == 21 else hand.points[:5]
    prompts = [
        Prompt(p, np.ones(len(p), np.int64), b)
        for p, b in ((knuckles, None), (knuckles[2:3], box), (knuckles[:3], box))
    ]
    seed = np.zeros(image.shape[:2], bool)
    u0, v0, u1, v1 = (int(np.clip(x, 0, n - 1)) for x, n in zip(box, (*image.shape[1::-1],) * 2, strict=True))
    seed[v0 : v1 + 1, u0 : u1 + 1] = True

    def choose(window: Window) -> Array | None:
        found = sane(zoomed_candidates(segmenter, image, prompts, window))
        best = choose_by_votes(found, hand.points, np.zeros((0, 2)), settings=settings.landmarks)
        return None if best is None else found.masks[best]

    whole = choose((0, 0, *image.shape[1::-1]))
    if whole is not None and whole[_pixels(hand.points, whole.shape)].mean() >= settings.good:
        return whole
    return in_wide_enough_window(choose, window_around(seed, settings.window))


def _arm(image: Array, hand: Hand, mask: Array, segmenter: Segmenter, settings: HandSettings) -> Bool[Array, "H W"]:
    """What lies behind the wrist, in a strip along the line from the knuckles through it; nothing where that is unclear.

    The colour may be that of skin or of a sleeve, so the shape alone decides.
    """
    nothing = np.zeros_like(mask)
    if len(hand.points) != 21 or not segmenter.promptable:
        return nothing
    wrist, back = hand.points[_WRIST], hand.points[_WRIST] - hand.points[_MIDDLE_KNUCKLE]
    palm = float(np.linalg.norm(back))
    if palm < 1:
        return nothing
    along = back / palm
    points = wrist + along * palm * np.array(settings.steps)[:, None]
    points = points[inside_image(points, *mask.shape)].astype(np.float32)
    prompts = [Prompt(points[: i + 1], np.ones(i + 1, np.int64)) for i in range(len(points))]
    prompts += [Prompt(p[None], np.ones(1, np.int64)) for p in points[1:]]
    if not prompts:
        return nothing
    found = sane(segmenter.candidates(image, prompts))
    offset = pixel_grid(*mask.shape) - wrist
    strip = (np.abs(offset @ np.array([-along[1], along[0]])) < settings.breadth * palm) & (offset @ along > -palm)
    near = distance_to(mask)
    best, best_fit = nothing, 0.0
    for one, score in zip(found.masks & ~mask, found.scores, strict=True):
        area = one.sum()
        if area == 0 or area > settings.longest * mask.sum() or near[one].min() > settings.gap:
            continue
        one = largest_part(one)
        share = (one & strip).sum() / area
        fit = score * share * np.sqrt(area)
        if share >= settings.inside and fit > best_fit:
            best, best_fit = one, fit
    return best


def reaching_in(
    image: UInt8[Array, "H W 3"],
    motion: Motion,
    segmenter: Segmenter,
    settings: HandSettings,
    motion_settings: MotionSettings,
) -> list[Choice]:
    """What moves and reaches in from the image's border, one at most: a hand that no finder knows, in a glove or of a robot.

    Of the masks around what moves at the border, that which the segmenter is surest of, of which most moves, and which is the largest.
    """
    if not segmenter.promptable:
        return []
    moving = motion.moving(motion.textured, motion_settings)
    width = max(1, round(settings.rim * np.hypot(*moving.shape)))
    rim = np.pad(np.zeros([side - 2 * width for side in moving.shape], bool), width, constant_values=True)
    best, best_fit = [], 0.0
    for part in large_parts(moving & rim, settings.least_rim, 0.0):
        found = sane(segmenter.candidates(image, make_prompts(part, [])))
        for mask, score in zip(map(largest_part, found.masks), found.scores, strict=True):
            seen = mask & motion.textured
            moves = moving[seen].mean() if seen.any() and _at_the_border(mask) else 0.0
            fit = score * moves * np.sqrt(mask.sum())
            if moves >= settings.moves and fit > best_fit:
                best, best_fit = [Choice(mask, "reaches in from the border and moves")], fit
    return best


def _at_the_border(mask: Bool[Array, "H W"]) -> bool:
    return bool(np.r_[mask[0], mask[-1], mask[:, 0], mask[:, -1]].any())


def more_hands(
    image: UInt8[Array, "H W 3"],
    known: Sequence[Choice],
    motion: Motion,
    segmenter: Segmenter,
    settings: HandSettings,
    motion_settings: MotionSettings,
) -> list[Choice]:
    """Hands that nobody named or found: they have a known hand's colours, reach in from the image's border, and move."""
    taken = np.any([k.mask for k in known], axis=0)
    if not taken.any() or not segmenter.promptable:
        return []
    memory = Appearance(settings.appearance)
    memory.learn(image, {"hand": taken})
    alike = opened((memory.evidence(image, "hand") > settings.alike) & (distance_to(taken) > settings.gap))
    moving, out = motion.moving(taken, motion_settings), []
    for part in large_parts(alike, int(settings.other[0] * taken.sum()), 0.0) if alike.any() else []:
        seen = part & motion.textured
        if not _at_the_border(part) or part.sum() > settings.other[1] * taken.sum() or not seen.any():
            continue
        if moving[seen].mean() < settings.moves:
            continue
        inside = np.argwhere(part)[:, ::-1].astype(np.float32)
        found = sane(segmenter.candidates(image, make_prompts(part, [taken])))
        best = choose_by_votes(found, inside, np.zeros((0, 2)), expected=part, settings=settings.landmarks)
        if best is not None:
            out.append(
                Choice(largest_part(found.masks[best] & ~taken), "looks and moves like the hand, from the border")
            )
    return out


def sane(found: Candidates, largest: float = 0.5) -> Candidates:
    """Candidates that are no line, and cover no more than this share of the image: more is a table or a wall."""
    if len(found) == 0:
        return found
    wide = np.array([m.any(0).sum() > 1 for m in found.masks], bool)
    return found.where((found.masks.mean((1, 2)) < largest) & wide)


def _pixels(points: Array, shape: tuple[int, int]) -> tuple[Array, Array]:
    pixel = np.rint(points[inside_image(points, *shape)]).astype(int)
    return pixel[:, 1], pixel[:, 0]
