"""The report of the perception benchmark: its keys, and who was warned."""

import json

import pytest

for package in ("cv2", "mujoco", "onnxruntime"):
    pytest.importorskip(package)

from benchmarks.perception_report import KEYS, write_report


def row(name, kind="rendered", method="stage", **changes):
    return {
        "name": name, "kind": kind, "method": method, "frames": 2, "seconds_per_frame": 1.0, "iou": [0.9, 0.7],
        "alive": 0.9, "missed_6px": 0.01, "track_error_px": 1.0, "warnings": [],
    } | changes  # fmt: skip


def test_keys_and_warnings(tmp_path):
    counts = [0] * 9 + [10], [0] * 9 + [9]
    rows = [
        row("zebra", "clips", iou=None, track_error_px=None),
        row("cloth", "clips", warnings=["thin"]),
        row("cloth", "clips", "baseline"),
        row("a", calibration=counts),
        row("b", iou=[0.9, 0.9], alive=float("nan"), warnings=["area"]),
    ]
    write_report(rows, tmp_path)
    numbers = json.loads((tmp_path / "perception.json").read_text())
    assert set(numbers["clips"]) == {"cloth", "zebra", "dino", "pushrope"}
    assert all(set(clip) == set(KEYS) for clip in numbers["clips"].values())
    assert numbers["clips"]["zebra"]["iou_mean"] is None and numbers["clips"]["zebra"]["alive"] == 0.9
    assert numbers["clips"]["dino"]["alive"] is None
    assert numbers["clips"]["cloth"]["iou_min"] == 0.7
    rendered = numbers["rendered"]
    assert set(rendered) == {*KEYS, "track_error_px", "sequences"}
    assert rendered["sequences"] == 2 and rendered["iou_min"] == 0.7 and rendered["alive"] == 0.9
    page = (tmp_path / "perception.md").read_text()
    assert "1 of these raised a warning (silent: a)" in page and "1 of the other 1 raised one (b)" in page
    assert "given 0.9 or more, 0.900 are right" in page
