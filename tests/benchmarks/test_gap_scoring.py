"""The score of a made-up set of answers, against numbers counted by hand."""

import json

import pytest

from benchmarks.gap.cases import LEADING, NEAREST, GapCase, benchmark_cases, calibration_cases, chosen
from benchmarks.gap.figures import draw_confusion, draw_reliability
from benchmarks.gap.interval_scale import covered
from benchmarks.gap.results import collect, pool, write_results
from benchmarks.gap.rows import put_rows, read_rows, rows_file
from benchmarks.gap.scoring import Sizes, judge
from benchmarks.gap.summary import counted, summary
from benchmarks.gap.table import page
from data.rig.bodies import BODIES
from data.rig.hidden.library import LIBRARY, OUTSIDE
from physreal_core.effects import EFFECTS
from physreal_core.gap.lead.force_library import ATTRACTION, RegionMotion, library
from tests.benchmarks.gap_rows import answer, effect, oracle, row, told

SIZES = {
    "wind": Sizes({"x": 0.0, "y": 0.0}, {"x": 0.5, "y": 0.5}, ("x", "y")),
    "payload": Sizes({"ratio": 0.0}, {"ratio": 0.2}, ("ratio", "x")),
    "lag": Sizes({"time": 0.0}, {"time": 0.01}, ("time",)),
}
WIND = GapCase("wind", "high", 1, "slab")
PAYLOAD = GapCase("payload", "middle", 2, "fork", "other")
LAG = GapCase("lag", "high", 3)
WEAK = GapCase("lag", "weak", 4)
PAIR = GapCase("payload+wind", "high", 5)
MAGNET = GapCase("outside:magnet", "high", 6)
NONES = [GapCase("none", "middle", 10 + i) for i in range(3)]


def rows():
    wind = effect("wind", {"x": 1.0, "y": 0.3})
    pair = [effect("wind", {"x": 1.0, "y": 0.0}), effect("payload", {"ratio": 0.2, "x": 0.5}, width=0.01)]
    other = told({"payload": {}}, visible=0.0015)
    return [
        row(WIND, answer("effect", [["wind"]], 0.95, [wind]), truth=told({"wind": {"x": 1.0, "y": 0.0}})),
        row(PAYLOAD, answer("class", [["wind"], ["payload"]], 0.8), truth=other),
        row(LAG, None),
        row(WEAK, answer("none", [], 0.6), truth=told({"lag": {"time": 0.01}}, visible=0.0005)),
        row(
            PAIR,
            answer("effects", [["wind", "payload"]], 0.85, pair),
            truth=told({"wind": {"x": 1.0}, "payload": {"x": 0}}),
        ),
        row(MAGNET, answer("effect", [["lag"]], 0.93)),
        row(NONES[0], answer("none", [], 0.97)),
        row(NONES[1], answer("effect", [["wind"]], 0.99)),
        row(NONES[2], answer("unknown", [], 0.5)),
    ]


def judged_set():
    return [judge(json.loads(json.dumps(own)), SIZES) for own in rows()]


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
    assert found["joint"] == pytest.approx(1 / 3)
    assert found["lead_right"] is None
    assert found["largest_class"] == 2
    assert found["counts"]["failed"] == 1
    assert found["by_strength"]["weak"] == {"count": 1, "named_first": 0.0, "named_in_class": 0.0, "said_none": 1.0}


def test_pooled_shares_have_wilsons_interval():
    found = summary(judged_set())["pooled"]
    # (p + z^2/2n -+ z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n), p = 1/3, n = 3, z = 1.96
    assert (found["named_first"]["hits"], found["named_first"]["count"]) == (1, 3)
    assert found["named_first"]["interval"] == pytest.approx([0.0615, 0.7923], abs=1e-3)
    assert found["lead_right"] == {"hits": 0, "count": 0, "share": None, "interval": None}
    assert counted([True] * 6 + [False] * 4)["interval"] == pytest.approx([0.3127, 0.8318], abs=1e-3)


