"""The table of a set for development, and what the pages say of it."""

from dataclasses import replace
from pathlib import Path

import pytest

from benchmarks.gap.development import searched_in, told
from benchmarks.gap.results import pool
from benchmarks.gap.rows import read_rows
from benchmarks.gap.scoring import judge, sizes_of
from benchmarks.gap.summary import summary
from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings

RESULTS = Path(__file__).parents[2] / "benchmarks/results"
ROWS, FEW = RESULTS / "gap_development_seed102.jsonl", RESULTS / "gap_development_seed102_again.jsonl"
PAGE = Path(__file__).parents[2] / "docs/gap_benchmark.md"


def line(rows: Path, temperature: float) -> str:
    return told(searched_in(rows), replace(GapSettings(), temperature=temperature))


def test_the_page_says_what_few_chosen_cases_gave():
    assert line(FEW, 20.0).startswith("| 20 | 3 of 3 | 3 of 3 | 0 of 5 |")
    page = " ".join(PAGE.read_text().split())
    assert "At a temperature of 20 the right effect is first in 3 of 3, with no alarm in 5 controls" in page


@pytest.mark.parametrize(
    ("name", "temperature", "counts"),
    [
        ("103", 20.0, "8 of 18 | 9 of 18 | 5 of 12"),
        ("103_plane", 20.0, "8 of 17 | 9 of 17 | 5 of 12"),
        ("103_lain", 60.0, "9 of 20 | 12 of 20 | 0 of 12"),
        ("103_sizes", 60.0, "10 of 18 | 12 of 18 | 0 of 4"),
        ("103_elements", 50.0, "6 of 10 | 9 of 10 | 1 of 9"),
        ("103_laws", 50.0, "2 of 3 | 2 of 3 | 1 of 13"),
        ("105_missed", 30.0, "4 of 17 | 10 of 17 | 0 of 7"),
        ("120", 35.0, "7 of 10 | 7 of 10 | 2 of 17"),
    ],
)
def test_the_page_says_how_often_the_search_was_right_each_time(name, temperature, counts):
    rows = RESULTS / f"gap_development_seed{name}.jsonl"
    assert line(rows, temperature).startswith(f"| {temperature:g} | {counts} |")
    (own,) = [text for text in PAGE.read_text().splitlines() if f"({'../benchmarks/results/' + rows.name})" in text]
    assert f"temperature {temperature:g}" in own and f"| {counts} |" in own


def summary_of(variant: str, commit: str) -> dict:
    _, rows = pool(RESULTS / "gap", variant, commit)
    sizes = {name: sizes_of(effect.coefficients) for name, effect in EFFECTS.items()}
    return summary([judge(row, sizes) for row in rows])


COLUMNS = {
    "first": "named_first",
    "in class": "named_in_class",
    "first, half the gap closed": "joint",
    "alarms": "false_alarm_rate",
    "intervals that hold": "interval_coverage",
    "both of two": "two_effects_both",
}
TRACKS = tuple(COLUMNS)[:5]
OUTSIDE = "outside: handled, confidently wrong"


def cells_of(commit: str) -> dict[str, str]:
    """The cells of a set in the page's tables of blind sets, by the heads of their columns."""
    head: list[str] = []
    for line in PAGE.read_text().splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if cells[:2] == ["seed", "commit"]:
            head = cells
        elif len(cells) == len(head) and cells[1] == commit:
            return dict(zip(head, cells, strict=True))
    raise AssertionError(f"no line of {commit}")


@pytest.mark.parametrize(
    ("variant", "commit", "keys"),
    [
        ("tracks_only", "85d34fb", TRACKS),
        ("tracks_only", "cdf2f37", TRACKS),
        ("tracks_only", "9beed61", (*TRACKS, "both of two", OUTSIDE)),
        ("tracks_only", "d9a2cea", (*TRACKS, "both of two")),
        ("tracks_only", "bf623fb", (*TRACKS, "both of two", OUTSIDE)),
        ("tracks_only", "59d2d58", (*TRACKS, "both of two")),
        ("tracks_only", "329a431", (*TRACKS, "both of two", OUTSIDE)),
        ("tracks_only", "06a84a3", (*TRACKS, "both of two")),
        ("rgbd", "31c929a", (*TRACKS[:2], TRACKS[3])),
        ("rgbd", "d53d56a", (*TRACKS[:2], TRACKS[3])),
        ("rgbd", "a2b509d", TRACKS),
    ],
)
def test_the_page_says_what_the_blind_sets_gave(variant, commit, keys):
    found, cells = summary_of(variant, commit)["pooled"], cells_of(commit)
    count = lambda key: f"{found[key]['hits']} of {found[key]['count']}"
    for key in keys:
        expected = (
            [count("unknown_handled"), count("outside_confidently_wrong")] if key == OUTSIDE else [count(COLUMNS[key])]
        )
        assert cells[key] == ", ".join(expected), key


