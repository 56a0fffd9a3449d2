"""One mask per frame: asked for on keyframes by all that is known (eq. mask_tracking), carried by the flow in between."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import remembered
from physreal_core.perception.appearance import Appearance
from physreal_core.perception.corrections import NONE, Corrections
from physreal_core.perception.evidence import Carried
from physreal_core.perception.flow import pixel_grid, round_trip_error, sample
from physreal_core.perception.keyframe import Answer, Keyframe, Sight
from physreal_core.perception.mask_geometry import (
    distance_to,
    intersection_over_union,
    settle_overlaps,
    signed_distance,
)
from physreal_core.perception.segmenter import Segmenter
from physreal_core.perception.settings import DEFAULTS, AssociationSettings
from physreal_core.perception.tracker import Tracks
from physreal_core.perception.votes import count_votes, seen, standing_still

FlowBetween = Callable[[int, int], Float[Array, "H W 2"]]
NUMBERS = ("answered", "gain", "overlap", "growth", "voters", "left_out", "taken_in", "colour")
"""What is told of a thing on a keyframe. The first four are `Answer`'s; voters: share of its tracks that are visible;
left_out: share of those off the mask; taken_in: points of others on the mask over its own visible tracks; colour: mean
evidence of the mask's colours."""


@dataclass
class Thing:
    """Something followed through the video: its name, its mask in frame 0, and the tracks that vote for it."""

    name: str
    mask: Bool[Array, "H W"]
    tracks: Tracks

    def seen(self, t: int) -> Float[Array, "K 2"]:
        """Its tracks that are visible in frame t (u, v) [px]."""
        return seen(self.tracks, t)


@dataclass(frozen=True)
class Followed:
    """Masks [T, H, W] by the things' names; by name and keyframe the numbers of `NUMBERS`."""

    masks: Mapping[str, Bool[Array, "T H W"]]
    keyframes: Mapping[str, Mapping[int, Mapping[str, float]]]

    def unanswered(self, name: str) -> list[int]:
        """Keyframes on which no answer for a thing was believed, so that the carried mask stands."""
        return [t for t, told in self.keyframes[name].items() if not told["answered"]]


def follow_masks(
    frames: Sequence[UInt8[Array, "H W 3"]],
    things: Sequence[Thing],
    background: Tracks,
    segmenter: Segmenter,
    flow_between: FlowBetween,
    *,
    stride: int,
    settings: AssociationSettings = DEFAULTS.association,
    corrections: Corrections = NONE,
    tick: Callable[[int], None] = lambda frames: None,
) -> Followed:
    """Masks of all things in all frames.

    Args:
        frames: T images.
        things: what to follow, the object first; in between keyframes earlier ones lose pixels that later ones claim too.
        background: tracks that belong to none of them and vote against all where they stand still.
        segmenter: proposes masks on keyframes.
        flow_between: flow from one frame to a neighbour [px].
        stride: largest keyframe distance; it is less where the flow loses the object [frames].
        settings: of the votes, of the prompts and of the windows.
        corrections: of frames that were put right by hand; each is a keyframe, and certain.
        tick: called after each keyframe with how many frames it settled.
    """
    film = _Film(frames, things, background, segmenter, flow_between, settings, corrections)
    start = 0
    while start < len(frames) - 1:
        stop = film.next_keyframe(start, stride)
        span = slice(start + 1, stop + 1)
        found = remembered(
            "keyframe",
            lambda start=start, stop=stop: film.depends(start, stop),
            {"masks": (len(things), stop - start, *frames[0].shape[:2]), "told": (len(things), len(NUMBERS))},
            lambda start=start, stop=stop: film.follow(start, stop),
            lasting=True,
        )
        for x, own, told in zip(things, found["masks"], found["told"], strict=True):
            film.masks[x.name][span] = own
            film.told[x.name][stop] = dict(zip(NUMBERS, told.tolist(), strict=True))
        film.learn(stop)
        film.amend(stop)
        tick(stop - start)
        start = stop
    film.mend()
    film.look_again()
    return Followed(film.masks, film.told)


