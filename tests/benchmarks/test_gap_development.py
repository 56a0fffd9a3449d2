"""The table of a set for development, and what the pages say of it."""

from pathlib import Path

from benchmarks.gap.development import searched_in, told
from physreal_core.gap import GapSettings

ROWS = Path(__file__).parents[2] / "benchmarks/results/gap_development_seed102.jsonl"
PAGE = Path(__file__).parents[2] / "docs/gap_benchmark.md"


def test_the_page_says_what_the_rows_give_at_the_searchs_temperature():
    line = told(searched_in(ROWS), GapSettings())
    assert line.startswith("| 60 | 12 of 16 | 14 of 16 | 1 of 15 |")
    page = " ".join(PAGE.read_text().split())
    assert "first in 12 of 16 and in the class in 14 of 16, with one alarm in 15 controls" in page


def test_a_truth_that_was_not_fitted_is_never_right():
    (own,) = [searched for searched in searched_in(ROWS) if searched.truth == ("soft_spot",)]
    assert own.true is None
    assert told([own], GapSettings()).startswith("| 60 | 0 of 1 | 0 of 1 | 0 of 0 |")
