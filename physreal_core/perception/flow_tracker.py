"""Tracks of a soft surface by chained flow, held to the surface by its neighbourhood and to itself by patches.

From frame t-1 to t a point goes along the flow and back; where it misses itself it is lost. A point that departs from
the affine map of its neighbours far more than they do themselves has slipped onto something else, and is lost, too
(`neighbourhood`). What drift there is, the registration with the point's patch takes out (`templates`): the patch is of
the frame where the point was last well seen from this side, so a turn or a shade makes a new patch and not a lost point.
A lost point rides with its neighbours and is looked for where they carry it (`finding`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import Checkpoints, checkpoints
from physreal_core.perception.finding import search
from physreal_core.perception.flow import DisFlow, Flow, inside_image, round_trip_error, sample
from physreal_core.perception.neighbourhood import LocalMap, local_map, nearest_others
from physreal_core.perception.onnx_tracker import inside_masks
from physreal_core.perception.settings import TrackerSettings
from physreal_core.perception.templates import Templates
from physreal_core.perception.tracker import Tracks


@dataclass
class FlowTracker:
    """Point tracker from a dense flow.

    Attributes:
        flow: flow from frame to frame.
        settings: the numbers.
        kept: checkpoints of the flows, which serve all that is done with one video.
        anchored: whether points are held to patches and looked for when lost; what stands still needs neither.
    """

    flow: Flow = field(default_factory=DisFlow)
    settings: TrackerSettings = field(default_factory=TrackerSettings)
    anchored: bool = True
    kept: Checkpoints = field(default_factory=checkpoints, repr=False)
    _flows: dict[tuple[int, int], Array] = field(default_factory=dict, repr=False)

    def track(
        self,
        frames: Sequence[UInt8[Array, "H W 3"]],
        queries: Float[Array, "J 2"],
        occluders: Bool[Array, "T H W"] | None = None,
    ) -> Tracks:
        """Follow `queries` (u, v) [px] of frame 0; see `Tracker`."""
        queries = np.asarray(queries, np.float32).reshape(-1, 2)
        if len(queries) == 0:
            return Tracks(np.zeros((len(frames), 0, 2), np.float32), np.zeros((len(frames), 0), bool))
        kept = checkpoints()
        name = kept.unique("track", [queries, occluders, self.anchored])
        state = _Following(self, frames, queries, occluders)
        state.resume(kept.get(name, state.shapes()))
        for t in range(state.done, len(frames)):
            state.step(t)
            if kept.due(name) or t == len(frames) - 1:
                kept.put(name, state.arrays())
        return Tracks(state.points, state.visible)

    def flow_between(self, frames: Sequence[Array], source: int, target: int) -> Float[Array, "H W 2"]:
        """Flow between neighbouring frames [px], kept for the next who asks."""
        if (source, target) not in self._flows:
            name, shape = f"flow {source} {target}", (*frames[source].shape[:2], 2)
            if (known := self.kept.get(name, {"flow": shape})) is None:
                known = {"flow": self.flow(frames[source], frames[target])}
                self.kept.put(name, known)
            self._flows[source, target] = known["flow"]
        return self._flows[source, target]


class _Following:
    """The points of one call on their way through the frames."""

    def __init__(self, tracker: FlowTracker, frames: Sequence[Array], queries: Array, occluders: Array | None) -> None:
        self.tracker, self.frames, self.occluders, self.set = tracker, frames, occluders, tracker.settings
        count = len(queries)
        self.done = 1
        self.points = np.zeros((len(frames), count, 2), np.float32)
        self.visible = np.zeros((len(frames), count), bool)
        self.points[0], self.visible[0] = queries, inside_image(queries, *frames[0].shape[:2])
        self.last_seen = np.zeros(count, int)  # frame in which each point was seen last
        self.patch_of = np.zeros(count, int)  # frame that each point's patch is of
        self.corrected = np.zeros(count, int)  # frame in which it was corrected last
        self.near = nearest_others(queries, self.set.neighbours)
        self.templates = Templates(count, self.set.patch, self.set.grey_noise)
        self.templates.take(_grey(frames[0]), queries, np.arange(count))

    def shapes(self) -> dict[str, tuple[int | None, ...]]:
        """Of `arrays`."""
        count = self.visible.shape[1]
        counts = {name: (count,) for name in ("last_seen", "patch_of", "corrected")}
        return {"points": (None, count, 2), "visible": (None, count), **counts}

    def arrays(self) -> dict[str, Array]:
        """All that the frames to come depend on: the patches follow from these."""
        done = self.done
        own = {name: getattr(self, name) for name in ("last_seen", "patch_of", "corrected")}
        return {"points": self.points[:done], "visible": self.visible[:done], **own}

    def resume(self, known: dict[str, Array] | None) -> None:
        """Go on from `arrays` of an earlier run."""
        if known is None:
            return
        self.done = len(known["points"])
        self.points[: self.done], self.visible[: self.done] = known["points"], known["visible"]
        for name in ("last_seen", "patch_of", "corrected"):
            setattr(self, name, known[name].copy())
        for t in np.unique(self.patch_of[self.patch_of > 0]):
            which = np.flatnonzero(self.patch_of == t)
            self.templates.take(_grey(self.frames[t]), self.points[t, which], which)

    def step(self, t: int) -> None:
        """From frame t - 1 to t."""
        before, held = self.points[t - 1], self.visible[t - 1]
        forward = self.tracker.flow_between(self.frames, t - 1, t)
        backward = self.tracker.flow_between(self.frames, t, t - 1)
        step, miss = sample(forward, before), sample(round_trip_error(forward, backward), before)
        allowed = self.set.max_round_trip + self.set.round_trip_share * np.linalg.norm(step, axis=1)
        self.points[t] = before + step
        held = held & (miss < allowed) & self._free(self.points[t], t)
        self._judge(t, held)
        if self.tracker.anchored:
            self._correct(t)
            self._find(t)
        self.last_seen[self.visible[t]] = t
        self.done = t + 1

    def _free(self, points: Array, t: int) -> Bool[Array, " N"]:
        """Whether points lie on the image and on nothing that hides them."""
        free = inside_image(points, *self.frames[t].shape[:2])
        if self.occluders is None:
            return free
        return free & ~inside_masks(points[None], self.occluders[t][None])[0]

    def _map(self, t: int, since: Array, held: Array, which: Array) -> LocalMap:
        """What the neighbourhood of points says of their way from the frames `since` [N] to t."""
        near = self.near[which]
        source = self.points[since[:, None], near]
        usable = held[near] & self.visible[since[:, None], near]
        return local_map(
            self.points[since, which], source, self.points[t, near], usable, floor=self.set.spread_floor
        )

    def _judge(self, t: int, held: Array) -> None:
        """Points that depart from their neighbours are lost; lost points ride with theirs."""
        everyone = np.arange(len(held))
        found = self._map(t, np.zeros(len(held), int), held, everyone)
        departure = np.linalg.norm(self.points[t] - found.points, axis=1) / found.spread
        told = found.support >= self.set.least_neighbours
        held = held & ~(told & (departure > self.set.max_departure))
        lost = np.flatnonzero(~held)
        carried = self._map(t, self.last_seen[lost], held, lost)
        rides = carried.support >= self.set.least_neighbours
        self.points[t, lost[rides]] = carried.points[rides]
        self.visible[t] = held

    def _correct(self, t: int) -> None:
        """Take out the drift of the points in sight against their patches, and renew the patches of what has turned."""
        which = np.flatnonzero(self.visible[t])
        if len(which) == 0:
            return
        grey, here = _grey(self.frames[t]), self.points[t, which]
        linear = self._map(t, self.patch_of[which], self.visible[t], which).linear
        before, after = self.templates.register(grey, here, linear, which)
        small = np.linalg.norm(after.points - here, axis=1) < self.set.max_correction
        good = small & (after.likeness > self.set.min_likeness) & self._free(after.points, t)
        self.points[t, which[good]] = after.points[good]
        self.corrected[which[good]] = t
        turned = good & (after.likeness < self.set.renewed_below)
        unlike = ~good & (t - self.corrected[which] >= self.set.renewed_after)
        renewed = which[turned | unlike]
        self.templates.take(grey, self.points[t, renewed], renewed)
        self.patch_of[renewed] = t
        self.corrected[renewed] = t

    def _find(self, t: int) -> None:
        """Look for lost points by their patches."""
        lost = ~self.visible[t] & (self.templates.contrast > self.set.min_contrast) & self._free(self.points[t], t)
        if t % self.set.search_every or not lost.any():
            return
        which = np.flatnonzero(lost)
        which = np.roll(which, -(t * self.set.search_limit) % len(which))[: self.set.search_limit]
        grey = _grey(self.frames[t])
        found = self._map(t, self.patch_of[which], self.visible[t], which)
        known = found.support >= self.set.least_neighbours
        which, linear = which[known], found.linear[known]
        place, _, second = search(
            self.templates, grey, self.points[t, which], linear, which, reach=self.set.search_reach
        )
        if len(which) == 0:
            return
        _, after = self.templates.register(grey, place, linear, which)
        good = (after.likeness > self.set.min_likeness) & (after.likeness > second + self.set.min_distinct)
        good &= self._free(after.points, t)
        self.points[t, which[good]] = after.points[good]
        self.visible[t, which[good]] = True


def _grey(frame: UInt8[Array, "H W 3"]) -> Float[Array, "H W"]:
    """Brightness [grey levels]."""
    import cv2

    return cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY).astype(np.float32)
