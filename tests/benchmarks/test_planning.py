"""Cases of the benchmark of plans, and its page."""

import json

import numpy as np
import pytest

from benchmarks.planning import report
from benchmarks.planning.cases import Case
from benchmarks.planning.scenes import FRAMES, SETTINGS
from physreal_core.errors import InputError


def test_a_case_is_told_by_body_goal_kind_and_seed() -> None:
    case = Case.of("rope:laid_along_a_curve:mask:7")
    assert (case.body, case.goal, case.kind, case.seed) == ("rope", "laid along a curve", "mask", 7)
    assert case.task == "rope:laid_along_a_curve:mask"
    assert Case.of("plush:held_up:points").seed == 0


@pytest.mark.parametrize("text", ["plush", "plush:folded:points", "plush:held_up:words", "plush:held_up:points:x"])
def test_what_is_no_case_is_refused_with_those_that_are(text: str) -> None:
    with pytest.raises(InputError, match=r"plush:held_up, .*cloth:folded, then one of points"):
        Case.of(text)


@pytest.mark.parametrize(("body", "goal"), [(body, goal) for body, own in SETTINGS.items() for goal in own.goals])
def test_hidden_ways_of_other_seeds_differ_repeat_and_stay_within_the_hands_bounds(body: str, goal: str) -> None:
    setting = SETTINGS[body]
    times = np.arange(FRAMES + 1) / setting.scene().fps
    ways = [setting.way(goal, seed).displacement(times) for seed in range(20)]
    np.testing.assert_array_equal(ways[0], setting.goals[goal].displacement(times))
    np.testing.assert_array_equal(ways[7], setting.way(goal, 7).displacement(times))
    ends = np.array([way[-1] for way in ways])
    assert np.linalg.norm(ends[:, None] - ends, axis=2)[np.triu_indices(20, 1)].min() > 1e-4
    for way in ways[1:]:
        assert (way >= setting.lower).all() and (way <= setting.upper).all()
        # As high above the table at the end, in proportion, as the way that was written by hand.
        assert 0.7 <= np.ptp(way[:, 2]) / np.ptp(ways[0][:, 2]) <= 1.3


def _row(seed: int, manner: str, error: float) -> dict:
    lengths = {"start": 0.1, "point_error": error, "chamfer": error / 2, "apart_end": 0.002}
    return {
        "case": "plush:held_up:points",
        "seed": seed,
        "manner": manner,
        **lengths,
        "seconds": 10.0 + seed,
        "rollouts": 500,
        "machine": "CPU",
        "threads": 2,
    }


def test_the_page_counts_successes_and_compares_manners_case_by_case(tmp_path, monkeypatch, capsys) -> None:
    monkeypatch.setattr(report, "RESULTS", tmp_path)
    monkeypatch.setattr("benchmarks.use.RESULTS", tmp_path)
    rows = [_row(seed, "once", error) for seed, error in enumerate((0.002, 0.008, 0.030))]
    rows += [_row(seed, "drawn", error) for seed, error in enumerate((0.004, 0.006, 0.031))]
    rows += [{"case": "plush:held_up:points", "seed": 0, "manner": "hidden", "point_error": 0.0031}]
    report.write_page(rows)
    page = (tmp_path / "planning.md").read_text()
    assert "| plush, held up | 100 points to places | planned once | 1 of 3 | 2 of 3 (0.21 to 0.94) | 2 of 3 |" in page
    assert "100.0 → 8.0 | 30.0 | 3.1 |" in page and "| 11 | 500 | CPU, threads: 2 |" in page
    assert "planned once, by drawing alone: nearer than planned once in 1 of 3 cases" in page
    assert "Not measured: plush, laid aside; rope, laid along a curve; cloth, folded; goals told as a shape" in page
    assert [json.loads(line) for line in (tmp_path / "planning.jsonl").read_text().splitlines()] == rows
    used = json.loads((tmp_path / "use.json").read_text())["plan"]["plush:held_up:points, planned once"]
    assert used == {"success": pytest.approx(2 / 3), "point_error": 0.008, "seconds": 11.0, "seeds": 3}
