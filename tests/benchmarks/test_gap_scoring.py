"""The score of a made-up set of answers, against numbers counted by hand."""

import json

import pytest

from benchmarks.gap.cases import GapCase, benchmark_cases, calibration_cases, chosen
from benchmarks.gap.figures import draw_confusion, draw_reliability
from benchmarks.gap.scoring import Sizes, judge, read_cases, summary
from benchmarks.gap.table import page

SIZES = {
    "wind": Sizes({"x": 0.0, "y": 0.0}, {"x": 0.5, "y": 0.5}, ("x", "y")),
    "payload": Sizes({"ratio": 0.0}, {"ratio": 0.2}, ("ratio", "x")),
    "lag": Sizes({"time": 0.0}, {"time": 0.01}, ("time",)),
}


def effect(name, values, width=0.1):
    intervals = {key: [value - width, value + width] for key, value in values.items()}
    return {"name": name, "values": values, "intervals": intervals, "units": {}}


def answer(kind, members, probability, fitted=(), closed=0.5, seconds=100.0):
    """Members by names; the first is the best. Candidates: the members, then "none"."""
    by_name = {entry["name"]: entry for entry in fitted}
    candidates = [
        {
            "effects": [by_name.get(n, effect(n, {})) for n in names],
            "screened": 5.0 - i,
            "gain": 4.0,
            "probability": 0.9 / (i + 1),
        }
        for i, names in enumerate(members)
    ]
    candidates.append({"effects": [], "screened": None, "gain": 0.0, "probability": 0.01})
    verdict = {"kind": kind, "names": members[0] if members else [], "members": members, "probability": probability}
    report = {"verdict": verdict, "candidates": candidates}
    return {"report": report, "added": {"adopted": bool(members), "closed": closed}, "seconds": seconds}


def oracle(truth, closed=0.8):
    return {"truth": truth, "closed": closed}


WIND = GapCase("wind", "high", 1)
PAYLOAD = GapCase("payload", "middle", 2)
LAG = GapCase("lag", "high", 3)
WEAK = GapCase("lag", "weak", 4)
PAIR = GapCase("payload+wind", "high", 5)
MAGNET = GapCase("outside:magnet", "high", 6)
NONES = [GapCase("none", "middle", 10 + i) for i in range(3)]


def judged_set():
    wind = effect("wind", {"x": 1.0, "y": 0.3})
    pair = [effect("wind", {"x": 1.0, "y": 0.0}), effect("payload", {"ratio": 0.2, "x": 0.5}, width=0.01)]
    given = [
        (WIND, answer("effect", [["wind"]], 0.95, [wind], closed=0.6), oracle({"wind": {"x": 1.0, "y": 0.0}})),
        (PAYLOAD, answer("class", [["wind"], ["payload"]], 0.8), oracle({"payload": {"ratio": 0.2, "x": 0.0}})),
        (LAG, None, None),
        (WEAK, answer("none", [], 0.6), oracle({"lag": {"time": 0.01}})),
        (PAIR, answer("effects", [["wind", "payload"]], 0.85, pair), oracle({"wind": {"x": 1.0}, "payload": {"x": 0}})),
        (MAGNET, answer("effect", [["lag"]], 0.93), oracle({})),
        (NONES[0], answer("none", [], 0.97), oracle({}, 0.0)),
        (NONES[1], answer("effect", [["wind"]], 0.99), oracle({}, 0.0)),
        (NONES[2], answer("unknown", [], 0.5), oracle({}, 0.0)),
    ]
    return [judge(case, found, true, SIZES) for case, found, true in given]


def test_headline_numbers_are_those_counted_by_hand():
    found = summary(judged_set())
    assert found["named_first"] == pytest.approx(1 / 3)  # wind; payload came second, lag gave no answer
    assert found["named_in_class"] == pytest.approx(2 / 3)
    assert found["false_alarm_rate"] == pytest.approx(2 / 3)  # an unknown without a gap is an alarm too
    assert found["two_effects_both"] == 1.0
    assert found["unknown_handled"] == 0.0
    assert found["outside_confidently_wrong"] == 1.0
    assert found["gap_closed_vs_oracle_median"] == pytest.approx(0.6 / 0.8)
    assert found["size_error_median"] == pytest.approx(0.3)  # |(0, 0.3)| over |(1, 0)|
    assert found["interval_coverage"] == pytest.approx(2 / 4)  # x of both winds, not the first's y nor the place
    assert found["largest_class"] == 2
    assert found["counts"]["failed"] == 1
    assert found["by_strength"]["weak"] == {"count": 1, "named_first": 0.0, "named_in_class": 0.0, "said_none": 1.0}


