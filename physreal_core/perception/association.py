"""One mask per frame: candidates re-prompted by the tracks on keyframes, chosen by track votes (eq. mask_tracking),
carried by the flow in between."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import remembered
from physreal_core.perception.corrections import NONE, Corrections
from physreal_core.perception.flow import inside_image, pixel_grid, sample
from physreal_core.perception.mask_geometry import (
    distance_to,
    intersection_over_union,
    settle_overlaps,
    signed_distance,
    with_pixels_of,
)
from physreal_core.perception.prompting import Window, in_wide_enough_window, make_prompts, window_around
from physreal_core.perception.segmenter import Candidates, Segmenter, zoomed_candidates
from physreal_core.perception.settings import DEFAULTS, AssociationSettings
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
    settings: AssociationSettings = DEFAULTS.association,
) -> int | None:
    """Index of the candidate with the most votes (eq. mask_tracking), None without candidates or without a vote.

    The paper's candidates do not overlap; SAM 2's do, and the whole image would win every vote. So points that are
    known to lie on something else vote against, one against one. Candidates within `settings.tie` of the best count are
    equal; among them the likeness to the expected mask (IoU) and the network's own score decide.
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
        likeness = np.array([intersection_over_union(mask, expected) for mask in candidates.masks])
        quality = quality * (settings.unlike + likeness)
    equal = votes >= votes.max() - settings.tie * len(votes_for)
    return int(np.argmax(np.where(equal & (count_for > 0), quality, -1.0)))


