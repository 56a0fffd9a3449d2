"""The table of a set for development, and what the pages say of it."""

from pathlib import Path

from benchmarks.gap.development import searched_in, told
from physreal_core.gap import GapSettings

RESULTS = Path(__file__).parents[2] / "benchmarks/results"
ROWS, FEW = RESULTS / "gap_development_seed102.jsonl", RESULTS / "gap_development_seed102_again.jsonl"
PAGE = Path(__file__).parents[2] / "docs/gap_benchmark.md"


def test_the_page_says_what_the_rows_give_at_the_searchs_temperature():
    line = told(searched_in(FEW), GapSettings())
    assert line.startswith("| 20 | 3 of 3 | 3 of 3 | 0 of 5 |")
    page = " ".join(PAGE.read_text().split())
    assert "temperature of 20" in page and "first in 3 of 3, with no alarm in 5 controls" in page


def test_a_truth_that_was_not_fitted_is_never_right():
    (own,) = [searched for searched in searched_in(ROWS) if searched.truth == ("soft_spot",)]
    assert own.true is None
    assert told([own], GapSettings()).startswith("| 20 | 0 of 1 | 0 of 1 | 0 of 0 |")
