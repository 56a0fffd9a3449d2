"""The table of a set for development, and what the pages say of it."""

from dataclasses import replace
from pathlib import Path

from benchmarks.gap.development import searched_in, told
from physreal_core.gap import GapSettings

RESULTS = Path(__file__).parents[2] / "benchmarks/results"
ROWS, FEW = RESULTS / "gap_development_seed102.jsonl", RESULTS / "gap_development_seed102_again.jsonl"
UNSEEN = RESULTS / "gap_development_seed103.jsonl"
PAGE = Path(__file__).parents[2] / "docs/gap_benchmark.md"


def test_the_page_says_what_the_rows_give_at_the_searchs_temperature():
    line = told(searched_in(FEW), GapSettings())
    assert line.startswith("| 20 | 3 of 3 | 3 of 3 | 0 of 5 |")
    page = " ".join(PAGE.read_text().split())
    assert "temperature of 20" in page and "first in 3 of 3, with no alarm in 5 controls" in page


def test_the_page_says_how_the_search_did_on_cases_that_it_had_not_seen():
    searched = searched_in(UNSEEN)
    assert told(searched, GapSettings()).startswith("| 20 | 8 of 18 | 9 of 18 | 5 of 12 |")
    assert told(searched, replace(GapSettings(), temperature=60.0)).startswith("| 60 | 9 of 18 | 13 of 18 | 2 of 12 |")
    page = " ".join(PAGE.read_text().split())
    assert "first in 8 of 18" in page and "5 of 12 controls are alarms" in page
    assert (
        "At 60 the right effect is first in 9 of 18 and in the class in 13 of 18, with 2 alarms in 12 controls" in page
    )


def test_a_truth_that_was_not_fitted_is_never_right():
    (own,) = [searched for searched in searched_in(ROWS) if searched.truth == ("soft_spot",)]
    assert own.true is None
    assert told([own], GapSettings()).startswith("| 20 | 0 of 1 | 0 of 1 | 0 of 0 |")
