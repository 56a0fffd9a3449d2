"""Frame 0: which masks are the controllers (hands), and which is the target object."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.chooser import (
    TargetChooser,
    fit_to_hint,
    fit_to_motion,
    fit_to_touch,
    hint_prompts,
    moving_part,
)
from physreal_core.perception.colour import largest_part
from physreal_core.perception.hand_finder import Hand, HandFinder
from physreal_core.perception.mask_geometry import box_of, signed_distance, spread_points
from physreal_core.perception.prompting import Window, in_wide_enough_window, make_prompts, window_around
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, drop_duplicates, zoomed_candidates
from physreal_core.perception.settings import AssociationSettings, WindowSettings
from physreal_core.perception.votes import choose_by_votes

_MAX_AREA = 0.5  # of the image: more is a table or a wall
_UNTOUCHED = 0.02  # weight of what the hand does not touch: among many things one sounds right by chance
_AROUND_THING = WindowSettings(margin=0.4)
_AROUND_LANDMARKS = WindowSettings(margin=1.0, least=0.4)  # a hand reaches beyond its landmarks, and has an arm
_LANDMARKS = AssociationSettings(tie=0.15)  # of 21 landmarks three may lie beside the hand


@dataclass(frozen=True)
class Choice:
    """A mask [H, W] of frame 0 and how it was chosen."""

    mask: Bool[Array, "H W"]
    how: str


def find_controllers(
    image: UInt8[Array, "H W 3"], hint: Mapping[str, Any] | None, finder: HandFinder | None, segmenter: Segmenter
) -> list[Choice]:
    """Masks of what moves the object: what the hint names, else every hand that is found.

    Raises:
        InputError: there is neither a hint nor a hand.
    """
    if hint:
        return [_by_hint(image, hint, segmenter, "hints.controller")]
    hands = finder.find(image) if finder else []
    choices = [c for c in (_mask_of_hand(image, hand, segmenter) for hand in hands) if c is not None]
    if not choices:
        raise InputError(
            "no controller found",
            where="frame 0",
            expected="a hand that can be seen" if finder else "a hint, since no hand finder is configured",
            remedy='name it in capture.json under hints.controller, e.g. {"point": [u, v]}, or give masks/controller/',
        )
    return _one_each(choices)


def find_object(
    image: UInt8[Array, "H W 3"],
    hint: Mapping[str, Any] | None,
    hands: list[Bool[Array, "H W"]],
    segmenter: Segmenter,
    *,
    description: str = "",
    chooser: TargetChooser | None = None,
    motion: Float[Array, "H W"] | None = None,
) -> Choice:
    """The target's mask: by the hint, else by the description, else what the hand touches and moves.

    Raises:
        InputError: nothing fits; the mask would be empty.
    """
    hand = np.any(hands, axis=0)
    if hint:
        choice = _by_hint(image, hint, segmenter, "hints.object", hand, motion)
    else:
        choice = _by_fitness(image, hand, segmenter, description, chooser, motion)
    mask = _refined(image, choice.mask & ~hand, hands, segmenter) & ~hand
    if mask.sum() < 20:
        raise InputError(
            "the object's mask is empty",
            where="frame 0",
            expected="an object that is not the controller",
            remedy='name it in capture.json under hints.object, e.g. {"point": [u, v]}, or give masks/object/',
        )
    return Choice(mask, choice.how)


def _by_hint(
    image: Array,
    hint: Mapping[str, Any],
    segmenter: Segmenter,
    where: str,
    hand: Array | None = None,
    motion: Array | None = None,
) -> Choice:
    prompts = hint_prompts(image, hint, f"capture.json, {where}")
    if hand is not None and hand.any():
        off = spread_points(hand, 2)  # what is known to be something else
        prompts += [Prompt(np.r_[p.points, off], np.r_[p.labels, np.zeros(len(off), int)], p.box) for p in prompts]
        prompts += _motion_prompts(hand, motion)
    found = _sane(segmenter.candidates(image, prompts))
    fit = fit_to_hint(image, found.masks, hint) * found.scores if len(found) else np.zeros(0)
    if len(found) == 0 or fit.max() <= 0:
        raise InputError(
            f"no mask answers to {dict(hint)}", where=f"frame 0, {where}", remedy="move the point or the box onto it"
        )
    if hand is not None and motion is not None:
        fit = fit * fit_to_motion(found.masks, hand, motion)
    elif "point" in hint:  # part, whole and group all hold the point: the surest of those that are nearly as sure
        fit = np.where(fit >= fit.max() - 0.05, found.masks.sum((1, 2)), 0)
    return Choice(largest_part(found.masks[int(fit.argmax())]), f"{where}: {', '.join(hint)}")


def _by_fitness(
    image: Array,
    hand: Array,
    segmenter: Segmenter,
    description: str,
    chooser: TargetChooser | None,
    motion: Array | None,
) -> Choice:
    """What lies around the hand, or everything in the image, ranked by touch and by the words."""
    found = drop_duplicates(_sane(segmenter.candidates(image, _ring_prompts(hand) + _motion_prompts(hand, motion))))
    fit = fit_to_touch(found, hand, motion)
    if segmenter.promptable and (chooser is not None or not (fit > 0).any()):
        found = drop_duplicates(Candidates.join([found, _sane(segmenter.candidates(image))]))
        fit = fit_to_touch(found, hand, motion)
    how = "what the hand touches"
    if chooser is not None and description:
        found = found.where((found.masks & ~hand).sum((1, 2)) >= 0.5 * found.masks.sum((1, 2)))  # the hand is no target
        fit = fit_to_touch(found, hand, motion)
    if chooser is not None and description and len(found):
        words = chooser.scores(image, found.masks, description)
        fit = np.exp(words - words.max()) * (_UNTOUCHED + fit / max(fit.max(), 1e-9))
        how = f"description {description!r} and what the hand touches"
    if not (fit > 0).any():
        return Choice(np.zeros(image.shape[:2], bool), how)
    return Choice(found.masks[int(fit.argmax())], how)


def _ring_prompts(hand: Array, count: int = 32) -> list[Prompt]:
    """Single points close around the hand, each with two of the hand's own as what is not meant."""
    away = -signed_distance(hand)
    reach = 0.06 * np.hypot(*hand.shape)
    off = spread_points(hand, 2)
    labels = np.r_[1, np.zeros(len(off), int)]
    near = spread_points((away > 2) & (away < reach), count, margin=0.5)
    return [Prompt(np.concatenate([p[None], off]), labels) for p in near]