@pytest.mark.parametrize(
    ("variant", "commit", "keys"),
    [("tracks_only", "06a84a3", tuple(COLUMNS.values())[:5]), ("rgbd", "a2b509d", ("named_first", "false_alarm_rate"))],
)
def test_the_page_says_how_sure_the_last_sets_are(variant, commit, keys):
    found, page = summary_of(variant, commit)["pooled"], " ".join(PAGE.read_text().split())
    for own in (found[key] for key in keys):
        lower, upper = own["interval"]
        assert f"{own['share']:.2f} ({lower:.2f} to {upper:.2f})" in page


def test_the_readme_says_what_the_blind_sets_gave():
    found, *older = (
        summary_of("tracks_only", commit)["pooled"]
        for commit in ("06a84a3", "329a431", "59d2d58", "bf623fb", "d9a2cea")
    )
    first, named, alarms = (found[key] for key in ("named_first", "named_in_class", "false_alarm_rate"))
    readme = " ".join((PAGE.parents[1] / "README.md").read_text().split())
    lower, upper = first["interval"]
    assert (
        f"the right effect came first in {first['hits']} of {first['count']} ({first['share']:.2f}, {lower:.2f} to {upper:.2f}) and among the named ones "
        f"in {named['hits']}; {alarms['hits']} of {alarms['count']} controls were false alarms" in readme
    )
    counts = {
        key: [sum(own[key][number] for own in older) for number in ("hits", "count")]
        for key in ("named_first", "false_alarm_rate")
    }
    (first, of), (alarms, controls) = counts.values()
    assert f"The states before it had {first} of {of} in four sets and {alarms} alarms in {controls} controls" in readme
    before = [
        summary_of("tracks_only", commit)["pooled"]["named_first"] for commit in ("85d34fb", "cdf2f37", "9beed61")
    ]
    hits, count = (sum(own[key] for own in before) for key in ("hits", "count"))
    assert f"three earlier states of the search had {hits} of {count}" in readme
    video = summary_of("rgbd", "a2b509d")["pooled"]
    told = {key: f"{video[key]['hits']} of {video[key]['count']}" for key in ("named_first", "false_alarm_rate")}
    assert (
        f"From RGB-D it was first in {told['named_first']}, and {told['false_alarm_rate']} controls were alarms"
        in readme
    )
    rope = summary_of("thin", "3d1ffcb")["by_body"]["rope"]["named_first"]
    assert f"Of a rope it came first in {rope['hits']} of {rope['count']}" in readme
    cloth = {key: summary_of("thin", "781c662651c2")["pooled"][key] for key in ("named_first", "false_alarm_rate")}
    first, alarms = cloth["named_first"], cloth["false_alarm_rate"]
    assert f"of a cloth in {first['hits']} of {first['count']}, with {alarms['hits']} alarms in six" in readme


def test_the_page_says_how_often_an_adopted_verdict_is_right():
    named = [
        (bool(row["adopted"]), sorted(row["names"]) == sorted(row["truth"]))
        for file in (
            "tracks_only-seed105",
            "tracks_only-seed106",
            "tracks_only-seed110",
            "tracks_only-seed111",
            "tracks_only-seed113",
            "tracks_only-seed114",
            "tracks_only-seed115",
            "tracks_only-seed116",
            "tracks_only-seed117",
            "thin-seed207",
            "thin-seed208",
            "rgbd-seed109",
            "rgbd-seed112",
            "rgbd-seed115",
        )
        for row in read_rows(RESULTS / "gap" / f"{file}.jsonl")
        if row["verdict"] in ("effect", "effects")
    ]
    kept, refused = ([right for adopted, right in named if adopted is kind] for kind in (True, False))
    page = " ".join((PAGE.parent / "missing_effect.md").read_text().split())
    assert (
        f"{len(kept)} of the verdicts that name an effect were adopted, {sum(kept)} of them right; "
        f"{len(refused)} were not adopted, {sum(refused)} of them right." in page
    )


def test_the_page_says_what_the_controls_gave():
    assert line(RESULTS / "gap_development_seed103_controls.jsonl", 50.0).startswith(
        "| 50 | 0 of 0 | 0 of 0 | 1 of 18 |"
    )
    assert "| 1 of 18 | [rows](../benchmarks/results/gap_development_seed103_controls.jsonl) |" in PAGE.read_text()


def test_a_truth_that_was_not_fitted_is_never_right():
    (own,) = [searched for searched in searched_in(ROWS) if searched.truth == ("soft_spot",)]
    assert own.true is None
    settings = GapSettings()
    assert told([own], settings).startswith(f"| {settings.temperature:g} | 0 of 1 | 0 of 1 | 0 of 0 |")
