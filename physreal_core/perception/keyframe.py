"""One keyframe answered: candidates of the segmenter, ranked and mended by the evidence, and checked against the flow."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.perception.evidence import Carried, consensus, gain, gather
from physreal_core.perception.mask_geometry import distance_to, intersection_over_union, thick_parts, with_pixels_of
from physreal_core.perception.motion import texture
from physreal_core.perception.prompting import Window, in_wide_enough_window, prompts_for_carried, window_around
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, zoomed_candidates
from physreal_core.perception.settings import AssociationSettings, CheckSettings, EvidenceSettings


@dataclass(frozen=True)
class Sight:
    """What is known of one thing in a frame before the segmenter is asked.

    Attributes:
        carried: its mask from the frames around.
        voters: its visible tracks (u, v) [px].
        colours: evidence of its colours [log-odds].
    """

    carried: Carried
    voters: Float[Array, "J 2"]
    colours: Float[Array, "H W"]


@dataclass(frozen=True)
class Answer:
    """A thing's mask on a keyframe.

    Attributes:
        mask: where it is.
        answered: whether the segmenter's answer was believed; otherwise it is the carried mask, mended.
        gain: share of the evidence that the mask gathers (1: all for it, nothing against).
        overlap: IoU with the carried mask, where the flow held.
        growth: its area over the carried mask's, there.
    """

    mask: Bool[Array, "H W"]
    answered: bool
    gain: float
    overlap: float
    growth: float


class Keyframe:
    """Asks for all things of one frame; the image is encoded once for what lies in one window.

    Args:
        image: the frame.
        sights: what is known, by the things' names, the object first.
        background: points (u, v) [px] that lie on none of them.
        segmenter: proposes masks.
        settings: of prompts, windows, evidence and checks.
    """

    def __init__(
        self,
        image: UInt8[Array, "H W 3"],
        sights: Mapping[str, Sight],
        background: Float[Array, "K 2"],
        segmenter: Segmenter,
        settings: AssociationSettings,
    ) -> None:
        self.image, self.background = image, background
        self.segmenter, self.settings = segmenter, settings
        # Flow drags a bare table along with what moves on it: there the carried mask is a guess.
        textured = texture(image, settings.texture_patch) > settings.texture
        self.sights = {n: replace(s, carried=_told_by_flow(s.carried, textured)) for n, s in sights.items()}

    def answers(self) -> dict[str, Answer]:
        """An answer for every thing whose carried mask is not empty."""
        return {name: self._answer(name) for name in self.sights}

    def _answer(self, name: str) -> Answer:
        sight, expected = self.sights[name], self.sights[name].carried.mask
        if not expected.any():
            return Answer(expected, False, 0.0, 0.0, 0.0)
        others = [s for n, s in self.sights.items() if n != name]
        against = np.concatenate([self.background, *(s.voters for s in others)])
        known = gather(sight.carried, sight.voters, against, sight.colours, self.settings.evidence)
        best: list[Answer] = []

        def choose(window: Window) -> Array:
            found = self._ask(name, window, expected & (known > 0))
            seen = _within(np.ones_like(expected), window)
            best.append(self._judge(found, known, sight.carried, seen))
            return best[-1].mask

        window = self._window(name)
        if _holds(window, expected):
            in_wide_enough_window(choose, window, self.settings.window)
        else:
            choose(window)
        answer = best[-1]
        return answer if answer.answered else _standing_in(known, sight.carried, self.settings)

    def _ask(self, name: str, window: Window, standing: Array) -> Candidates:
        """Candidates within a window; beyond it what stands of the carried mask."""
        sight = self.sights[name]
        expected = sight.carried.mask
        others = [s.carried.mask for n, s in self.sights.items() if n != name]
        prompts = prompts_for_carried(
            _within(expected, window),
            [_within(o, window) for o in others],
            sight.voters,
            self.background,
            self.settings.prompts,
        )
        found = zoomed_candidates(self.segmenter, self.image, _inside(prompts, window), window)
        beyond = standing & ~_within(standing, window)
        return Candidates(found.masks | beyond, found.scores, found.prompt_index)

    def _judge(self, found: Candidates, known: Array, carried: Carried, shown: Array) -> Answer:
        """The candidate that gathers most, mended by the pieces of the others; what was not `shown` no one spoke of."""
        s, expected = self.settings.evidence, carried.mask
        own = Candidates(expected[None], np.array([self.settings.carried_score], np.float32), np.array([-1]))
        everything = Candidates.join([found, own])
        evidence = known + np.where(shown, consensus(found, expected, s), 0.0)
        rank = gain(everything.masks, evidence) + s.score * everything.scores
        first = everything.masks[int(rank.argmax())]
        mask = _mended(first, everything.masks, evidence, s.least_piece * expected.sum(), s)
        return _checked(mask, known, evidence, carried, self.settings.check, len(found) > 0)

    def _window(self, name: str) -> Window:
        """Around the object and what is near it of the others; around a thing of which nothing is near, itself."""
        if not self.segmenter.promptable:
            return 0, 0, *self.image.shape[1::-1]
        names = list(self.sights)
        main = self.sights[names[0]]
        around = with_pixels_of(main.carried.mask, main.voters)
        if not around.any():
            around = self.sights[name].carried.mask
        near = distance_to(around) < self.settings.reach * np.hypot(*around.shape)
        parts = [self.sights[n].carried.mask & near for n in names]
        if not parts[names.index(name)].any():
            return window_around(self.sights[name].carried.mask, self.settings.window)
        return window_around(np.any([around, *parts], axis=0), self.settings.window)


def _mended(first: Array, masks: Array, evidence: Array, least: float, settings: EvidenceSettings) -> Array:
    """A mask with the pieces of the others for which there is evidence, without its own against which there is."""
    mask = first.copy()
    for other in masks:
        for piece in thick_parts(other & ~mask, least, settings.strip):
            if evidence[piece].mean() > settings.piece:
                mask |= piece
    for other in [*masks, evidence > 0]:
        for piece in thick_parts(mask & ~other, least, settings.strip):
            if evidence[piece].mean() < -settings.piece:
                mask &= ~piece
    return mask


def _checked(
    mask: Array, known: Array, evidence: Array, carried: Carried, settings: CheckSettings, asked: bool
) -> Answer:
    """Whether an answer may be believed: it gathers the evidence, and is what the flow carried here, or is better.

    Where the flow could not hold, the carried mask says nothing for or against the answer.
    """
    expected = carried.mask
    gathered = float(gain(mask[None], evidence)[0])
    there, before = mask & carried.held, expected & carried.held
    overlap, growth = (
        (intersection_over_union(there, before), float(there.sum() / before.sum())) if before.any() else (1.0, 1.0)
    )
    witness = carried.held[expected].mean() >= settings.held
    alike = overlap >= settings.overlap and 1 / settings.area <= growth <= settings.area
    better, as_it_was = gain(np.stack([mask, expected]), known)
    believed = asked and bool(mask.any()) and gathered >= settings.gain
    return Answer(mask, bool(believed and (alike or not witness or better >= as_it_was)), gathered, overlap, growth)


def _told_by_flow(carried: Carried, textured: Bool[Array, "H W"]) -> Carried:
    return Carried(carried.distance, carried.held & textured)


def _standing_in(known: Array, carried: Carried, settings: AssociationSettings) -> Answer:
    """The carried mask, without the pieces against which there is evidence."""
    mask, least = carried.mask.copy(), settings.evidence.least_piece * carried.mask.sum()
    for piece in thick_parts(mask & (known < 0), least, settings.evidence.strip):
        if known[piece].mean() < -settings.check.drop:
            mask &= ~piece
    share = float(mask.sum() / max(carried.mask.sum(), 1))
    return Answer(mask, False, float(gain(mask[None], known)[0]), intersection_over_union(mask, carried.mask), share)


def _within(mask: Array, window: Window) -> Array:
    """The part of a mask that lies in a window."""
    u0, v0, u1, v1 = window
    out = np.zeros_like(mask)
    out[v0:v1, u0:u1] = mask[v0:v1, u0:u1]
    return out


def _holds(window: Window, mask: Array) -> bool:
    return bool((_within(mask, window) == mask).all())


def _inside(prompts: Sequence[Prompt], window: Window) -> list[Prompt]:
    """Prompts of which a point that is on the thing, or a box, lies in the window."""
    u0, v0, u1, v1 = window
    kept = []
    for prompt in prompts:
        on = prompt.points[prompt.labels > 0]
        inside = ((on >= [u0, v0]) & (on < [u1, v1])).all(-1)
        if prompt.box is not None or inside.any():
            kept.append(prompt)
    return kept