def _motion_prompts(hand: Array, motion: Array | None) -> list[Prompt]:
    """Asks for what moves besides the hand as a whole."""
    if motion is None or not (moving := largest_part(moving_part(hand, motion))).any():
        return []
    return make_prompts(moving, [hand])


def _refined(image: Array, mask: Array, others: list[Array], segmenter: Segmenter) -> Array:
    """The same thing cut out again at the resolution of its surroundings."""
    if not segmenter.promptable or not mask.any():
        return mask
    inside = np.argwhere(signed_distance(mask) >= 1)[:, ::-1].astype(np.float32)

    def choose(window: Window) -> Array | None:
        found = _sane(zoomed_candidates(segmenter, image, make_prompts(mask, others), window))
        best = choose_by_votes(found, inside, np.zeros((0, 2)), expected=mask)
        return None if best is None else largest_part(found.masks[best])

    chosen = in_wide_enough_window(choose, window_around(mask, _AROUND_THING))
    return mask if chosen is None else chosen


def _mask_of_hand(image: Array, hand: Hand, segmenter: Segmenter) -> Choice | None:
    """The mask that holds most of the landmarks; MediaPipe's points vote, the segmenter's score breaks ties."""
    low, high = hand.points.min(0), hand.points.max(0)
    box = tuple(float(x) for x in (*(low - 0.1 * (high - low)), *(high + 0.1 * (high - low))))
    knuckles = hand.points[[0, 5, 9, 13, 17]] if len(hand.points) == 21 else hand.points[:5]
    prompts = [
        Prompt(p, np.ones(len(p), np.int64), b)
        for p, b in ((knuckles, None), (knuckles[2:3], box), (knuckles[:3], box))
    ]
    seed = np.zeros(image.shape[:2], bool)
    u0, v0, u1, v1 = (int(np.clip(x, 0, n - 1)) for x, n in zip(box, (*image.shape[1::-1],) * 2, strict=True))
    seed[v0 : v1 + 1, u0 : u1 + 1] = True

    def choose(window: Window) -> Array | None:
        found = _sane(zoomed_candidates(segmenter, image, prompts, window))
        best = choose_by_votes(found, hand.points, np.zeros((0, 2)), settings=_LANDMARKS)
        return None if best is None else found.masks[best]

    mask = in_wide_enough_window(choose, window_around(seed, _AROUND_LANDMARKS))
    return None if mask is None else Choice(mask, f"hand found, presence {hand.presence:.2f}")


def _one_each(choices: list[Choice]) -> list[Choice]:
    kept: list[Choice] = []
    for choice in choices:
        if all((choice.mask & k.mask).sum() < 0.3 * choice.mask.sum() for k in kept):
            kept.append(choice)
    return kept


def _sane(found: Candidates) -> Candidates:
    area = found.masks.mean((1, 2)) if len(found) else np.zeros(0)
    wide = np.array([np.ptp(box_of(m)[::2]) > 0 if m.any() else False for m in found.masks], bool)
    return found.where((area < _MAX_AREA) & wide)
