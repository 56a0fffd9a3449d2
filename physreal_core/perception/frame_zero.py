"""Frame 0: which masks are the controllers (hands), and which is the target object."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, UInt8
from physreal_core.errors import InputError
from physreal_core.perception.choices import Choice
from physreal_core.perception.chooser import TargetChooser, fit_to_hint, hint_prompts, opened
from physreal_core.perception.colour import largest_part
from physreal_core.perception.hand_finder import HandFinder
from physreal_core.perception.hands import find_hands, reaching_in, sane
from physreal_core.perception.mask_geometry import (
    distance_to,
    intersection_over_union,
    large_parts,
    signed_distance,
    spread_points,
)
from physreal_core.perception.motion import Motion
from physreal_core.perception.prompting import Window, in_wide_enough_window, make_prompts, window_around
from physreal_core.perception.ranking import filled, fit_to_motion, fit_to_touch, moving_off, shade_near
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, drop_duplicates, zoomed_candidates
from physreal_core.perception.settings import DEFAULTS, HandSettings, MotionSettings, RankingSettings, WindowSettings
from physreal_core.perception.votes import choose_by_votes

_AROUND_THING = WindowSettings(margin=0.4)
_LEAST_PIXELS = 20  # of an object's mask
_WITHIN = 0.9  # a part has at least this share of its pixels within the whole


def find_controllers(
    image: UInt8[Array, "H W 3"],
    hint: Mapping[str, Any] | None,
    finder: HandFinder | None,
    segmenter: Segmenter,
    settings: HandSettings = DEFAULTS.hands,
    motion: Motion | None = None,
    motion_settings: MotionSettings = DEFAULTS.ranking.motion,
) -> list[Choice]:
    """Masks of what moves the object: what the hint names, else every hand that is found, with its arm, else what moves and reaches in from
    the border.

    Raises:
        InputError: there is neither a hint nor a hand, nor anything else that reaches in.
    """
    if hint:
        return [_by_hint(image, hint, segmenter, "hints.controller")]
    choices = find_hands(image, finder, segmenter, settings) if finder else []
    if not choices and motion is not None:
        choices = reaching_in(image, motion, segmenter, settings, motion_settings)
    if not choices:
        raise InputError(
            "no controller found",
            where="frame 0",
            expected="a hand that can be seen, or something that moves and reaches in from the image's border",
            remedy="click it with `physreal label`, name it in capture.json under hints.controller, "
            'e.g. {"point": [u, v]}, or give masks/controller/',
        )
    return choices


def find_object(
    image: UInt8[Array, "H W 3"],
    hint: Mapping[str, Any] | None,
    hands: Sequence[Choice],
    segmenter: Segmenter,
    *,
    description: str = "",
    chooser: TargetChooser | None = None,
    motion: Motion | None = None,
    settings: RankingSettings = DEFAULTS.ranking,
) -> Choice:
    """The target's mask: by the hint, else by the description, else what the hand touches and moves.

    Raises:
        InputError: nothing fits; the mask would be empty.
    """
    taken = np.any([h.mask for h in hands], axis=0)
    if hint:
        choice = _by_hint(image, hint, segmenter, "hints.object", taken, motion)
    else:
        choice = _by_fitness(image, hands, segmenter, description, chooser, motion, settings)
    mask = _refined(image, choice.mask & ~taken, [h.mask for h in hands], segmenter, settings) & ~taken
    if mask.sum() < _LEAST_PIXELS:
        raise InputError(
            "the object's mask is empty",
            where="frame 0",
            expected="an object that is not the controller",
            remedy="click it with `physreal label`, name it in capture.json under hints.object, "
            'e.g. {"point": [u, v]}, or give masks/object/',
        )
    return replace(choice, mask=mask, moves=_moving_share(mask, taken, motion, settings))


def _moving_share(mask: Array, hand: Array, motion: Motion | None, settings: RankingSettings) -> float | None:
    """How much of what can be seen of a mask moves; None where that cannot be told."""
    if motion is None or (mask & motion.textured).sum() < settings.least_moving:
        return None
    return float(motion.moving(hand, settings.motion)[mask & motion.textured].mean())


def _by_hint(
    image: Array,
    hint: Mapping[str, Any],
    segmenter: Segmenter,
    where: str,
    hand: Array | None = None,
    motion: Motion | None = None,
) -> Choice:
    prompts = hint_prompts(image, hint, f"capture.json, {where}")
    if hand is not None and hand.any():
        off = spread_points(hand, 2)  # what is known to be something else
        prompts += [Prompt(np.r_[p.points, off], np.r_[p.labels, np.zeros(len(off), int)], p.box) for p in prompts]
        prompts += _motion_prompts(hand, motion, DEFAULTS.ranking)
    found = sane(segmenter.candidates(image, prompts))
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
    hands: Sequence[Choice],
    segmenter: Segmenter,
    description: str,
    chooser: TargetChooser | None,
    motion: Motion | None,
    settings: RankingSettings,
) -> Choice:
    """What lies around the hand, or everything in the image, ranked by touch and by the words."""
    hand, taken = (np.any([getattr(h, part) for h in hands], axis=0) for part in ("hand", "mask"))

    def fitness(found: Candidates) -> Array:
        return fit_to_touch(found, hand, motion, image=image, arm=taken, settings=settings)

    shade = shade_near(image, taken, motion, settings)
    prompts = _ring_prompts(hand, taken, settings) + _motion_prompts(taken, motion, settings, shade)
    found = drop_duplicates(_tidy(sane(segmenter.candidates(image, prompts)), settings))
    fit = fitness(found)
    if segmenter.promptable and (chooser is not None or not (fit > 0).any()):
        found = drop_duplicates(Candidates.join([found, _tidy(sane(segmenter.candidates(image)), settings)]))
        fit = fitness(found)
    how = "what the hand touches"
    if chooser is not None and description:
        found = found.where(
            (found.masks & ~taken).sum((1, 2)) >= 0.5 * found.masks.sum((1, 2))
        )  # the hand is no target
        fit = fitness(found)
    if chooser is not None and description and len(found):
        words = chooser.scores(image, found.masks, description)
        fit = np.exp(words - words.max()) * (settings.untouched + fit / max(fit.max(), 1e-9))
        how = f"description {description!r} and what the hand touches"
    if not (fit > 0).any():
        return Choice(np.zeros(image.shape[:2], bool), how)
    return _ranked(found.masks & ~taken, fit, how, shade, settings)


def _ranked(masks: Array, fit: Array, how: str, shade: Array, settings: RankingSettings) -> Choice:
    """The best candidate, or the whole that it is a part of; and what else could have been meant."""
    order = [int(i) for i in np.argsort(-fit, kind="stable") if fit[i] > 0]
    best = order[0]
    for i in order:
        if (
            fit[i] >= settings.whole_fit * fit[best]
            and masks[i].sum() > masks[best].sum()
            and _part(masks[best], masks[i])
        ):
            more = masks[i] & ~masks[best]
            if shade[more].mean() <= settings.shadow.extra:
                best = i
    kept = [best]
    for i in order:
        alike = any(intersection_over_union(masks[i], masks[k]) >= settings.same for k in kept)
        own_part = _part(masks[i], masks[best]) and settings.part_fit * fit[i] <= fit[best]
        if not alike and not own_part:
            kept.append(i)
    kept = kept[: 1 + settings.rivals]
    return Choice(masks[best], how, masks[kept], fit[kept] / (fit[kept].sum() + settings.nothing))


def _part(part: Array, whole: Array) -> bool:
    return bool((part & whole).sum() >= _WITHIN * part.sum())


def _tidy(found: Candidates, settings: RankingSettings) -> Candidates:
    """Candidates without their specks."""
    clean = [np.any(large_parts(opened(m), 1, settings.part), axis=0) for m in found.masks]
    return Candidates(np.stack(clean), found.scores, found.prompt_index) if clean else found


def _ring_prompts(hand: Array, taken: Array, settings: RankingSettings) -> list[Prompt]:
    """Single points close around the hand, each with two of the hand's own as what is not meant."""
    away = -signed_distance(hand)
    reach = settings.ring_reach * np.hypot(*hand.shape)
    off = spread_points(hand, 2)
    labels = np.r_[1, np.zeros(len(off), int)]
    near = spread_points((away > 2) & (away < reach) & ~taken, settings.ring, margin=0.5)
    return [Prompt(np.concatenate([p[None], off]), labels) for p in near]