@dataclass
class _Film:
    """What masks are followed through, by what, and what is known so far. Masks and answers are by the things' names."""

    frames: Sequence[UInt8[Array, "H W 3"]]
    things: Sequence[Thing]
    background: Tracks
    segmenter: Segmenter
    flow_between: FlowBetween
    settings: AssociationSettings
    corrections: Corrections = NONE
    masks: dict[str, Array] = field(default_factory=dict)
    told: dict[str, dict[int, dict[str, float]]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for x in self.things:
            self.masks[x.name] = np.zeros((len(self.frames), *self.frames[0].shape[:2]), bool)
            self.masks[x.name][0] = x.mask
            self.told[x.name] = {}
        self.appearance = Appearance(self.settings.appearance)
        self.appearance.learn(self.frames[0], {x.name: x.mask for x in self.things})
        self._carried: dict[str, list[Carried]] = {}
        self._agreed: dict[tuple[int, int], Array] = {}

    def next_keyframe(self, start: int, stride: int) -> int:
        """The first frame within a stride to which the flow does not hold enough of the object; no short rest is left."""
        s, main, last = self.settings, self.things[0].name, len(self.frames) - 1
        self._agreed.clear()
        rest = min(s.least_stride, stride - 1) // 2
        farthest = last if last - start <= stride + rest else start + stride
        farthest = min([farthest, *(t for t in self.corrections.keyframes if t > start)])
        self._carried = {x.name: [_certain(self.masks[x.name][start])] for x in self.things}
        for t in range(start + 1, farthest + 1):
            for x in self.things:
                self._carried[x.name].append(self._carry_on(self._carried[x.name][-1], t - 1, t))
            now = self._carried[main][-1]
            lost = 1 - now.held[now.mask].mean() if now.mask.any() else 0.0
            if lost > s.stray and t - start >= s.least_stride:
                return t
        return farthest

    def depends(self, start: int, stop: int) -> list[Any]:
        """All that the masks after one keyframe up to the next follow from, beside the frames and the networks."""
        things = [
            part
            for x in self.things
            for part in (x.name, self.masks[x.name][start], x.seen(stop), x.tracks.visible.shape)
        ]
        against = standing_still(self.background, stop, self.settings.still)
        told = self.corrections.told(stop)
        return [start, stop, self.settings, told, against, *self.appearance.told(), *things]

    def follow(self, start: int, stop: int) -> dict[str, Array]:
        """The masks after one keyframe up to the next, and the `NUMBERS` of every thing on that (both also in place)."""
        forth = self._carried
        answers = self.ask(stop, {name: carried[-1] for name, carried in forth.items()})
        answers = self._enter(stop, answers)
        self._fill_between(start, stop, forth)
        return {
            "masks": np.stack([self.masks[x.name][start + 1 : stop + 1] for x in self.things]),
            "told": np.array([[*self._told(x, answers[x.name], stop).values()] for x in self.things], float),
        }

    def learn(self, t: int) -> None:
        """Take in how the things look on a keyframe on which all answers were believed; one put right by hand is the first."""
        if t in self.corrections.keyframes:
            self.appearance = Appearance(self.settings.appearance)
        if all(self.told[x.name][t]["answered"] for x in self.things):
            self.appearance.learn(self.frames[t], {x.name: self.masks[x.name][t] for x in self.things})

    def amend(self, t: int) -> None:
        """Who votes for the things after a keyframe that was put right by hand."""
        tracks = {x.name: x.tracks for x in self.things}
        amended = self.corrections.amended(t, tracks, {x.name: self.masks[x.name][t] for x in self.things})
        for x in self.things:
            x.tracks = amended[x.name]

    def ask(self, t: int, carried: Mapping[str, Carried], claimed: Array | None = None) -> dict[str, Answer]:
        """The answers on frame t; background points on what is `claimed` [H, W] by things do not vote."""
        against = standing_still(self.background, t, self.settings.still)
        if claimed is not None:
            against = against[sample(claimed.astype(np.float32), against) == 0]
        sights = {
            x.name: Sight(carried[x.name], x.seen(t), self.appearance.evidence(self.frames[t], x.name))
            for x in self.things
        }
        return Keyframe(self.frames[t], sights, against, self.segmenter, self.settings).answers()

    def mend(self) -> None:
        """Ask again on keyframes whose answer was not believed, now from the next one whose answer was (in place)."""
        keys = [0, *self.told[self.things[0].name]]
        for before, t, after in zip(keys[-3::-1], keys[-2:0:-1], keys[:1:-1], strict=True):
            doubtful = [x for x in self.things if not self._sure(x, t) and self._sure(x, after)]
            doubtful = [x for x in doubtful if t not in self.corrections.keyframes]
            if not doubtful:
                continue
            back = {x.name: self.carry(self.masks[x.name][after], after, t)[-1] for x in self.things}
            answers = self.ask(t, back)
            for x in doubtful:
                if answers[x.name].answered:
                    self.masks[x.name][t] = answers[x.name].mask
                    self.told[x.name][t] = self._told(x, answers[x.name], t)
            settle_overlaps([self.masks[x.name][t] for x in self.things])
            for start, stop in ((before, t), (t, after)):
                self._fill_between(
                    start, stop, {x.name: self.carry(self.masks[x.name][start], start, stop) for x in self.things}
                )

    def _sure(self, thing: Thing, t: int) -> bool:
        """Whether the answer on a keyframe was believed, and was what the flow had carried there."""
        told = self.told[thing.name][t]
        return bool(told["answered"]) and told["overlap"] >= self.settings.check.overlap

    def look_again(self) -> None:
        """Frame 0 answered once more (in place), now that the keyframes after it say what belongs together."""
        s, expected, alike = self.settings, {}, True
        for x in self.things:
            keys = [k for k, told in self.told[x.name].items() if told["answered"]][: s.keyframes_back]
            back = [self.carry(self.masks[x.name][k], k, 0)[-1].mask for k in keys]
            expected[x.name] = _certain(np.mean([x.mask, *back], axis=0) > s.agreement)
            alike &= intersection_over_union(expected[x.name].mask, x.mask) >= s.as_it_was
        if alike:
            return
        # Points sampled as background may lie on parts of the object that frame 0's first mask missed.
        claimed = np.any([c.mask for c in expected.values()], axis=0)
        self._enter(0, self.ask(0, expected, claimed))
        if told := next(iter(self.told.values())):
            first = min(told)
            self._fill_between(0, first, {x.name: self.carry(self.masks[x.name][0], 0, first) for x in self.things})

    def carry(self, mask: Array, start: int, stop: int) -> list[Carried]:
        """A mask carried by the flow from frame `start` to each frame up to `stop`."""
        step, out = (1 if stop > start else -1), [_certain(mask)]
        for t in range(start, stop, step):
            out.append(self._carry_on(out[-1], t, t + step))
        return out

    def _carry_on(self, before: Carried, t: int, after: int) -> Carried:
        import cv2

        back = self.flow_between(after, t)
        u, v = np.moveaxis(pixel_grid(*before.distance.shape) + back, -1, 0)
        soft = cv2.remap(before.distance, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        held = cv2.remap(before.held.astype(np.uint8), u, v, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE) > 0
        return Carried(soft, held & self._agrees(after, t))

    def _agrees(self, t: int, other: int) -> Bool[Array, "H W"]:
        """Where the flow from frame t to its neighbour and back agrees; kept while one keyframe is worked on."""
        if (t, other) not in self._agreed:
            misses = round_trip_error(self.flow_between(t, other), self.flow_between(other, t))
            self._agreed[t, other] = misses < self.settings.round_trip
        return self._agreed[t, other]

    def _enter(self, t: int, answers: Mapping[str, Answer]) -> dict[str, Answer]:
        """The answers as masks of frame t (in place), put right where that was done by hand; the answers with that."""
        for name, answer in answers.items():
            self.masks[name][t] = answer.mask
        certain = self.corrections.apply(t, {x.name: self.masks[x.name][t] for x in self.things})
        settle_overlaps([self.masks[x.name][t] for x in self.things])
        return {name: Answer(a.mask, True, 1.0, 1.0, 1.0) if name in certain else a for name, a in answers.items()}

    def _fill_between(self, start: int, stop: int, forth: Mapping[str, Sequence[Carried]]) -> None:
        """Masks of the frames between two keyframes (in place): carried from both, the nearer one counting more."""
        for x in self.things:
            back = self.carry(self.masks[x.name][stop], stop, start)[::-1]
            for t in range(start + 1, stop):
                late = (t - start) / (stop - start)
                mixed = (1 - late) * forth[x.name][t - start].distance + late * back[t - start].distance
                self.masks[x.name][t] = mixed > 0
        for t in range(start + 1, stop):
            settle_overlaps([self.masks[x.name][t] for x in self.things])

    def _told(self, thing: Thing, answer: Answer, t: int) -> dict[str, float]:
        own, mask = thing.seen(t), self.masks[thing.name][t]
        others = [standing_still(self.background, t, self.settings.still)]
        others += [x.seen(t) for x in self.things if x is not thing]
        inside = distance_to(mask) <= self.settings.beside if mask.any() else mask
        deep = signed_distance(mask) > self.settings.beside
        values = (
            float(answer.answered),
            answer.gain,
            answer.overlap,
            answer.growth,
            float(thing.tracks.visible[t].mean()) if thing.tracks.visible.size else 0.0,
            1 - _share_on(inside, own),
            _share_on(deep, np.concatenate(others)) * sum(map(len, others)) / max(len(own), 1),
            self.appearance.likeness(self.frames[t], thing.name, mask),
        )
        return dict(zip(NUMBERS, values, strict=True))


def _share_on(mask: Array, points: Array) -> float:
    """Share of points that lie on a mask; 1 without points, for then nothing is off it."""
    return float(count_votes(mask[None], points, np.ones(len(points), bool))[0] / len(points)) if len(points) else 1.0


def _certain(mask: Array) -> Carried:
    return Carried(signed_distance(mask), np.ones(mask.shape, bool))