@dataclass
class Thing:
    """Something followed through the video: its name, its mask in frame 0, and the tracks that vote for it."""

    name: str
    mask: Bool[Array, "H W"]
    tracks: Tracks

    def seen(self, t: int) -> Float[Array, "K 2"]:
        """Its tracks that are visible in frame t (u, v) [px]."""
        return _seen(self.tracks, t)


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
        settings: of the votes, of the prompts and of the windows.
        corrections: of frames that were put right by hand; each is a keyframe, and certain.
        tick: called after each keyframe.

    Returns:
        Masks by name, and by name the keyframes on which no candidate won, so that the carried mask stood.
    """
    film = _Film(frames, things, segmenter, flow_between, settings, corrections)
    keys = sorted({*range(0, len(frames), stride), len(frames) - 1, *corrections.keyframes})
    masks = {x.name: np.zeros((len(frames), *frames[0].shape[:2]), bool) for x in things}
    unanswered: dict[str, list[int]] = {x.name: [] for x in things}
    for x in things:
        masks[x.name][0] = x.mask
    for start, stop in pairwise(keys):
        span = slice(start + 1, stop + 1)
        found = remembered(
            "keyframe",
            lambda start=start, stop=stop: film.depends(masks, start, stop, _seen(background, stop)),
            {"masks": (len(things), stop - start, *frames[0].shape[:2]), "answered": (len(things),)},
            lambda start=start, stop=stop: film.follow(masks, start, stop, _seen(background, stop)),
            lasting=True,
        )
        for x, own, answered in zip(things, found["masks"], found["answered"], strict=True):
            masks[x.name][span] = own
            unanswered[x.name] += [] if answered else [stop]
        amended = corrections.amended(
            stop, {x.name: x.tracks for x in things}, {x.name: masks[x.name][stop] for x in things}
        )
        for x in things:
            x.tracks = amended[x.name]
        tick()
    _look_again(film, masks, background, keys[1 : 1 + settings.keyframes_back])
    return masks, unanswered


def _look_again(film: "_Film", masks: Mapping[str, Array], background: Tracks, keys: Sequence[int]) -> None:
    """Frame 0 answered once more (in place), now that the keyframes after it say what belongs together."""
    expected = {}
    for x in film.things:
        told = [film.carry(masks[x.name][k], k, 0)[-1] > 0 for k in keys]
        expected[x.name] = np.mean([x.mask, *told], axis=0) > film.settings.agreement
    # Points sampled as background may lie on parts of the object that frame 0's first mask missed.
    claimed = sample(np.any(list(expected.values()), axis=0).astype(np.float32), background.points[0]) > 0
    against = background.points[0][background.visible[0] & ~claimed]
    film.enter(masks, 0, expected, film.answers(0, expected, against))


@dataclass(frozen=True)
class _Film:
    """What masks are followed through, and by what. Masks and expected masks are by the things' names."""

    frames: Sequence[UInt8[Array, "H W 3"]]
    things: Sequence[Thing]
    segmenter: Segmenter
    flow_between: FlowBetween
    settings: AssociationSettings
    corrections: Corrections

    def depends(self, masks: Mapping[str, Array], start: int, stop: int, background: Array) -> list[Any]:
        """All that the masks after one keyframe up to the next follow from, beside the frames and the networks."""
        things = [part for x in self.things for part in (x.name, masks[x.name][start], x.seen(stop))]
        return [start, stop, self.settings, self.corrections.told(stop), background, *things]

    def follow(self, masks: Mapping[str, Array], start: int, stop: int, background: Array) -> dict[str, Array]:
        """The masks after one keyframe up to the next (also in place), and which things were answered on that."""
        forth = {x.name: self.carry(masks[x.name][start], start, stop) for x in self.things}
        expected = {name: carried[-1] > 0 for name, carried in forth.items()}
        answers = self.answers(stop, expected, background)
        certain = self.enter(masks, stop, expected, answers)
        self.fill_between(masks, start, stop, forth)
        return {
            "masks": np.stack([masks[x.name][start + 1 : stop + 1] for x in self.things]),
            "answered": np.array([x.name in certain or answers[x.name] is not None for x in self.things]),
        }

    def carry(self, mask: Array, start: int, stop: int) -> list[Float[Array, "H W"]]:
        """Signed distances of a mask carried by the flow from frame `start` to each frame up to `stop`."""
        import cv2

        step = 1 if stop > start else -1
        soft = [signed_distance(mask)]
        for t in range(start, stop, step):
            u, v = np.moveaxis(pixel_grid(*mask.shape) + self.flow_between(t + step, t), -1, 0)
            soft.append(cv2.remap(soft[-1], u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        return soft

    def answers(self, t: int, expected: Mapping[str, Array], background: Array) -> dict[str, Array | None]:
        """The voted candidate for every thing on a keyframe; None where it has too few tracks or no candidate a vote.

        Args:
            t: the keyframe.
            expected: where the things should be.
            background: points [K, 2] of frame t that lie on none of them [px].
        """
        return {x.name: self._answer(t, x, expected, background) for x in self.things}

    def enter(
        self, masks: Mapping[str, Array], t: int, expected: Mapping[str, Array], answers: Mapping[str, Array | None]
    ) -> set[str]:
        """The answers as masks of frame t (in place), where there is none, what was expected; which are corrected by hand."""
        for name, answer in answers.items():
            masks[name][t] = expected[name] if answer is None else answer
        certain = self.corrections.apply(t, {x.name: masks[x.name][t] for x in self.things})
        settle_overlaps([masks[x.name][t] for x in self.things])
        return certain

    def fill_between(
        self, masks: Mapping[str, Array], start: int, stop: int, forth: Mapping[str, Sequence[Array]]
    ) -> None:
        """Masks of the frames between two keyframes (in place): carried from both, the nearer one counting more."""
        for x in self.things:
            back = self.carry(masks[x.name][stop], stop, start)[::-1]
            for t in range(start + 1, stop):
                late = (t - start) / (stop - start)
                masks[x.name][t] = (1 - late) * forth[x.name][t - start] + late * back[t - start] > 0
        for t in range(start + 1, stop):
            settle_overlaps([masks[x.name][t] for x in self.things])

    def _answer(self, t: int, thing: Thing, expected: Mapping[str, Array], background: Array) -> Array | None:
        settings, voters = self.settings, thing.seen(t)
        if len(voters) < settings.least_voters:
            return None
        mine = expected[thing.name] & _near(voters, expected[thing.name].shape, settings)
        others = [x for x in self.things if x is not thing]
        prompts = make_prompts(mine, [expected[x.name] for x in others], voters, settings.prompts)
        against = np.concatenate([background, *(x.seen(t) for x in others)])
        carried = Candidates(mine[None], np.array([settings.carried_score], np.float32), np.array([-1]))

        def choose(window: Window) -> Array | None:
            proposed = zoomed_candidates(self.segmenter, self.frames[t], prompts, window)
            candidates = Candidates.join([proposed, carried])
            best = choose_by_votes(candidates, voters, against, expected=mine, settings=settings)
            return None if best is None else candidates.masks[best]

        # One window for all things, so that the image is encoded once.
        everything = with_pixels_of(
            np.any(list(expected.values()), axis=0), np.concatenate([x.seen(t) for x in self.things])
        )
        return in_wide_enough_window(choose, window_around(everything, settings.window), settings.window)


def _seen(tracks: Tracks, t: int) -> Float[Array, "K 2"]:
    return tracks.points[t][tracks.visible[t]]


def _near(points: Float[Array, "K 2"], shape: tuple[int, int], settings: AssociationSettings) -> Bool[Array, "H W"]:
    """Pixels not far from visible tracks: what the flow left behind on the table has none."""
    from scipy.spatial import cKDTree

    neighbours = min(settings.spacing_neighbours, len(points))
    spacing = np.median(cKDTree(points).query(points, k=neighbours)[0][:, -1])
    away = distance_to(with_pixels_of(np.zeros(shape, bool), points))
    return away < max(settings.near, settings.near_spacings * spacing)
