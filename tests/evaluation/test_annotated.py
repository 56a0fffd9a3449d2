"""Scores on a benchmark's own annotations, against its formulas written out (design: the PhysTwin benchmark's scoring scripts)."""

from __future__ import annotations

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.evaluation import FrameScores, split_scores
from pipeline.products.truth import CaptureTruth
from stages._evaluation import Annotated
from tests.evaluation.test_stage import FRAMES, LIFT, OBSERVED, Context, context  # noqa: F401


def nearest(points: np.ndarray, others: np.ndarray, order: int) -> np.ndarray:
    """Number of the nearest other point of each, by the Manhattan (1) or Euclidean (2) distance, one pair after another."""
    found = []
    for point in points:
        distances = [sum(abs(point - other) ** order) for other in others]
        found.append(int(np.argmin(distances)))
    return np.array(found)


def golden(
    surface: np.ndarray, tracks: np.ndarray, points: np.ndarray, seen: np.ndarray, first: int, last: int
) -> dict:
    """Track error: bound at frame 0 to the nearest vertex, the mean over all entries that are annotated. CD: the mean over frames of the
    mean over visible points of the Manhattan distance to the nearest vertex."""
    marked = ~np.isnan(tracks[0]).any(1)
    bound = nearest(tracks[0][marked], surface[0], 2)
    errors, chamfer = [], []
    for t in range(first, last):
        there = tracks[t][marked]
        known = ~np.isnan(there).any(1)
        errors += list(np.sqrt(((surface[t][bound[known]] - there[known]) ** 2).sum(1)))
        visible = points[t][seen[t]]
        chamfer.append(np.abs(visible - surface[t][nearest(visible, surface[t], 1)]).sum(1).mean())
    return {"track_error": np.mean(errors), "cd_l1_oneway": np.mean(chamfer)}


@pytest.fixture
def annotated(context: Context, tmp_path):  # noqa: F811
    """The sequence of the stage's test with annotations in its truth.npz, and what was annotated."""
    random = np.random.default_rng(1)
    truth = CaptureTruth.load(context.capture)
    tracks = truth.vertices[:, ::5] + 0.002 * random.normal(size=truth.vertices[:, ::5].shape)
    tracks[2:4, 1], tracks[:, 2] = np.nan, np.where(np.arange(FRAMES)[:, None] == 0, np.nan, tracks[:, 2])
    points = truth.vertices + 0.003 * random.normal(size=truth.vertices.shape)
    seen = random.random(points.shape[:2]) < 0.6
    vars(context)["capture"] = tmp_path
    CaptureTruth(
        vertices=truth.vertices, hand=truth.hand, gripped=truth.gripped, youngs_modulus=truth.youngs_modulus,
        gt_track_3d=tracks, object_points=np.where(seen[..., None], points, np.nan), object_visibilities=seen,
    ).save(tmp_path)  # fmt: skip
    yield context, tracks, points, seen
    context.capture = context.root / "capture"


def test_scores_are_those_of_the_benchmarks_formulas(annotated) -> None:
    from stages import evaluate
    from stages._evaluation import Replay, load_sequence

    context, tracks, points, seen = annotated  # noqa: F811
    evaluate.run(context)
    sequence = load_sequence(context)
    import json

    metrics = json.loads((context.output / "metrics.json").read_text())
    for stage, folder in context.models().items():
        replay = Replay(sequence, folder)
        surface = np.stack([replay.carry(t, sequence.surface, replay.surface) for t in range(FRAMES)])
        for interval, (first, last) in {"observed": (1, OBSERVED), "future": (OBSERVED, FRAMES)}.items():
            expected, found = golden(surface, tracks, points, seen, first, last), metrics[stage][interval]
            for name, value in expected.items():
                assert found[name] == pytest.approx(value, rel=1e-9), (stage, interval, name)
            assert found["measured_track_error"] != pytest.approx(found["track_error"], rel=0.1)
    assert metrics["fit_patches"]["future"]["track_error"] > LIFT / 5


def test_annotations_of_fewer_frames_are_refused(annotated) -> None:
    context, *_ = annotated  # noqa: F811
    with pytest.raises(InputError, match="gt_track_3d of 6 frames"):
        Annotated.of(context.capture, FRAMES + 1)


def test_measured_tracks_beside_annotated_ones_weigh_by_their_entries() -> None:
    scores = [
        FrameScores(1, track_error=0.01, track_count=3, measured_track_error=0.002, measured_track_count=1),
        FrameScores(2, track_error=0.03, track_count=1, measured_track_error=0.004, measured_track_count=3),
    ]
    found = split_scores(scores, observed=3)["observed"].to_json()
    assert found["track_error"] == pytest.approx(0.015) and found["measured_track_error"] == pytest.approx(0.0035)
