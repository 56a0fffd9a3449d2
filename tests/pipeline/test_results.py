"""summarise and report on a finished project: the numbers that evaluate wrote, averaged as the benchmark does."""

import csv
import json
import re
from dataclasses import replace

import pytest

from physreal_core.errors import InputError
from physreal_core.gap import ProposedMotion, Separation
from physreal_core.gap.report import Disagreement
from pipeline.graph import FIT_STAGES
from pipeline.products.gap import load_gap, save_gap
from pipeline.results import METRICS, Results
from pipeline.tables import mean_scores
from stages import report, summarise
from tests.pipeline.finished import FRAMES, OBSERVED, finished_project, scores


@pytest.fixture(scope="module")
def results(tmp_path_factory) -> Results:
    return Results.open(finished_project(tmp_path_factory.mktemp("finished")))


def test_summary_has_the_agreed_form(results):
    summarise.run(results)
    summary = json.loads((results.project.results / "summary.json").read_text())
    assert set(summary) == {"missing_effect", "sequences"} and set(summary["sequences"]) == {"lift", "push"}
    missing = summary["missing_effect"]
    assert set(missing) == {"lift"}, "a predicted sequence has no verdict of its own"
    assert missing["lift"] == pytest.approx(
        {"verdict": "effect", "named": "linear_drag", "probability": 0.96, "closed": 0.98}
    )
    for sequence, stages in summary["sequences"].items():
        assert stages.pop("shape") == {"lift": "given", "push": "seen"}[sequence]
        assert tuple(stages) == FIT_STAGES
        for stage, intervals in stages.items():
            for interval in ("observed", "future"):
                assert set(intervals[interval]) == set(METRICS)
                assert intervals[interval] == pytest.approx(scores(sequence, stage, interval))


def test_means_weigh_images_by_frames_and_distances_by_sequence(results):
    metrics = results.metrics
    metrics["push"]["fit_global"]["observed"] |= {"iou": 0.5, "frames": [1, 4]}
    mean = mean_scores(results, ["lift", "push"], "fit_global", "observed")
    assert mean["iou"] == pytest.approx((0.9 * (OBSERVED - 1) + 0.5 * 3) / (OBSERVED - 1 + 3))
    assert mean["track_error"] == pytest.approx((0.004 + 0.006) / 2)


def test_a_metric_that_does_not_apply_is_absent(results):
    block = results.metrics["lift"]["fit_global"]["future"]
    kept = {key: block.pop(key) for key in ("iou", "psnr")}
    assert set(summarise.summary(results)["sequences"]["lift"]["fit_global"]["future"]) == set(METRICS) - {
        "iou",
        "psnr",
    }
    block |= kept


