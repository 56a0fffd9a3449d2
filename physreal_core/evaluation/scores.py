"""Scores per frame and per interval; a score that does not apply is absent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class FrameScores:
    """Scores of one frame; None where there was nothing to compare with.

    Args:
        frame: number from 0.
        track_error: mean over the annotated tracks [m]; track_count: how many there are. Without annotations these are the measured ones,
            which the fit saw too.
        measured_track_error, measured_track_count: of the measured ones beside annotated ones.
        cd_l1_oneway, cd_l2_twoway: Chamfer distances [m].
        iou: 0 to 1; psnr: [dB]; ssim: -1 to 1.
    """

    frame: int
    track_error: float | None = None
    track_count: int = 0
    measured_track_error: float | None = None
    measured_track_count: int = 0
    cd_l1_oneway: float | None = None
    cd_l2_twoway: float | None = None
    iou: float | None = None
    psnr: float | None = None
    ssim: float | None = None


@dataclass(frozen=True)
class IntervalScores:
    """Means over the frames [first, last): of the track errors over all entries, of the others over frames."""

    first: int
    last: int
    track_error: float | None
    measured_track_error: float | None
    cd_l1_oneway: float | None
    cd_l2_twoway: float | None
    iou: float | None
    psnr: float | None
    ssim: float | None

    @classmethod
    def over(cls, scores: Sequence[FrameScores], first: int, last: int) -> IntervalScores:
        """Gather the scores of the frames from `first` to before `last`."""
        chosen = [score for score in scores if first <= score.frame < last]

        def mean(name: str) -> float | None:
            values = [value for score in chosen if (value := getattr(score, name)) is not None]
            return float(np.mean(values)) if values else None

        def over_entries(kind: str) -> float | None:
            entries = [(getattr(score, f"{kind}_error"), getattr(score, f"{kind}_count")) for score in chosen]
            known = [(error, count) for error, count in entries if count]
            return sum(error * count for error, count in known) / sum(count for _, count in known) if known else None

        others = {name: mean(name) for name in ("cd_l1_oneway", "cd_l2_twoway", "iou", "psnr", "ssim")}
        return cls(first, last, over_entries("track"), over_entries("measured_track"), **others)

    def to_json(self) -> dict[str, float | list[int]]:
        """What metrics.json holds: SI units, IoU as 0 to 1, `frames` = [first, last); absent scores left out."""
        values = {f.name: getattr(self, f.name) for f in fields(self)}
        first, last = values.pop("first"), values.pop("last")
        return {"frames": [first, last], **{name: value for name, value in values.items() if value is not None}}


def split_scores(scores: Sequence[FrameScores], observed: int) -> dict[str, IntervalScores]:
    """The benchmark's two intervals: observed [1, n), future [n, T); an interval without frames is left out."""
    count = 1 + max(score.frame for score in scores)
    intervals = {"observed": (1, observed), "future": (observed, count)}
    return {name: IntervalScores.over(scores, *span) for name, span in intervals.items() if span[0] < span[1]}
