"""Tables and numbers of `benchmarks.perception`: perception.json and perception.md."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.filmed import CLIPS
from benchmarks.perception_runs import BASELINE, STAGE
from benchmarks.perception_scoring import BINS, RIGHT_PX, Interval, pooled

Row = dict[str, Any]
POOR_IOU = 0.8
"""Where the overlap falls below this, the user should have been warned."""
KEYS = ("iou_mean", "iou_min", "alive", "missed_6px", "seconds_per_frame")
HEAD = """\
# The first stage on filmed clips and on rendered truth

`python -m benchmarks.perception` (`--clips`, `--rendered`, `--only NAME` for a part). Default settings. The clips come without
any hint; they are scaled to 640 x 362 px, and three of them have true masks. The rope's (`pushrope`), made by colour, lack about
the upper half of the rope and take in shadow below it, seen by eye in frame 0, so that its IoU says little. The rendered sequences (320 x 240 px, `data/rig`)
come without a hint, too, and without their depth; they show a hand of five fingers that the finder of hands knows. The baseline is a plain SAM 2 + DIS loop (`benchmarks/perception_baseline.py`) that is given the stage's own mask
and points of frame 0.

- *IoU*: overlap of the object's mask with the true one, mean and worst frame.
- *alive*: of the tracks from frame 0 that are truly visible at the end, the share that the tracker says is visible. On clips a
  track counts as truly visible where its last position lies on the true mask, or on the stage's own where there is none.