def test_calibration_error_is_the_mean_distance_of_stated_from_right():
    # stated 0.6, right 0; (0.8 + 0.85) / 2, 1; (0.95 + 0.93) / 2, 1/2; (0.97 + 0.99) / 2, 1/2
    expected = (1 * 0.6 + 2 * (1 - 0.825) + 2 * (0.94 - 0.5) + 2 * (0.98 - 0.5)) / 7
    assert summary(judged_set())["calibration_error"] == pytest.approx(expected)


def test_groups_by_body_motion_form_and_visibility():
    found = summary(judged_set())
    assert {name: own["named_first"]["count"] for name, own in found["by_body"].items()} == {
        "bar": 1,
        "fork": 1,
        "slab": 1,
    }
    assert found["by_body"]["bar"]["false_alarm_rate"]["hits"] == 2
    assert found["by_form"]["other"]["named_in_class"]["hits"] == 1
    assert list(found["by_motion"]) == ["shake+press_drag"]
    spans = {entry["from"]: entry["named_first"]["count"] for entry in found["by_visibility"]}
    assert spans == {0.0: 1, 0.001: 1, 0.004: 2}  # weak; payload; wind and lag


def test_the_joint_number_asks_for_the_name_and_half_of_what_the_true_model_closes():
    def joint(closed, true, held_out=0.004, kind="effect"):
        judged = judge(row(WIND, answer(kind, [["wind"]], 0.9), oracle(closed, true), told(held_out=held_out)), SIZES)
        found = summary([judged])["pooled"]["joint"]
        return found["hits"], found["count"]

    assert joint(0.41, 0.8) == (1, 1) and joint(0.39, 0.8) == (0, 1)
    assert joint(-0.1, -0.5) == (0, 1)  # both made it worse
    assert joint(0.6, None) == (0, 1) and joint(None, 0.5) == (0, 1)
    assert joint(0.6, 0.8, held_out=0.0009) == (0, 0)  # the motion that was kept out does not show it
    unadopted = row(WIND, answer("effect", [["wind"]], 0.9) | {"added": {"adopted": False}}, oracle(0.6))
    assert judge(unadopted, SIZES).closed == 0.0 and not judge(unadopted, SIZES).joint


def test_the_lead_on_an_unknown_is_right_where_its_first_term_is():
    said = {
        formulas: judge(row(MAGNET, answer("unknown", [], 0.5, lead=formulas)), SIZES).lead_right
        for formulas in ((ATTRACTION.formula, "-v"), ("-v", ATTRACTION.formula), ())
    }
    assert list(said.values()) == [True, False, False]
    assert judge(row(MAGNET, answer("effect", [["lag"]], 0.5)), SIZES).lead_right is None
    assert judge(row(NONES[0], answer("unknown", [], 0.5)), SIZES).lead_right is None


def test_every_effect_outside_the_library_has_relatives_and_a_leading_term_of_the_library_of_forces():
    import numpy as np

    still = RegionMotion(np.zeros((4, 2, 3)), np.zeros((4, 2, 3)), np.zeros((4, 2)))
    known = {term.formula for term in library(still, np.zeros(3))[0]} | {ATTRACTION.formula}
    outside = {name.removeprefix(OUTSIDE) for name in LIBRARY if name.startswith(OUTSIDE)}
    assert set(LEADING) == set(NEAREST) == outside
    assert {formula for formulas in LEADING.values() for formula in formulas} <= known
    assert {name for names in NEAREST.values() for name in names} <= set(EFFECTS)


