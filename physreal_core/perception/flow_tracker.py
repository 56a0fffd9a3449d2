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
from physreal_core.perception.flow import DisFlow, Flow
from physreal_core.perception.following import Following
from physreal_core.perception.settings import TrackerSettings
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
        return self._along(range(len(frames)), frames, queries, occluders)

    def track_from(
        self,
        start: int,
        frames: Sequence[UInt8[Array, "H W 3"]],
        queries: Float[Array, "J 2"],
        occluders: Bool[Array, "T H W"] | None = None,
    ) -> Tracks:
        """Follow `queries` (u, v) [px] of the frame `start` forwards to the last frame, and backwards to frame 0."""
        later = self._along(range(start, len(frames)), frames, queries, occluders)
        earlier = self._along(range(start, -1, -1), frames, queries, occluders)
        points, visible, confidence = (
            np.concatenate([before[:0:-1], after])
            for before, after in (
                (earlier.points, later.points),
                (earlier.visible, later.visible),
                (earlier.confidence, later.confidence),
            )
        )
        return Tracks(points, visible, confidence, np.full(points.shape[1], start, np.int32))

    def _along(
        self, order: range, frames: Sequence[Array], queries: Float[Array, "J 2"], occluders: Array | None
    ) -> Tracks:
        """Follow `queries` of the first frame of an order, through the frames in this order."""
        queries = np.asarray(queries, np.float32).reshape(-1, 2)
        if len(queries) == 0:
            return Tracks(np.zeros((len(order), 0, 2), np.float32), np.zeros((len(order), 0), bool))
        kept = checkpoints()
        name = kept.unique("track", [queries, occluders, self.anchored, order])
        state = Following(
            [frames[t] for t in order],
            queries,
            None if occluders is None else occluders[list(order)],
            lambda a, b: self.flow_between(frames, order[a], order[b]),
            self.settings,
            self.anchored,
        )
        state.resume(kept.get(name, state.shapes()))
        while state.done < len(order):
            state.step()
            if kept.due(name) or state.done == len(order):
                kept.put(name, state.arrays())
        sure = state.confidence >= self.settings.min_confidence
        return Tracks(state.points, state.seen & sure, state.confidence)

    def flow_between(self, frames: Sequence[Array], source: int, target: int) -> Float[Array, "H W 2"]:
        """Flow between neighbouring frames [px], kept for the next who asks."""
        if (source, target) not in self._flows:
            name, shape = f"flow {source} {target}", (*frames[source].shape[:2], 2)
            if (known := self.kept.get(name, {"flow": shape})) is None:
                known = {"flow": self.flow(frames[source], frames[target])}
                self.kept.put(name, known)
            self._flows[source, target] = known["flow"]
        return self._flows[source, target]