def _motion_prompts(
    hand: Array, motion: Motion | None, settings: RankingSettings, shade: Array | None = None
) -> list[Prompt]:
    """Asks for what moves besides the hand as a whole, for the body that it is a part of, and for single points on it."""
    if motion is None:
        return []
    moving = opened(moving_off(hand, motion, settings, shade))
    whole = largest_part(_closed(moving, settings) & ~hand)
    if not whole.any():
        return []
    off = spread_points(hand, 2)
    labels = np.r_[1, np.zeros(len(off), int)]
    close = moving & (distance_to(hand) < settings.ring_reach * np.hypot(*hand.shape))
    seeds = [p for where in (whole & motion.textured, close) for p in spread_points(where, settings.seeds)]
    prompts = make_prompts(whole, [hand]) + [Prompt(np.concatenate([p[None], off]), labels) for p in seeds]
    body = _body(whole, hand if shade is None else hand | shade, motion, settings)
    return prompts if body is None else prompts + make_prompts(body, [hand])


def _body(moving: Array, hand: Array, motion: Motion, settings: RankingSettings) -> Array | None:
    """The connected textured region that what moves belongs to, since a soft thing need not move as a whole."""
    import cv2

    _, labels = cv2.connectedComponents(opened(_closed(motion.textured, settings) & ~hand).astype(np.uint8))
    shared = np.bincount(labels[moving], minlength=labels.max() + 1)
    shared[0] = 0
    body = filled(labels == int(shared.argmax()))
    edge = np.r_[body[0], body[-1], body[:, 0], body[:, -1]]
    return body if shared.max() and not edge.any() and body.mean() < settings.largest_body else None


def _closed(mask: Array, settings: RankingSettings) -> Array:
    import cv2

    square = np.ones((settings.motion.close, settings.motion.close), np.uint8)
    return cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_CLOSE, square) > 0


def _refined(
    image: Array, mask: Array, others: list[Bool[Array, "H W"]], segmenter: Segmenter, settings: RankingSettings
) -> Array:
    """The same thing cut out again at the resolution of its surroundings; in two parts where a hand lies across it."""
    if not segmenter.promptable or not mask.any():
        return mask
    inside = np.argwhere(signed_distance(mask) >= 1)[:, ::-1].astype(np.float32)
    taken = np.any([np.zeros_like(mask), *others], axis=0)

    def choose(window: Window) -> Array | None:
        found = sane(zoomed_candidates(segmenter, image, make_prompts(mask, others), window))
        best = choose_by_votes(found, inside, np.zeros((0, 2)), expected=mask)
        return None if best is None else np.any(large_parts(found.masks[best] & ~taken, 1, settings.part), axis=0)

    chosen = in_wide_enough_window(choose, window_around(mask, _AROUND_THING))
    if chosen is None or intersection_over_union(chosen, mask) < settings.same:
        return mask
    return chosen
