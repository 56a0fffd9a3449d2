"""The points of one call of the flow tracker on their way from frame to frame."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from physreal_core.array_types import Array, Bool, Float, Int, UInt8
from physreal_core.perception.confidence import REFERENCE_DIAGONAL, Evidence, confidence
from physreal_core.perception.finding import search
from physreal_core.perception.flow import inside_image, sample
from physreal_core.perception.neighbourhood import LocalMap, local_map, nearest_among, nearest_others
from physreal_core.perception.onnx_tracker import inside_masks
from physreal_core.perception.settings import TrackerSettings
from physreal_core.perception.templates import Templates, colours

_PER_FRAME = ("points", "seen", "confidence")
_PER_POINT = ("last_seen", "patch_of", "corrected", "likeness")


class Following:
    """Where the points are so far, and what else the next frame depends on.

    Args:
        frames: T images.
        queries: J points of frame 0 [px].
        occluders: [T, H, W], pixels known to show something else; None where nothing is known.
        flow_between: flow between two neighbouring frames.
        settings: the numbers.
        anchored: whether points are held to patches, and looked for when lost.
    """

    def __init__(
        self,
        frames: Sequence[UInt8[Array, "H W 3"]],
        queries: Float[Array, "J 2"],
        occluders: Bool[Array, "T H W"] | None,
        flow_between: Callable[[int, int], Array],
        settings: TrackerSettings,
        anchored: bool,
    ) -> None:
        self.frames, self.occluders, self.flow_between = frames, occluders, flow_between
        self.settings, self.anchored = settings, anchored
        count = len(queries)
        self.done = 1
        self.points = np.zeros((len(frames), count, 2), np.float32)
        self.seen = np.zeros((len(frames), count), bool)
        self.confidence = np.ones((len(frames), count), np.float32)
        self.points[0], self.seen[0] = queries, inside_image(queries, *frames[0].shape[:2])
        self.last_seen = np.zeros(count, int)  # frame in which each point was seen last
        self.patch_of = np.zeros(count, int)  # frame that each point's patch is of
        self.corrected = np.zeros(count, int)  # frame in which it was corrected last
        self.likeness = np.ones(count, np.float32)  # with its patch, when last compared
        self.unit = float(np.hypot(*frames[0].shape[:2])) / REFERENCE_DIAGONAL  # [px]
        self.near = nearest_others(queries, settings.neighbours)
        nearest = np.linalg.norm(queries[self.near[:, :1]] - queries[:, None], axis=-1)
        self.spacing = max(float(np.median(nearest)), 1.0) if nearest.size else 1.0  # [px]
        self.templates = Templates(count, settings.patch, settings.grey_noise)
        if anchored:
            self.templates.take(_grey(frames[0]), queries, np.arange(count))
            self.colours = colours(frames[0], queries, settings.patch)

    def shapes(self) -> dict[str, tuple[int | None, ...]]:
        """Of `arrays`."""
        count = self.seen.shape[1]
        return {"points": (None, count, 2), "seen": (None, count), "confidence": (None, count)} | {
            name: (count,) for name in _PER_POINT
        }

    def arrays(self) -> dict[str, Array]:
        """All that the frames to come depend on: the patches follow from these."""
        own = {name: getattr(self, name) for name in _PER_POINT}
        return {name: getattr(self, name)[: self.done] for name in _PER_FRAME} | own

    def resume(self, known: Mapping[str, Array] | None) -> None:
        """Go on from `arrays` of an earlier run."""
        if known is None:
            return
        self.done = len(known["points"])
        for name in _PER_FRAME:
            getattr(self, name)[: self.done] = known[name]
        for name in _PER_POINT:
            setattr(self, name, known[name].copy())
        if self.anchored:
            for t in np.unique(self.patch_of[self.patch_of > 0]):
                which = np.flatnonzero(self.patch_of == t)
                self.templates.take(_grey(self.frames[t]), self.points[t, which], which)

    def step(self) -> None:
        """Go on by one frame."""
        t = self.done
        self.points[t], held = self._flown(t)
        self.seen[t] = self._with_neighbours(t, held)
        self._ride(t)
        if self.anchored:
            self._correct(t)
            self._find(t)
        self.last_seen[self.seen[t]] = t
        if self.anchored:
            self.confidence[t] = np.where(self.seen[t], confidence(self.evidence(t).terms()), 0.0)
        else:
            self.confidence[t] = self.seen[t]
        self.done = t + 1

    def evidence(self, t: int) -> Evidence:
        """What is known of the points in frame t, which is the last that was done."""
        unit, told = self.unit, self.carried.support >= self.settings.least_neighbours
        departure = np.linalg.norm(self.points[t] - self.carried.points, axis=1)
        return Evidence(
            miss=self.miss / unit,
            departure=np.where(told, departure, 0.0) / unit,
            spread=self.carried.spread / unit,
            stretch=np.where(told, _stretch(self.carried), 1.0),
            likeness=self.likeness,
            uncorrected=t - self.corrected,
        )

    def _flown(self, t: int) -> tuple[Float[Array, "J 2"], Bool[Array, " J"]]:
        """Where the flow takes the points, and which of them it holds."""
        s, before = self.settings, self.points[t - 1]
        forward, backward = self.flow_between(t - 1, t), self.flow_between(t, t - 1)
        step = sample(forward, before)
        now = before + step
        self.miss = np.linalg.norm(step + sample(backward, now), axis=1)
        held = self.seen[t - 1] & self._free(now, t)
        held &= self.miss < s.max_round_trip + s.round_trip_share * np.linalg.norm(step, axis=1)
        tints = [colours(self.frames[i], at, s.step_patch) for i, at in ((t - 1, before), (t, now))]
        return now, held & (np.abs(tints[1] - tints[0]).max(1) < s.max_step_colour)

    def _with_neighbours(self, t: int, held: Bool[Array, " J"]) -> Bool[Array, " J"]:
        """Which points go with their neighbours; the others have slipped, or their surface has turned away."""
        s, everyone, start = self.settings, np.arange(len(held)), np.zeros(len(held), int)
        self.carried = self._map(t, start, held, everyone, self.near)
        departure = np.linalg.norm(self.points[t] - self.carried.points, axis=1) / self.carried.spread
        told = self.carried.support >= s.least_neighbours
        return held & ~(told & ((departure > s.max_departure) | (_stretch(self.carried) < s.min_stretch)))

    def _ride(self, t: int) -> None:
        """Lost points go with the nearest points in sight; where there are none, they stay."""
        held = self.seen[t]
        lost = np.flatnonzero(~held)
        near = nearest_among(self.points[0], lost, np.flatnonzero(held), self.settings.neighbours)
        self.points[t, lost] = self._map(t, self.last_seen[lost], held, lost, near).points

    def _correct(self, t: int) -> None:
        """Take out the drift of the points in sight against their patches, and renew the patches of what has turned."""
        s, which = self.settings, np.flatnonzero(self.seen[t])
        grey, here = _grey(self.frames[t]), self.points[t, which]
        linear = self._map(t, self.patch_of[which], self.seen[t], which, self.near[which]).linear
        after, likeness = self.templates.register(grey, here, linear, which)
        self.likeness[which] = likeness
        good = (np.linalg.norm(after - here, axis=1) < s.max_correction) & (likeness > s.min_likeness)
        good &= self._free(after, t) & ~self._strains(here, after, which)
        self.points[t, which[good]] = after[good]
        self.corrected[which[good]] = t
        turned = good & (likeness < s.renewed_below)
        unlike = ~good & (t - self.corrected[which] >= s.renewed_after)
        renewed = which[turned | unlike]
        self.templates.take(grey, self.points[t, renewed], renewed)
        self.patch_of[renewed] = self.corrected[renewed] = t

    def _strains(self, here: Array, moved: Array, which: Int[Array, " N"]) -> Bool[Array, " N"]:
        """Whether a correction takes points away from where their neighbours carry them."""
        carried, spread = self.carried.points[which], self.carried.spread[which]
        was, now = (np.linalg.norm(points - carried, axis=1) for points in (here, moved))
        told = self.carried.support[which] >= self.settings.least_neighbours
        return told & (now > np.maximum(was, self.settings.max_strain * spread))

    def _find(self, t: int) -> None:
        """Look for lost points by their patches, those next to points in sight first."""
        s, held = self.settings, self.seen[t]
        lost = ~held & (self.templates.contrast > s.min_contrast) & self._free(self.points[t], t)
        if t % s.search_every or not lost.any():
            return
        which, sight = np.flatnonzero(lost), np.flatnonzero(held)
        start = self.points[0]
        near = nearest_among(start, which, sight, s.neighbours)
        gap = np.linalg.norm(start[near[:, :1]] - start[which, None], axis=-1).sum(1) / self.spacing
        keep = np.argsort(gap, kind="stable")[: s.search_limit]
        which, near, gap = which[keep], near[keep], gap[keep]
        whole = self._map(t, np.zeros(len(which), int), held, which, near)
        allowed = s.found_departure * whole.spread * np.maximum(gap, 1.0)
        linear = self._map(t, self.patch_of[which], held, which, near).linear
        grey, here = _grey(self.frames[t]), self.points[t, which]
        place, second = search(self.templates, grey, here, linear, which, reach=s.search_reach)
        after, likeness = self.templates.register(grey, place, linear, which)
        change = np.abs(colours(self.frames[t], after, s.patch) - self.colours[which]).max(1)
        good = (likeness > np.maximum(s.found_likeness, second + s.min_distinct)) & (change < s.max_colour_change)
        good &= self._free(after, t) & (_stretch(whole) > s.found_stretch)
        good &= np.linalg.norm(after - here, axis=1) < allowed
        self.points[t, which[good]] = after[good]
        self.seen[t, which[good]] = True
        self.likeness[which[good]] = likeness[good]

    def _free(self, points: Float[Array, "N 2"], t: int) -> Bool[Array, " N"]:
        """Whether points lie on the image and on nothing that hides them."""
        free = inside_image(points, *self.frames[t].shape[:2])
        if self.occluders is None:
            return free
        return free & ~inside_masks(points[None], self.occluders[t][None])[0]

    def _map(
        self, t: int, since: Int[Array, " N"], held: Bool[Array, " J"], which: Int[Array, " N"], near: Int[Array, "N K"]
    ) -> LocalMap:
        """What neighbours say of the way of the points `which` from the frames `since` to t."""
        source = self.points[since[:, None], near]
        usable = held[near] & self.seen[since[:, None], near]
        floor = self.settings.spread_floor
        return local_map(self.points[since, which], source, self.points[t, near], usable, floor=floor)


def _stretch(found: LocalMap) -> Float[Array, " N"]:
    """How much of its width a neighbourhood keeps in the direction in which it shrinks most."""
    return np.linalg.svd(found.linear, compute_uv=False)[:, 1]


def _grey(frame: UInt8[Array, "H W 3"]) -> Float[Array, "H W"]:
    """Brightness [grey levels]."""
    import cv2

    return cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
