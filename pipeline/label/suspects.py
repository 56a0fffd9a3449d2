"""Frames that somebody should look at: where masks jump or vanish, and what the stage itself was unsure of."""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from physreal_core.array_types import Array, Float

JUMP = 0.25
"""Change of the object's area from one frame to the next that is suspicious [share]."""
LEAST_SEEN = 0.5
"""Below this share of visible tracks a frame is suspicious."""


@dataclass(frozen=True)
class Curves:
    """Over the frames: shares of the image that object and hand cover, and the share of tracks that are visible."""

    object: Float[Array, " T"]
    controller: Float[Array, " T"]
    seen: Float[Array, " T"]


def suspects(curves: Curves, report: dict[str, Any]) -> dict[int, list[str]]:
    """Frame → reasons to look at it.

    Args:
        curves: of the masks and tracks.
        report: segmentation.json and quality.json of the stage.
    """
    found: dict[int, list[str]] = defaultdict(list)
    area = curves.object
    for t in np.flatnonzero(area == 0).tolist():
        found[t].append("no pixel is the object's")
    before, after = area[:-1], area[1:]
    change = np.divide(np.abs(after - before), np.maximum(before, 1e-9))
    for t in (np.flatnonzero((change > JUMP) & (before > 0) & (after > 0)) + 1).tolist():
        found[t].append(f"the object's area changes by {change[t - 1]:.0%}")
    for t in np.flatnonzero(curves.seen < LEAST_SEEN).tolist() if curves.seen.any() else []:
        found[t].append(f"{curves.seen[t]:.0%} of the tracks are visible")
    for thing, frames in _told(report.get("keyframes_without_vote")).items():
        for t in frames:
            found[t].append(f"no candidate was sure enough for the {thing}")
    return {t: reasons for t, reasons in sorted(found.items()) if 0 <= t < len(area)}


def _told(value: Any) -> dict[str, list[int]]:
    """Frames by thing, of a report that may be of another version."""
    if not isinstance(value, dict):
        return {}
    return {str(k): [t for t in v if isinstance(t, int)] for k, v in value.items() if isinstance(v, Iterable)}