def test_what_the_rigs_cloth_has_anyway_may_be_named_or_left_out():
    known = {"kelvin_voigt": Sizes({"time": 0.0}, {"time": 0.01}, ("time",))} | SIZES
    viscous = effect("kelvin_voigt", {"time": 0.001})

    def judged(effect_name, body, names):
        given = row(
            GapCase(effect_name, "high", 1, body),
            answer("effects", [names], 0.9, [viscous, effect("wind", {"x": 1.0, "y": 0.0})]),
        )
        return judge(json.loads(json.dumps(given)), known)

    for names in (["kelvin_voigt", "wind"], ["wind"]):
        assert judged("wind", "cloth", names).first
    assert (
        judged("wind", "cloth", ["kelvin_voigt", "wind"]).with_the_rigs_own
        and not judged("wind", "cloth", ["wind"]).with_the_rigs_own
    )
    assert not judged("wind", "rope", ["kelvin_voigt", "wind"]).first
    assert not judged("wind", "cloth", ["kelvin_voigt"]).first
    assert (
        judged("kelvin_voigt", "cloth", ["kelvin_voigt"]).first and not judged("kelvin_voigt", "cloth", ["wind"]).first
    )
    alone, drag = judged("none", "cloth", ["kelvin_voigt"]), judged("none", "cloth", ["kelvin_voigt", "wind"])
    assert summary([alone, drag])["pooled"]["false_alarm_rate"]["hits"] == 1 and not drag.first
    assert not judged("none", "bar", ["kelvin_voigt"]).first


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
    def handled(found):
        return judge(row(MAGNET, found), SIZES).in_class

    assert handled(answer("unknown", [], 0.6))
    assert handled(answer("class", [["lag"], ["gravity"]], 0.6))
    assert not handled(answer("effects", [["gravity", "lag"]], 0.6))
    assert not handled(answer("none", [], 0.6))


def test_rows_of_a_folder_replace_those_of_the_same_case_and_commit(tmp_path):
    """A case counts when it has an answer with its score or has failed."""
    own = tmp_path / "cases" / WIND.name
    (own / "truth").mkdir(parents=True)
    found = answer("effect", [["wind"]], 0.9)
    for name, record in (("truth/case", told()), ("answer", found | {"commit": "abc"}), ("oracle", oracle())):
        (own / f"{name}.json").write_text(json.dumps(record))
    (tmp_path / "cases" / LAG.name).mkdir()
    (tmp_path / "cases" / LAG.name / "failed.txt").write_text("Traceback\nRuntimeError: no convergence")
    for _ in range(2):
        known = collect([WIND, LAG, PAIR], tmp_path / "cases", tmp_path / "rows", "tracks_only", 7)
    assert [(r["verdict"], r["effect"], r["body"]) for r in known] == [
        ("effect", "wind", "slab"),
        ("failed", "lag", "bar"),
    ]
    path = rows_file(tmp_path / "rows", "tracks_only", 7)
    assert read_rows(path) == known and known[1]["failed"] == "RuntimeError: no convergence"
    put_rows(path, [known[0] | {"commit": "def"}, known[0] | {"probability": 0.5}])
    assert [(r["commit"], r["probability"]) for r in read_rows(path) if r["effect"] == "wind"] == [
        ("abc", 0.5),
        ("def", 0.9),
    ]


def test_sets_searched_by_one_commit_are_pooled(tmp_path):
    mine, theirs = (rows_file(tmp_path, "tracks_only", seed) for seed in (7, 8))
    put_rows(mine, rows())
    put_rows(theirs, [row(GapCase("wind", "high", 9), answer("effect", [["wind"]], 0.9), seed=8)])
    put_rows(theirs, [row(WIND, answer("none", [], 0.9), commit="later", seed=8)])
    commit, found = pool(tmp_path, "tracks_only")
    assert (commit, len(found)) == ("abc", 10)
    assert pool(tmp_path, "tracks_only", "lat") == ("later", [found_row for found_row in read_rows(theirs)[1:]])
    assert pool(tmp_path, "rgbd") == (None, [])
    known = [r for r in found if r["effect"] not in ("lag", "outside:magnet")]  # of made-up coefficients
    plain = [r | {"truth": {}, "coefficients": {}} for r in known]
    write_results("tracks_only", plain, tmp_path)
    record = json.loads((tmp_path / "gap_benchmark.json").read_text())["tracks_only"]
    assert (record["seeds"], record["commits"]) == ([7, 8], ["abc"])
    assert (record["pooled"]["named_first"]["hits"], record["pooled"]["named_first"]["count"]) == (2, 3)