def test_tables_and_curves(results):
    summarise.run(results)
    folder = results.project.results
    with (folder / "tables/by_geometry.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["geometry"], row["model"]) for row in rows} == {("volumetric", "fitted"), ("linear", "predicted")}
    future = next(row for row in rows if row["geometry"] == "volumetric" and row["frames"] == "future")
    assert float(future["track error [mm]"]) == pytest.approx(8.0)
    with (folder / "tables/by_shape.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {(row["shape"], row["model"]) for row in rows} == {("given", "fitted"), ("seen", "predicted")}
    assert [row["true vertices [mm]"] for row in rows if row["frames"] == "observed"] == ["3.50"] * 2 * len(FIT_STAGES)
    assert {row["true vertices [mm]"] for row in rows if row["frames"] == "future"} == {""}, "nothing is known of it"
    assert (folder / "tables/by_stage.md").read_text().count("|\n") == 2 + 2 * 2 * len(FIT_STAGES)
    with (folder / "plots/frames.csv").open() as file:
        frames = list(csv.DictReader(file))
    assert len(frames) == FRAMES - 1 and float(frames[0]["fit_residual"]) == pytest.approx(0.7 * 0.004)


def test_other_methods_stand_in_the_summary_and_in_tables_where_they_were_measured(results):
    def row(method: str, sequence: str = "lift", part: bool = False) -> dict:
        errors = {"track_error": 0.003, "vertex_error": 0.002}
        cost = {"numbers": 2, "seconds": 61.0, "memory": 2e9}
        facts = {"sequence": sequence, "method": method, "words": method.upper(), "part": part}
        return facts | {"observed": errors, "future": errors, "other_motions": {"push": {"vertex_error": 0.004}}} | cost

    path = results.project.results / "baselines.json"
    rows = [row("ours"), row("springs"), row("without_masks", part=True), row("springs", "of_another_project")]
    path.write_text(json.dumps({"rows": rows}))
    summarise.run(replace(results))
    summary = json.loads((results.project.results / "summary.json").read_text())
    assert {name: list(own) for name, own in summary["baselines"].items()} == {
        "lift": ["ours", "springs", "without_masks"]
    }
    assert summary["baselines"]["lift"]["springs"]["future"]["vertex_error"] == 0.002
    for table, methods in (("baselines", ["OURS", "SPRINGS"]), ("by_loss", ["OURS", "WITHOUT_MASKS"])):
        with (results.project.results / f"tables/{table}.csv").open() as file:
            shown = list(csv.DictReader(file))
        assert [own["method"] for own in shown] == methods
        assert shown[0]["true vertices, other motion [mm]"] == "4.00" and shown[0]["time [s]"] == "61"
    path.unlink()


def test_what_was_missing_stands_in_a_table_and_what_it_leaves_to_the_networks(results):
    summarise.run(results)
    with (results.project.results / "tables/gaps.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert list(row.values()) == ["lift", "effect", "linear_drag", "0.96", "98%", "", "4.0", "11.0"]


def test_the_gap_in_sentences_and_tables(results):
    summary = results.gap("lift")
    assert summary.sentences[0] == "lift: From frame 31 on the far end lags by 9 mm."
    assert "closes 98%" in summary.sentences[2] and summary.sentences[3] == "Next: swings at two sizes."
    answers, gaps = summary.tables()
    assert answers.rows[0] == ["linear_drag", "96%", "12.5", "4.0", "rate 1.5 1/s (1.2 to 1.8)"]
    assert [row[0] for row in answers.rows] == ["linear_drag", "none"], "only what was fitted"
    assert gaps.rows[1] == ["lift", "held out", "9.00 (9.0)", "2.70 (2.7)", "7.50 (7.5)", "2.40", "0.80"]
    assert results.gap("push") is None


def test_what_an_effect_closes_on_the_motion_that_was_not_fitted(results):
    def entry(interaction, interval, rms):
        return Disagreement(interaction, interval, rms, rms, 1.0, 0.003)

    before = entry(0, "held_out", 0.009), entry(1, "train", 0.005), entry(1, "held_out", 0.005)
    after = entry(0, "held_out", 0.009), entry(1, "train", 0.004), entry(1, "held_out", 0.003)
    summary = results.gap("lift")
    moved = replace(summary, after=replace(summary.after, before=before, after=after, fitted_on=0))
    # squares beyond a floor of 3 mm: 16 + 16 before, 7 + 0 after
    assert moved.closed_on_other_motion == pytest.approx(1 - 7 / 32)
    assert "on the motion that the fit never saw 78%" in " ".join(moved.sentences)
    assert replace(moved, after=replace(moved.after, adopted=False)).closed_on_other_motion is None


def test_motions_to_film_next_stand_in_a_table(results):
    summary = results.gap("lift")
    known = ProposedMotion("drop_catch", "Drop it and catch it", 0.41, 0.69, False, (), 0, 30.0, ((0.0, 0.0, 0.0),))
    estimated = replace(known, name="drag_stop", words="Drag it", information=0.2, rough=True)
    gap = replace(summary.gap, next_motions=(known, estimated))
    *_, motions = replace(summary, gap=gap).tables()
    assert motions.rows == [["Drop it and catch it", "0.41"], ["Drag it", "about 0.20"]]


def test_motions_to_film_next_are_read_back_as_they_were_written(results, tmp_path):
    path = ((0.0, 0.0, 0.0), (0.0, 0.01, 0.02))
    known = ProposedMotion("drop_catch", "Drop it", 0.41, 0.69, False, (Separation(("wind",), (), 1.5),), 1, 30.0, path)
    gap = replace(results.gap("lift").gap, next_motions=(known,))
    save_gap(tmp_path, gap)
    assert load_gap(tmp_path).next_motions == (known,)


def test_report_is_one_page_with_everything_inside(results):
    page = report.run(results).read_text()
    assert not re.search(r'(src|href)="(?!data:|#)', page), "nothing outside the file is referred to"
    assert page.count("data:video/mp4") == 2 * len(FIT_STAGES)
    assert "data:image/svg+xml" in page and "Young&#39;s modulus" in page.replace("Young's", "Young&#39;s")
    assert (results.project.results / "pictures/lift.jpg").stat().st_size > 1000
    assert "From frame 31 on the far end lags" in page and "11.0 % of the expert" in page
    told = page.index("fewer than 50% of the tracks are seen in frame 3")
    assert told < page.index('<h2 id="'), "warnings stand at the top"
    assert "nothing refitted" in page and "vertex_error" in page
    assert report.run(results).read_text() == page, "its lock is the same after every run"


def test_results_made_with_other_parameters_are_refused(results, tmp_path):
    raw = json.loads(results.project.parameters.read_text())
    text = results.project.parameters.read_text()
    results.project.parameters.write_text(json.dumps({**raw, "seed": 5}))
    try:
        with pytest.raises(InputError, match="seed = 0 where 5 is wanted"):
            summarise.summary(Results.open(results.project))
    finally:
        results.project.parameters.write_text(text)
