"""Tracks by chained flow, with drift taken out against frame 0 and occlusion told from the checks.

From frame t-1 to t a point goes along the flow and back; if it misses itself it is lost there. Then frame t is warped
into frame 0 by a smooth map through the tracks that hold (moving affine least squares), and the small flow left
between frame 0 and that warped frame corrects every point against frame 0 itself, so errors do not add up and a point
that comes out of an occlusion is found again. The accepted correction needs the round trip and the likeness
(normalised cross-correlation of the patches) with frame 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from physreal_core.array_types import Array, Bool, Float, UInt8
from physreal_core.checkpoints import Checkpoints, checkpoints
from physreal_core.perception.flow import DisFlow, Flow, inside_image, pixel_grid, round_trip_error, sample
from physreal_core.perception.onnx_tracker import inside_masks
from physreal_core.perception.tracker import Tracks


@dataclass
class FlowTracker:
    """Point tracker from a dense flow.

    Attributes:
        flow: flow from frame to frame.
        anchor_flow: small flow against frame 0.
        max_round_trip: a point is lost where forward and backward flow disagree by more [px].
        max_anchor_round_trip: same for the correction against frame 0 [px].
        min_likeness: least patch correlation with frame 0 for a correction, and for a lost point to be seen again.
        min_recognised: below this correlation a patch with texture shows something else: the point is lost.
        patch: half size of that patch [px].
        neighbours: tracks that carry the smooth map at a point.
        kept: checkpoints of the flows, which serve all that is done with one video.
        anchored: whether points are corrected against frame 0; half the cost without.
        max_stray: a point this far [px] from where its neighbours carry it has slipped onto something else.
    """

    flow: Flow = field(default_factory=DisFlow)
    anchor_flow: Flow = field(default_factory=DisFlow)
    max_round_trip: float = 1.0
    max_anchor_round_trip: float = 0.7
    min_likeness: float = 0.75
    min_recognised: float = 0.3
    patch: int = 4
    neighbours: int = 24
    max_stray: float = 2.0
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
        height, width = frames[0].shape[:2]
        queries = np.asarray(queries, np.float32).reshape(-1, 2)
        points, visible = [queries.copy()], [inside_image(queries, height, width)]
        if len(queries) == 0:
            return Tracks(np.zeros((len(frames), 0, 2), np.float32), np.zeros((len(frames), 0), bool))
        anchor = _Anchor(frames[0], queries, self) if self.anchored else None
        kept = checkpoints()
        name = kept.unique("track", [queries, occluders, self.anchored])
        shapes = {"points": (None, len(queries), 2), "visible": (None, len(queries)), "last": (len(queries), 2)}
        if (known := kept.get(name, shapes)) is not None:
            points, visible = [*known["points"][:-1], known["last"]], [*known["visible"]]
        for t in range(len(points), len(frames)):
            step, error = self._step(frames, t)
            moved = points[-1] + sample(step, points[-1])
            blocked = (
                np.zeros(len(queries), bool) if occluders is None else inside_masks(moved[None], occluders[t][None])[0]
            )
            held = visible[-1] & (sample(error, points[-1]) < self.max_round_trip) & inside_image(moved, height, width)
            held &= ~blocked
            now, seen = moved, held
            if anchor is not None:
                now, seen = anchor.correct(frames[t], moved, held, None if occluders is None else occluders[t])
            points.append(now)
            visible.append(seen)
            if kept.due(name) or t == len(frames) - 1:
                state = {"points": np.stack(points).astype(np.float32), "visible": np.stack(visible), "last": now}
                kept.put(name, state)
        return Tracks(np.stack(points).astype(np.float32), np.stack(visible))

    def flow_between(self, frames: Sequence[Array], source: int, target: int) -> Float[Array, "H W 2"]:
        """Flow between neighbouring frames [px], kept for the next who asks."""
        if (source, target) not in self._flows:
            name, shape = f"flow {source} {target}", (*frames[source].shape[:2], 2)
            if (known := self.kept.get(name, {"flow": shape})) is None:
                known = {"flow": self.flow(frames[source], frames[target])}
                self.kept.put(name, known)
            self._flows[source, target] = known["flow"]
        return self._flows[source, target]

    def _step(self, frames: Sequence[Array], t: int) -> tuple[Array, Array]:
        forward, backward = self.flow_between(frames, t - 1, t), self.flow_between(frames, t, t - 1)
        return forward, round_trip_error(forward, backward)


class _Anchor:
    """Frame 0 and its queries: corrects points of a later frame against them."""

    def __init__(self, frame: Array, queries: Float[Array, "J 2"], settings: FlowTracker) -> None:
        from scipy.spatial import cKDTree

        self.settings, self.queries = settings, queries
        margin = 24
        low = np.maximum(np.floor(queries.min(0)).astype(int) - margin, 0)
        high = np.minimum(np.ceil(queries.max(0)).astype(int) + margin, np.array(frame.shape[1::-1]) - 1)
        self.low, self.size = low, tuple(int(n) for n in (high - low + 1)[::-1])
        self.image = np.ascontiguousarray(frame[low[1] : high[1] + 1, low[0] : high[0] + 1])
        self.stride = 4  # the map is smooth: made on a coarse grid and interpolated
        rows, columns = (-(-n // self.stride) + 1 for n in self.size)
        self.nodes = pixel_grid(rows, columns) * self.stride + low
        self.spread = max(float(np.median(cKDTree(queries).query(queries, k=min(5, len(queries)))[0][:, -1])), 1.0)
        self.patches = _patches(frame, queries, settings.patch)
        self.textured = self.patches.std(axis=1).mean(axis=1) > 5.0  # grey levels

    def correct(
        self, frame: Array, moved: Float[Array, "J 2"], held: Bool[Array, " J"], occluder: Array | None
    ) -> tuple[Float[Array, "J 2"], Bool[Array, " J"]]:
        s = self.settings
        if held.sum() < 4:
            return moved, held
        for _ in range(2):  # strays pull at their neighbours, so the test is repeated without them
            carried = self._carry(moved, held, self.queries)
            held = held & (np.linalg.norm(moved - carried, axis=1) < s.max_stray)
            if held.sum() < 4:
                return moved, held
        # A lost point rides with its neighbours, so that it can be recognised where it should be.
        guess = np.where(held[:, None], moved, self._carry(moved, held, self.queries))
        warped, where = self._warp(frame, guess, held)
        residual = s.anchor_flow(self.image, warped)
        back = s.anchor_flow(warped, self.image)
        local = self.queries - self.low
        correction = sample(residual, local)
        trip = sample(round_trip_error(residual, back), local)
        corrected = sample(where, local + correction)
        seen_before, seen_after = (
            _likeness(self.patches, _warped_patches(frame, where, local + c, s.patch))
            for c in (0 * correction, correction)
        )
        inside = inside_image(corrected, *frame.shape[:2])
        free = inside if occluder is None else inside & ~inside_masks(corrected[None], occluder[None])[0]
        good = (
            free & (trip < s.max_anchor_round_trip) & (seen_after > s.min_likeness) & (seen_after > seen_before - 0.05)
        )
        good &= np.linalg.norm(correction, axis=1) < 6
        found_again = good & ~held & (seen_after > s.min_likeness)
        # Something else altogether is to be seen there; a flat patch cannot tell.
        replaced = ~good & self.textured & (np.maximum(seen_before, seen_after) < s.min_recognised)
        return np.where(good[:, None], corrected, guess), (held & ~replaced) | found_again

    def _carry(self, moved: Array, held: Array, points: Float[Array, "... 2"]) -> Float[Array, "... 2"]:
        """Moving least squares: points of frame 0 under the affine map of the nearest held tracks around each."""
        from scipy.spatial import cKDTree

        source, target = self.queries[held], moved[held]
        count = min(self.settings.neighbours, len(source))
        flat = points.reshape(-1, 2)
        distance, index = cKDTree(source).query(flat, k=count)
        distance, index = distance.reshape(len(flat), -1), index.reshape(len(flat), -1)
        weight = np.exp(-0.5 * (distance / np.maximum(distance[:, -1:] * 0.5, self.spread)) ** 2) + 1e-6
        a, b = source[index] - flat[:, None], target[index] - source[index]
        ones = np.concatenate([np.ones((*a.shape[:2], 1)), a / self.spread], -1)  # [n, k, 3]
        normal = np.einsum("nki,nk,nkj->nij", ones, weight, ones)
        normal += np.diag([1e-9, 0.05, 0.05]) * weight.sum(1)[:, None, None]  # shrinks towards translation
        coefficients = np.linalg.solve(normal, np.einsum("nki,nk,nkc->nic", ones, weight, b))
        return (flat + coefficients[:, 0]).reshape(points.shape).astype(np.float32)

    def _warp(self, frame: Array, guess: Array, held: Array) -> tuple[Array, Array]:
        """Frame t seen in frame 0's crop, and where each pixel of the crop lies in frame t [px]."""
        import cv2

        nodes = self._carry(guess, held, self.nodes)
        rows, columns = self.size
        local = pixel_grid(rows, columns) / self.stride
        where = cv2.remap(nodes, local[..., 0], local[..., 1], cv2.INTER_LINEAR)
        return cv2.remap(frame, where[..., 0], where[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), where


def _patches(image: Array, points: Float[Array, "J 2"], half: int) -> Float[Array, "J P 3"]:
    offsets = (pixel_grid(2 * half + 1, 2 * half + 1) - half).reshape(-1, 2)
    return sample(image.astype(np.float32), points[:, None] + offsets)


def _warped_patches(frame: Array, where: Array, points: Array, half: int) -> Float[Array, "J P 3"]:
    """Patches of the frame under the map `where`, so that turning and stretching do not spoil the likeness."""
    offsets = (pixel_grid(2 * half + 1, 2 * half + 1) - half).reshape(-1, 2)
    return sample(frame.astype(np.float32), sample(where, points[:, None] + offsets))


def _likeness(first: Float[Array, "J P 3"], second: Float[Array, "J P 3"]) -> Float[Array, " J"]:
    """Normalised cross-correlation of patches; flat patches (contrast under 2 grey levels) count as unlike."""
    a, b = (p - p.mean(1, keepdims=True) for p in (first, second))
    scale = np.sqrt((a**2).sum((1, 2)) * (b**2).sum((1, 2)))
    return (a * b).sum((1, 2)) / np.maximum(scale, 4.0 * a[0].size)