def test_page_and_figures(tmp_path):
    judged = judged_set()
    numbers = {"seeds": [7], "commits": ["abc"], **summary(judged)}
    text = page("tracks only", numbers, judged)
    assert "| wind | high | 1 | 1 | 1 | 0.30 | 0.75 | 1 | wind (0.95) | 100 |" in text
    assert "| lag | high | 1 | 0 | 0 |" in text and "failed" in text
    assert "| right effect first, middle and high strength | 0.33 | 1 of 3 | 0.06 to 0.79 | >= 0.80 |" in text
    assert "| visible by 1 to 2 mm, any strength | 0 of 1" in text
    draw_confusion(tmp_path / "c.png", numbers["confusion_matrix"], "t")
    draw_reliability(tmp_path / "r.png", numbers["reliability"], "t")
    assert all((tmp_path / name).stat().st_size > 5000 for name in ("c.png", "r.png"))


def test_a_set_is_balanced_over_bodies_and_forms():
    cases = benchmark_cases(EFFECTS, variant="tracks_only", seed=3)
    assert len({case.name for case in cases}) == len(cases) and 95 <= len(cases) <= 115
    assert all(GapCase.named(case.name) == case for case in cases)
    strong = [case for case in cases if case.kind == "single" and case.strength != "weak"]
    of_volumes = set(EFFECTS) - {"surface_drag"}
    assert len(strong) >= 60 and {case.effect for case in strong} == of_volumes
    for name in BODIES:
        assert abs(sum(case.body == name for case in strong) - len(strong) / len(BODIES)) <= 2
        assert sum(case.body == name and case.kind == "none" for case in cases) == 4
    for effect_name in of_volumes:
        bodies = [case.body for case in strong if case.effect == effect_name]
        assert len(set(bodies)) == len(bodies)
    assert 0.35 < sum(case.form == "other" for case in strong) / len(strong) < 0.5
    counts = [sum(case.kind == kind for case in cases) for kind in ("none", "pair", "outside")]
    assert counts == [20, 10, 8]
    assert not set(benchmark_cases(EFFECTS, variant="tracks_only", seed=4)) & set(cases)
    assert not set(calibration_cases(EFFECTS, 8)) & set(cases)
    assert sum(case.kind == "none" for case in calibration_cases(EFFECTS, 8)) == 4
    assert {case.effect for case in chosen(cases, ["wind-*"])} == {"wind"}
    assert sum(case.kind == "none" for case in cases[: len(cases) // 3]) >= 5  # controls come in between


def test_a_true_model_that_cannot_be_simulated_has_closed_nothing_to_compare_with():
    for closed in (None, float("nan")):
        judged = judge(row(WIND, answer("effect", [["wind"]], 0.95), oracle(0.5, closed)), SIZES)
        assert judged.first and judged.closed_share is None


def test_wider_intervals_hold_more_true_numbers_about_the_same_values():
    """WIND's `y` is 0.3 off with a half-width of 0.1; PAIR's `x` of the payload is 0.5 off with one of 0.01."""
    own = [json.loads(json.dumps(one)) for one in rows()]
    assert [sum(covered(own, factor, SIZES)) for factor in (1.0, 2.9, 3.1, 49.0, 51.0)] == [2, 2, 3, 3, 4]
    assert covered(own, 0.0, SIZES).count(True) == 2  # those that are exact; the rows given are left as they are
    assert own == [json.loads(json.dumps(one)) for one in rows()]
