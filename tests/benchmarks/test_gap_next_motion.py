"""The benchmark of the next motion: what is drawn, what counts, and that it goes on where it was stopped."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from benchmarks.gap import next_motion
from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.next_motion import NextMotionRun, drawn, is_first, rows, table
from physreal_core.gap import GapSettings

CASE = GapCase("linear_drag", "high", 12)
NAMES = ("lift_swing", "drop_catch", "drag_stop")


def motion(name: str) -> dict:
    path = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.1]]
    return {
        "name": name,
        "information": 0.3,
        "rough": False,
        "entropy": 0.69,
        "recording": 0,
        "fps": 30.0,
        "path": path,
    }


def report(kind: str, members: list[list[str]], motions: tuple[str, ...] = ()) -> dict:
    verdict = {"kind": kind, "names": members[0], "members": members, "probability": 0.9}
    return {"verdict": verdict, "next_motions": [motion(name) for name in motions]}


FIRST = report("class", [["quadratic_drag"], ["linear_drag"]], NAMES)


@pytest.fixture
def run(tmp_path, monkeypatch) -> tuple[NextMotionRun, list[str]]:
    """A run whose searches answer at once: a class at first, then the truth for the best motion alone."""
    searched = []

    def find(experiments, settings, tell):
        names = experiments[0].split()
        searched.append(experiments[0])
        found = (
            FIRST if len(names) == 1 else report("effect", [["linear_drag" if f"next_{NAMES[0]}" in names else "wind"]])
        )
        return SimpleNamespace(as_record=lambda: found)

    def film(case, own, chosen, arm):
        write_json(arm / "motion.json", chosen)
        for name in ("lift_swing", f"next_{chosen['name']}"):
            (arm / "captures" / name).mkdir(parents=True)

    monkeypatch.setattr(
        next_motion, "_capture", lambda case, folder, count: (folder / "lift_swing").mkdir(parents=True)
    )
    monkeypatch.setattr(next_motion, "_film", film)
    monkeypatch.setattr(
        next_motion, "problems_of", lambda folder, cut: {"all": " ".join(sorted(p.name for p in folder.iterdir()))}
    )
    monkeypatch.setattr(next_motion, "baseline_model", lambda problem: None)
    monkeypatch.setattr(next_motion, "Experiment", lambda problem, model, device: problem)
    monkeypatch.setattr(next_motion, "find_gap", find)
    return NextMotionRun(tmp_path, GapSettings()), searched


def test_both_motions_are_filmed_searched_and_scored_once(run):
    how, searched = run
    how.case(CASE)
    how.case(CASE)
    assert len(searched) == 3
    chosen, random = rows(how.folder)
    assert chosen["motion"] == NAMES[0] and chosen["right_first"] and not chosen["first_before"]
    assert random["motion"] == drawn({"report": FIRST}, "random", CASE.seed)["name"]
    assert chosen["truth_in_class"] and random["right_first"] is (random["motion"] == NAMES[0])
    assert "| chosen motion | 1 | 0 | 1 | 1.00 |" in table([chosen, random])


def test_a_case_that_is_no_class_is_not_searched_again(run, monkeypatch):
    how, searched = run
    monkeypatch.setattr(next_motion, "find_gap", lambda *given: SimpleNamespace(as_record=lambda: report("none", [[]])))
    how.case(CASE)
    assert not searched and rows(how.folder) == [] and (how.folder / CASE.name / "first.json").is_file()


def test_an_earlier_answer_with_motions_serves(run, tmp_path):
    _, searched = run
    earlier = tmp_path / "earlier"
    (earlier / CASE.name / "captures" / "lift_swing").mkdir(parents=True)
    write_json(earlier / CASE.name / "answer.json", {"report": FIRST, "seconds_naming": 60.0})
    NextMotionRun(tmp_path / "out", GapSettings(), answered=earlier).case(CASE)
    assert len(searched) == 2 and read_json(tmp_path / "out" / CASE.name / "first.json")["seconds"] == 60.0


def test_films_alone_are_made_where_no_search_shall_follow(run, tmp_path):
    how, searched = run
    replace(how, films_only=True).case(CASE)
    assert len(searched) == 1 and rows(how.folder) == []
    assert all((how.folder / CASE.name / arm / "captures").is_dir() for arm in ("chosen", "random"))


def test_the_draw_is_fixed_by_the_seed_and_fair():
    names = [drawn({"report": FIRST}, "random", seed)["name"] for seed in range(300)]
    assert all(80 < names.count(name) < 120 for name in NAMES)
    turned = {"report": {**FIRST, "next_motions": FIRST["next_motions"][::-1]}}
    assert names == [drawn(turned, "random", seed)["name"] for seed in range(300)]
    assert drawn({"report": FIRST}, "chosen", 5)["name"] == NAMES[0]


@pytest.mark.parametrize(("kind", "names", "right"), [
    ("effect", ["linear_drag"], True), ("class", ["linear_drag"], True), ("unknown", ["linear_drag"], False),
    ("effect", ["wind"], False), ("effects", ["linear_drag", "wind"], False),
])  # fmt: skip
def test_only_the_whole_truth_is_right(kind, names, right):
    assert is_first(CASE, report(kind, [names])["verdict"]) is right