- *missed*: share of the surviving tracks that miss their start by more than 6 px when they are tracked back.
- *error*: mean distance from the true place [px], where a point is visible and said to be.
- *hand*: share of the object's mask that is truly a hand, in the worst frame.
- *s/frame*: of the machine that ran it, all of the stage without reading and writing.
"""


def write_report(rows: Sequence[Row], folder: Path, note: str = "") -> None:
    """Write both files into `folder`; `note` tells the conditions of the run."""
    (folder / "perception.json").write_text(json.dumps(summary(rows), indent=1) + "\n")
    (folder / "perception.md").write_text(page(rows, note))


def summary(rows: Sequence[Row]) -> Row:
    """The contents of perception.json; null stands for what was not run or cannot be scored."""
    clips = {row["name"]: row for row in rows if row["kind"] == "clips" and row["method"] == STAGE}
    rendered = [row for row in rows if row["kind"] == "rendered" and row["method"] == STAGE]
    values = [_values(row) for row in rendered]
    together = {key: _known(pooled([v[key] for v in values]).mean) for key in (*KEYS, "track_error_px")}
    worst = [v["iou_min"] for v in values if v["iou_min"] is not None]
    together["iou_min"] = min(worst) if worst else None
    return {
        "clips": {name: {key: _values(clips[name])[key] if name in clips else None for key in KEYS} for name in CLIPS},
        "rendered": {**together, "sequences": len(rendered)},
    }


def page(rows: Sequence[Row], note: str = "") -> str:
    """The contents of perception.md."""
    parts = [HEAD] + ([f"{note}\n"] if note else [])
    for kind, title in (("clips", "Filmed clips"), ("rendered", "Rendered sequences")):
        own = [row for row in rows if row["kind"] == kind]
        if own:
            parts += [f"## {title}\n", _table(own), f"## {title}, pooled\n", _pooled_table(own)]
    stage = [row for row in rows if row["method"] == STAGE]
    parts += ["## Warnings\n", _warnings(stage)]
    if any(row.get("calibration") for row in stage):
        parts += ["## Confidence on rendered truth\n", _calibration(stage)]
    return "\n".join(parts)


def _values(row: Row) -> Row:
    iou = row["iou"]
    mean, least = (None, None) if iou is None else (float(np.mean(iou)), float(np.min(iou)))
    plain = {key: _known(row[key]) for key in ("alive", "missed_6px", "seconds_per_frame", "track_error_px")}
    hand = max(row["hand_in_object"]) if row.get("hand_in_object") else None
    return {"iou_mean": mean, "iou_min": least, **plain, "hand": hand}


def _known(value: float | None) -> float | None:
    return None if value is None or not np.isfinite(value) else float(value)


def _text(value: float | None, digits: int = 3) -> str:
    return "–" if value is None else f"{value:.{digits}f}"


def _table(rows: Sequence[Row]) -> str:
    lines = [
        "| sequence | method | frames | IoU mean | IoU least | alive | missed | error px | hand | s/frame |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        v = _values(row)
        numbers = (v["iou_mean"], v["iou_min"], v["alive"], v["missed_6px"])
        cells = [row["name"], row["method"], str(row["frames"]), *map(_text, numbers)]
        cells += [_text(v["track_error_px"], 2), _text(v["hand"]), _text(v["seconds_per_frame"], 2)]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _pooled_table(rows: Sequence[Row]) -> str:
    """Means over sequences with their bootstrap intervals."""
    names = {"iou_mean": "IoU mean", "iou_min": "IoU least", "alive": "alive", "missed_6px": "missed"}
    names |= {"track_error_px": "error px", "hand": "hand"}
    lines = [
        (
            f"Means over sequences, 95 % bootstrap intervals (`scipy.stats.bootstrap` over sequences).\n\n"
            f"| method | sequences | {' | '.join(names.values())} |"
        ),
        f"|{'---|' * (2 + len(names))}",
    ]
    for method in (STAGE, BASELINE):
        own = [_values(row) for row in rows if row["method"] == method]
        if own:
            cells = [_interval(pooled([v[key] for v in own])) for key in names]
            lines.append(f"| {method} | {len(own)} | {' | '.join(cells)} |")
    return "\n".join(lines) + "\n"


def _interval(interval: Interval) -> str:
    if not np.isfinite(interval.mean):
        return "–"
    bounds = f" ({interval.low:.3f} to {interval.high:.3f})" if np.isfinite(interval.low) else ""
    return f"{interval.mean:.3f}{bounds}"


def _warnings(rows: Sequence[Row]) -> str:
    """What the stage said, and whether it said so where the mask failed."""
    judged = [row for row in rows if row["iou"] is not None]
    poor = [row for row in judged if min(row["iou"]) < POOR_IOU]
    silent = [row["name"] for row in poor if not row["warnings"]]
    false = [row["name"] for row in judged if row["warnings"] and row not in poor]
    lines = [
        f"In {len(poor)} of {len(judged)} sequences with true masks the IoU falls below {POOR_IOU} in some frame; "
        f"{len(poor) - len(silent)} of these raised a warning"
        + (f" (silent: {', '.join(silent)})" if silent else "")
        + f". {len(false)} of the other {len(judged) - len(poor)} raised one"
        + (f" ({', '.join(false)})" if false else "")
        + ".\n",
        "| sequence | IoU least | warnings |",
        "|---|---|---|",
    ]
    for row in rows:
        said = "; ".join(row["warnings"]).replace("|", "/") or "none"
        lines.append(f"| {row['name']} | {_text(_values(row)['iou_min'])} | {said} |")
    return "\n".join(lines) + "\n"


def _calibration(rows: Sequence[Row]) -> str:
    counts, right = np.sum([row["calibration"] for row in rows if row.get("calibration")], axis=0)
    lines = [
        (
            f"Points after frame 0 that the tracker says are visible, by their confidence, and the share of them within "
            f"{RIGHT_PX:.0f} px of the truth.\n"
        ),
        "| confidence | points | right |",
        "|---|---|---|",
    ]
    for i in range(BINS):
        share = _text(right[i] / counts[i]) if counts[i] else "–"
        lines.append(f"| {i / BINS:.1f} to {(i + 1) / BINS:.1f} | {counts[i]} | {share} |")
    sure = int(0.9 * BINS)
    if counts[sure:].sum():
        lines.append(f"\nOf those given 0.9 or more, {right[sure:].sum() / counts[sure:].sum():.3f} are right.")
    return "\n".join(lines) + "\n"