def test_confusion_and_reliability():
    found = summary(judged_set())
    matrix = found["confusion_matrix"]
    cell = {(t, n): c for t, row in zip(matrix["truth"], matrix["counts"]) for n, c in zip(matrix["named"], row)}
    assert {key for key, count in cell.items() if count} == {
        ("wind", "wind"),
        ("payload", "wind"),
        ("lag", "failed"),
        ("none", "none"),
        ("none", "wind"),
        ("none", "unknown"),
        ("outside:magnet", "lag"),
    }
    assert sum(cell.values()) == 7  # weak ones and pairs are not in it
    bins = {entry["from"]: (entry["count"], entry["right"]) for entry in found["reliability"]}
    assert bins == {0.5: (1, 0.0), 0.7: (2, 1.0), 0.9: (2, 0.5), 0.97: (2, 0.5)}


def test_an_outside_effect_is_handled_as_unknown_or_by_its_nearest_relative():
    assert judge(MAGNET, answer("unknown", [], 0.6), None, SIZES).in_class
    assert judge(MAGNET, answer("class", [["lag"], ["gravity"]], 0.6), None, SIZES).in_class
    assert not judge(MAGNET, answer("effects", [["gravity", "lag"]], 0.6), None, SIZES).in_class
    assert not judge(MAGNET, answer("none", [], 0.6), None, SIZES).in_class


def test_a_case_on_disk_counts_when_it_has_an_answer_or_has_failed(tmp_path):
    (tmp_path / WIND.name).mkdir()
    (tmp_path / WIND.name / "answer.json").write_text(json.dumps(answer("effect", [["wind"]], 0.9)))
    (tmp_path / LAG.name).mkdir()
    (tmp_path / LAG.name / "failed.txt").write_text("no convergence")
    judged, missing = read_cases(tmp_path, [WIND, LAG, PAIR], SIZES)
    assert [j.verdict for j in judged] == ["effect", "failed"]
    assert missing == [PAIR]


def test_page_and_figures(tmp_path):
    judged = judged_set()
    numbers = summary(judged)
    text = page("tracks only", numbers, judged)
    assert "| wind | high | 1 | 1 | 1 | 0.30 | 0.75 | 1 | wind (0.95) | 100 |" in text
    assert "| lag | high | 1 | 0 | 0 |" in text and "failed" in text
    draw_confusion(tmp_path / "c.png", numbers["confusion_matrix"], "t")
    draw_reliability(tmp_path / "r.png", numbers["reliability"], "t")
    assert all((tmp_path / name).stat().st_size > 5000 for name in ("c.png", "r.png"))


def test_cases_are_named_seeded_and_keep_their_seeds_when_the_library_grows():
    few, more = (
        benchmark_cases(names, variant="tracks_only") for names in (["wind", "payload"], ["lag", "wind", "payload"])
    )
    assert len({case.name for case in more}) == len(more)
    assert {case for case in few if case.kind == "single"} < set(more)
    assert all(GapCase.named(case.name) == case for case in more)
    assert sum(case.kind == "none" for case in more) >= 20
    assert {case.strength for case in more if case.effect == "wind"} == {"weak", "middle", "high"}
    assert not set(benchmark_cases(["wind"], variant="tracks_only", seed=1)) & set(more)
    assert not set(calibration_cases(["wind", "lag"], 8)) & set(more)
    assert sum(case.kind == "none" for case in calibration_cases(["wind", "lag"], 8)) == 4
    assert [case.effect for case in chosen(more, ["lag-*"])] == ["lag"] * 3
    assert sum(case.kind == "none" for case in more[: len(more) // 3]) >= 6  # controls come in between


def test_a_true_model_that_cannot_be_simulated_has_closed_nothing_to_compare_with():
    found = answer("effect", [["wind"]], 0.95, [effect("wind", {"x": 1.0, "y": 0.0})])
    for closed in (None, float("nan")):
        judged = judge(WIND, found, oracle({"wind": {"x": 1.0, "y": 0.0}}, closed), SIZES)
        assert judged.first and judged.closed_share is None
