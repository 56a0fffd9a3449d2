"""Intervals, files, and scores against truth."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from physreal_core.evaluation import (
    FrameScores,
    equivalent_modulus,
    mean_sag,
    split_scores,
    vertex_errors,
    windowed_mean,
)
from pipeline.products.scores import Scores

SCORES = [
    FrameScores(0, track_error=9.0, track_count=5, iou=0.0),
    FrameScores(1, track_error=0.01, track_count=3, cd_l1_oneway=0.002, iou=0.9),
    FrameScores(2, track_error=0.03, track_count=1, iou=0.7),
    FrameScores(3, track_count=0, iou=0.5),
]


def test_intervals() -> None:
    """Frame 0 is in neither; tracks weigh by entries, (3 * 0.01 + 1 * 0.03) / 4, other scores by frames."""
    intervals = split_scores(SCORES, observed=3)
    observed, future = intervals["observed"].to_json(), intervals["future"].to_json()
    assert observed == {
        "frames": [1, 3],
        "track_error": pytest.approx(0.015),
        "cd_l1_oneway": 0.002,
        "iou": pytest.approx(0.8),
    }
    assert future == {"frames": [3, 4], "iou": 0.5}
    json.dumps(observed, allow_nan=False)
    assert set(split_scores(SCORES, observed=4)) == {"observed"}


def test_csv(tmp_path) -> None:
    scores = Scores({"fit_global": {}}, {"fit_global": SCORES}, observed=3)
    scores.save(tmp_path)
    rows = list(csv.DictReader((tmp_path / "frames.csv").open()))
    assert [row["interval"] for row in rows] == ["observed", "observed", "observed", "future"]
    assert rows[1]["stage"] == "fit_global" and float(rows[1]["cd_l1_oneway"]) == 0.002
    assert rows[3]["track_error"] == ""
    assert Scores.load(tmp_path) == scores


def test_vertex_errors() -> None:
    true = np.zeros((2, 4, 3))
    ours = true.copy()
    ours[1, :, 0], ours[1, 0, 2] = 0.003, 0.004
    np.testing.assert_allclose(vertex_errors(ours, true), [0, (3 * 0.003 + 0.005) / 4])


def test_equivalent_modulus_of_a_hanging_bar() -> None:
    """A bar hung from the hand and lifted by 0.3 m: u(s) = rho g (L s - s^2 / 2) / E below the grip.

    Simulated with E and true with 2 E, the equivalent of E is exactly 2 E; the vertex in the hand does not count.
    """
    s, load = np.linspace(0, 0.2, 21), 300 * 9.81

    def hang(modulus: float) -> np.ndarray:
        start = np.column_stack([np.zeros((21, 2)), 0.2 - s])
        sag = load * (0.2 * s - s**2 / 2) / modulus
        moved = start + np.column_stack([np.zeros((21, 2)), 0.3 - sag])
        return np.stack([start, moved, moved])

    hand = np.array([[0.0, 0, 0], [0, 0, 0.3], [0, 0, 0.3]])
    free = s > 0
    sag, true_sag = (mean_sag(hang(E), hand, 2, free) for E in (6e4, 12e4))
    assert sag == pytest.approx(load * (0.2 * s - s**2 / 2)[1:].mean() / 6e4)
    assert equivalent_modulus(6e4, sag, true_sag) == pytest.approx(12e4)
    assert equivalent_modulus(6e4, -0.001, true_sag) is None


def test_windowed_mean_of_a_swing() -> None:
    """Five and a half periods of amplitude 1: the plain mean is off by 1 / (5.5 pi) = 6 %, this by less than 1 %."""
    swing = -1.3 + np.sin(2 * np.pi * np.arange(72) / 13.1)
    assert abs(windowed_mean(swing) + 1.3) < 0.01
    assert abs(swing.mean() + 1.3) > 0.05
