"""One sequence through the first stage as a user runs it, and through the baseline: what came out, scored."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks import perception_baseline as baseline
from benchmarks import perception_scoring as scoring
from benchmarks.judged import Judged, TruePoints
from physreal_core.array_types import Array, Bool, Float
from physreal_core.errors import InputError
from physreal_core.perception.flow import Flow
from physreal_core.perception.perceive import Networks, perceive
from physreal_core.perception.segmenter import Segmenter
from physreal_core.perception.tracker import Tracks
from pipeline.config.segment_and_track import SegmentAndTrack
from stages._networks import make_networks, make_settings

STAGE, BASELINE = "stage", "baseline"
TruthOf = Callable[[Judged, Float[Array, "J 2"]], TruePoints]


@dataclass
class KeptFlow:
    """A flow that remembers its answers by the images themselves: the way back needs the same ones.

    Attributes:
        flow: what is asked.
    """

    flow: Flow
    _known: dict[tuple[int, int], tuple] = field(default_factory=dict)

    def __call__(self, first: Array, second: Array) -> Array:
        """Displacement (du, dv) [px] of each pixel of `first`."""
        key = id(first), id(second)
        if key not in self._known:
            self._known[key] = self.flow(first, second), first, second  # the images stay, so their ids do
        return self._known[key][0]


def run_stage(judged: Judged, truth_of: TruthOf | None) -> tuple[dict[str, Any], dict[str, Any]]:
    """The first stage by its default settings.

    Returns:
        its row, and what the baseline starts from: frame 0's mask, the points, the segmenter. Empty where it stopped.
    """
    params, video = SegmentAndTrack(), judged.video
    networks = make_networks(params, video, judged.folder)
    networks = replace(networks, flow=replace(networks.flow, flow=KeptFlow(networks.flow.flow)))
    start = time.perf_counter()
    try:
        parsed = perceive(video, networks, make_settings(params))
    except InputError as error:
        return _stopped(judged, str(error), time.perf_counter() - start), {}
    seconds = time.perf_counter() - start
    row = _scored(
        judged, STAGE, parsed.object_masks, parsed.tracks, seconds, truth_of, lambda p: _back(networks, judged, p)
    )
    row["warnings"] = [doubt.sentence for doubt in parsed.doubts]
    row["chosen_by"] = parsed.report.get("chosen_by", {})
    given = {"first": parsed.object_masks[0], "queries": _chosen_first(parsed.tracks).points[0]}
    return row, {**given, "segmenter": networks.segmenter}


def run_baseline(
    judged: Judged, first: Array, queries: Array, segmenter: Segmenter, truth_of: TruthOf | None
) -> dict[str, Any]:
    """The plain way from the stage's own frame 0."""
    start = time.perf_counter()
    masks, tracks = baseline.follow(judged.video, segmenter, first, queries)
    seconds = time.perf_counter() - start
    back = lambda points: baseline.track_back(judged.video, points)
    return _scored(judged, BASELINE, masks, tracks, seconds, truth_of, back)


def _back(networks: Networks, judged: Judged, points: Array) -> Array:
    """Where points of the last frame are in frame 0, by the stage's tracker run over the film backwards."""
    tracker = replace(networks.flow, _flows={})
    return tracker.track(judged.video.frames[::-1], points).points[-1]


def _chosen_first(tracks: Tracks) -> Tracks:
    """The points that were chosen in frame 0."""
    first = tracks.starts == 0 if hasattr(tracks, "starts") else np.ones(tracks.visible.shape[1], bool)
    if not hasattr(tracks, "confidence"):
        return Tracks(tracks.points[:, first], tracks.visible[:, first])
    return Tracks(tracks.points[:, first], tracks.visible[:, first], tracks.confidence[:, first], tracks.starts[first])


def _scored(
    judged: Judged,
    method: str,
    masks: Bool[Array, "T H W"],
    tracks: Tracks,
    seconds: float,
    truth_of: TruthOf | None,
    back: Callable[[Array], Array],
) -> dict[str, Any]:
    tracks = _chosen_first(tracks)
    claimed = tracks.visible
    row = _empty(judged, method, seconds)
    if judged.object_masks is not None:
        row["iou"] = scoring.overlaps(judged.object_masks, masks).round(4).tolist()
    if judged.hand_masks is not None:
        row["hand_in_object"] = scoring.share_of(masks, judged.hand_masks).round(4).tolist()
    if truth_of is None:
        there = scoring.inside(tracks.points[-1], (masks if judged.object_masks is None else judged.object_masks)[-1])
    else:
        true = truth_of(judged, tracks.points[0])
        there = true.visible[-1]
        known = claimed & true.known
        errors = scoring.track_errors(tracks.points, true.points, known, true.visible)
        row["track_error_px"] = float(errors.mean()) if len(errors) else None
        row["points_off_object"] = float((~true.known).mean())
        if hasattr(tracks, "confidence") and method == STAGE:
            counted = scoring.calibration(tracks.confidence, tracks.points, true.points, known)
            row["calibration"] = [part.tolist() for part in counted]
    on_object = truth_of is None or true.known.any()
    row["alive"] = scoring.alive(there, claimed[-1]) if on_object else 0.0
    survivors = claimed[-1]
    if survivors.any():
        row["missed_6px"] = scoring.missed(tracks.points[0, survivors], back(tracks.points[-1, survivors]))
    row["tracks"], row["survivors"] = int(claimed.shape[1]), int(survivors.sum())
    return row


def _empty(judged: Judged, method: str, seconds: float) -> dict[str, Any]:
    frames = len(judged.video.frames)
    return {
        "name": judged.name,
        "kind": judged.kind,
        "method": method,
        "frames": frames,
        "seconds_per_frame": seconds / frames,
        "iou": None,
        "alive": None,
        "missed_6px": None,
        "track_error_px": None,
        "warnings": [],
    }


def _stopped(judged: Judged, error: str, seconds: float) -> dict[str, Any]:
    """The row of a sequence at which the stage stopped with a message: nothing was found, and the user knows."""
    row = _empty(judged, STAGE, seconds)
    nothing = None if judged.object_masks is None else [0.0] * row["frames"]
    return {**row, "iou": nothing, "alive": 0.0, "warnings": [f"stopped: {error}"]}
