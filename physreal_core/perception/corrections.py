"""Frames that somebody put right by hand: the mask there answers to the clicks, and what follows starts from it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int, UInt8
from physreal_core.perception.flow import inside_image, round_trip_error, sample
from physreal_core.perception.mask_geometry import (
    box_of,
    distance_to,
    intersection_over_union,
    spread_points,
    with_pixels_of,
)
from physreal_core.perception.prompting import Window, in_wide_enough_window, window_around
from physreal_core.perception.queries import spread_over
from physreal_core.perception.segmenter import Candidates, Prompt, Segmenter, zoomed_candidates
from physreal_core.perception.settings import DEFAULTS, AssociationSettings, QuerySettings
from physreal_core.perception.tracker import Tracks

FlowBetween = Callable[[int, int], Float[Array, "H W 2"]]


@dataclass(frozen=True)
class Correction:
    """What shows one thing in one frame.

    Attributes:
        frame: its number.
        thing: "object" or "controller".
        points: [K, 2] clicks (u, v) [px].
        labels: [K] 1 on the thing, 0 off it.
        box: (u0, v0, u1, v1) around the thing [px], or None.
    """

    frame: int
    thing: str
    points: Float[Array, "K 2"]
    labels: Int[Array, " K"]
    box: tuple[float, float, float, float] | None = None

    @property
    def on(self) -> Float[Array, "P 2"]:
        """The clicks on the thing."""
        return self.points[self.labels == 1]

    def told(self) -> tuple:
        """All that it says, as values that have a `repr`."""
        return self.frame, self.thing, self.points.tolist(), self.labels.tolist(), self.box


def corrected_mask(
    image: UInt8[Array, "H W 3"],
    correction: Correction,
    expected: Bool[Array, "H W"],
    segmenter: Segmenter,
    settings: AssociationSettings = DEFAULTS.association,
) -> Bool[Array, "H W"]:
    """The mask that answers to the clicks and is otherwise most like what was expected.

    Candidates are the segmenter's answers, and the expected mask with the pieces that clicks add to it or take off. One
    is judged by how many clicks it has right, then by its score and its likeness to the expected mask. What the best one
    still has wrong is put right around the click itself. With a box, the box stands for what is expected.

    Args:
        image: the frame.
        correction: what is known of the thing in it.
        expected: its mask so far; may be empty.
        segmenter: proposes masks.
        settings: of likeness, prompts and windows.
    """
    if correction.box is not None:
        expected = _filled(expected.shape, correction.box)
    around = with_pixels_of(expected, correction.points)
    prompts = _prompts(correction, expected, settings)
    missing, wrong = _pieces_asked(correction, expected)

    def ask(window: Window, asked: list[Prompt]) -> Candidates:
        if not asked:
            return Candidates.empty(*expected.shape)
        return zoomed_candidates(segmenter, image, asked, window)

    def choose(window: Window) -> Array:
        window = _holding(window, correction)
        carried = Candidates(expected[None], np.array([settings.carried_score], np.float32), np.array([-1]))
        found = [carried, ask(window, prompts)]
        if correction.box is None:
            found += _changed(expected, ask(window, missing), ask(window, wrong), settings.correction.piecewise)
        candidates = Candidates.join(found)
        likeness = np.array([intersection_over_union(mask, expected) for mask in candidates.masks])
        quality = candidates.scores * (settings.unlike + likeness)
        return candidates.masks[np.lexsort((quality, _agreement(candidates.masks, correction)))[-1]]

    chosen = in_wide_enough_window(choose, window_around(around, settings.window), settings.window)
    return _forced(chosen, correction, settings.correction.reach)


def _prompts(correction: Correction, expected: Array, settings: AssociationSettings) -> list[Prompt]:
    """Asks by the clicks alone, and by the clicks together with points and the box of the expected mask."""
    points, labels = np.asarray(correction.points, np.float32), np.asarray(correction.labels, int)
    asked = [Prompt(points, labels, correction.box)] if len(correction.on) or correction.box else []
    if correction.box is not None or not expected.any():
        return asked
    off = correction.points[correction.labels == 0]
    away = distance_to(with_pixels_of(np.zeros_like(expected), off)) if len(off) else np.full(expected.shape, np.inf)
    own = spread_points(expected & (away > settings.correction.doubt), settings.prompts.points_in_box)
    box = box_of(with_pixels_of(expected, correction.on), settings.prompts.margin)
    both = np.concatenate([points, own]), np.r_[labels, np.ones(len(own), int)]
    return [*asked, Prompt(*both), Prompt(*both, box), Prompt(points, labels, box)]


def _pieces_asked(correction: Correction, expected: Array) -> tuple[list[Prompt], list[Prompt]]:
    """Asks for what the expected mask misses, and for what it holds wrongly: by the clicks that it has wrong."""
    u, v = np.rint(correction.points).astype(int).reshape(-1, 2).T
    held, labels = expected[v, u], np.asarray(correction.labels, int)
    asked = []
    for sign in (1, 0):
        mine, other = (labels == sign) & (held != (sign == 1)), labels != sign
        points = np.concatenate([correction.points[mine], correction.points[other]]).astype(np.float32)
        own = Prompt(points, np.r_[np.ones(mine.sum(), int), np.zeros(other.sum(), int)])
        asked.append([own] if mine.any() and expected.any() else [])
    return asked[0], asked[1]


def _changed(expected: Array, missing: Candidates, wrong: Candidates, trust: float) -> list[Candidates]:
    """The expected mask with what it misses, without what it holds wrongly, and with both changes."""
    itself = Candidates(expected[None], np.array([trust], np.float32), np.array([-1]))
    held, area = ((missing.masks & mask).sum((1, 2)) for mask in (expected, np.ones_like(expected)))
    # What is larger than the expected mask, or holds most of it, is the thing itself and no piece of it.
    pieces = missing.where((area < expected.sum()) & (2 * held < expected.sum()))
    with_it = Candidates(pieces.masks | expected, trust * pieces.scores, pieces.prompt_index)
    without = [
        Candidates(base.masks & ~mask, base.scores * score, base.prompt_index)
        for mask, score in zip(wrong.masks, wrong.scores, strict=True)
        for base in (itself, with_it)
    ]
    return [with_it, *without]


def _holding(window: Window, correction: Correction) -> Window:
    """The window, widened to hold all clicks."""
    if not len(correction.points):
        return window
    low, high = np.floor(correction.points.min(0)), np.ceil(correction.points.max(0)) + 1
    u0, v0 = np.minimum(window[:2], low).astype(int).tolist()
    u1, v1 = np.maximum(window[2:], high).astype(int).tolist()
    return u0, v0, u1, v1


def _agreement(masks: Bool[Array, "N H W"], correction: Correction) -> Float[Array, " N"]:
    """Share of the clicks that each mask has right; 1 where there are none."""
    if not len(correction.points):
        return np.ones(len(masks))
    u, v = np.rint(correction.points).astype(int).T
    return (masks[:, v, u] == (correction.labels == 1)).mean(1)


def _forced(mask: Array, correction: Correction, reach: float) -> Array:
    """The mask with every click right: a disc around one that is not is added or taken out."""
    u, v = np.rint(correction.points).astype(int).reshape(-1, 2).T
    wrong = mask[v, u] != (correction.labels == 1)
    out = mask.copy()
    for point, label in zip(correction.points[wrong], correction.labels[wrong], strict=True):
        out[distance_to(with_pixels_of(np.zeros_like(mask), point[None])) <= reach] = label == 1
    out[v, u] = correction.labels == 1  # discs of two clicks may overlap
    return out


def _filled(shape: tuple[int, ...], box: tuple[float, ...]) -> Array:
    u0, v0, u1, v1 = np.rint(box).astype(int)
    mask = np.zeros(shape, bool)
    mask[max(v0, 0) : v1 + 1, max(u0, 0) : u1 + 1] = True
    return mask


@dataclass(frozen=True)
class Corrections:
    """All corrections of a clip, and how they are put to use while its masks are followed.

    Attributes:
        given: the corrections; at most one for a thing in a frame.
        frames: the clip.
        segmenter: proposes masks; needed only where something is corrected.
        flow_between: flow from one frame to a neighbour [px].
        settings: of masks and votes.
        queries: of the points that vote from a corrected frame on.
    """

    given: Sequence[Correction] = ()
    frames: Sequence[UInt8[Array, "H W 3"]] = ()
    segmenter: Segmenter | None = None
    flow_between: FlowBetween | None = None
    settings: AssociationSettings = DEFAULTS.association
    queries: QuerySettings = field(default_factory=QuerySettings)

    @property
    def keyframes(self) -> set[int]:
        """The corrected frames."""
        return {one.frame for one in self.given}

    def of(self, thing: str) -> set[int]:
        """The frames in which "object" or "controller" is corrected."""
        return {one.frame for one in self.given if one.thing == thing}

    def told(self, t: int) -> list[tuple]:
        """What is said of frame t, for the key of a result that depends on it."""
        return [one.told() for one in self.given if one.frame == t]

    def apply(self, t: int, masks: Mapping[str, Bool[Array, "H W"]]) -> set[str]:
        """Put the masks of frame t right (in place), and give the names of the corrected ones.

        What is corrected is certain: its pixels are taken from all masks that are not.
        """
        certain = {}
        for one in self.given:
            if one.frame == t and (name := _meant(one, masks)) is not None:
                certain[name] = corrected_mask(self.frames[t], one, masks[name], self.segmenter, self.settings)
        for name, mask in masks.items():
            if name in certain:
                mask[...] = certain[name]
            else:
                for other in certain.values():
                    mask &= ~other
        return set(certain)

    def amended(
        self, t: int, tracks: Mapping[str, Tracks], masks: Mapping[str, Bool[Array, "H W"]]
    ) -> dict[str, Tracks]:
        """The tracks that vote after frame t, of all things, whose masks there are these.

        Of what is corrected in frame t, a track that is seen off the mask votes no more, and new points on it do.
        """
        right = {_meant(one, masks) for one in self.given if one.frame == t}
        return {name: self._voters(own, masks[name], t) if name in right else own for name, own in tracks.items()}

    def _voters(self, tracks: Tracks, mask: Bool[Array, "H W"], t: int) -> Tracks:
        off = distance_to(mask) > self.settings.correction.tolerance
        points, visible = tracks.points, tracks.visible.copy()
        inside = inside_image(points[t], *mask.shape)
        pixel = np.rint(points[t][inside]).astype(int)
        elsewhere = np.flatnonzero(inside)[off[pixel[:, 1], pixel[:, 0]]]
        visible[t:, elsewhere[visible[t, elsewhere]]] = False
        new = self._followed(spread_over(mask, self.settings.correction.voters, self.queries), t)
        return replace(
            tracks,
            points=np.concatenate([points, new.points], axis=1),
            visible=np.concatenate([visible, new.visible], axis=1),
            confidence=np.concatenate([tracks.confidence, new.confidence], axis=1),
            starts=np.concatenate([tracks.starts, np.full(len(new.starts), t, tracks.starts.dtype)]),
        )

    def _followed(self, queries: Float[Array, "J 2"], start: int) -> Tracks:
        """Points of frame `start` along the flow to the end, until they miss themselves there and back."""
        height, width = self.frames[0].shape[:2]
        points = np.tile(queries, (len(self.frames), 1, 1)).astype(np.float32)
        visible = np.zeros(points.shape[:2], bool)
        visible[start] = True
        for t in range(start + 1, len(self.frames)):
            forward, backward = self.flow_between(t - 1, t), self.flow_between(t, t - 1)
            error = sample(round_trip_error(forward, backward), points[t - 1])
            points[t] = points[t - 1] + sample(forward, points[t - 1])
            held = error < self.settings.correction.round_trip
            visible[t] = visible[t - 1] & held & inside_image(points[t], height, width)
        return Tracks(points, visible)


def _meant(correction: Correction, masks: Mapping[str, Bool[Array, "H W"]]) -> str | None:
    """Which of several hands is corrected: the one nearest to what is said to be on it, else to what is off it."""
    names = [name for name in masks if name.partition(" ")[0] == correction.thing]
    if len(names) < 2:
        return names[0] if names else None
    spots = correction.on if len(correction.on) else correction.points
    if correction.box is not None:
        spots = np.array([[sum(correction.box[::2]) / 2, sum(correction.box[1::2]) / 2]])
    u, v = np.rint(spots).astype(int).T
    return min(names, key=lambda name: distance_to(masks[name])[v, u].sum() if masks[name].any() else np.inf)


NONE = Corrections()
"""Nothing was put right."""
