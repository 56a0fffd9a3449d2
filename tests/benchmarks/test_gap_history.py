"""The history of scored seeds: pooled shares by hand, a row appended, and the tables of the page."""

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.gap.history import (
    COUNTS,
    FILE,
    NUMBERS,
    SHARES,
    add_row,
    pooled,
    pooled_line,
    pooled_table,
    read_history,
)

ROOT = Path(__file__).resolve().parents[2]


def row(**values):
    return {**{key: "" for key in NUMBERS}, **{key: "0" for key in COUNTS}, **values}


def test_pooled_share_with_wilsons_interval():
    rows = [
        row(named_first="0.75", single_middle_and_high="4"),
        row(named_first="0.5", single_middle_and_high="6"),
        row(),
    ]
    assert pooled(rows, "named_first") == (6, 10)
    # (p + z^2/2n -+ z sqrt(p(1-p)/n + z^2/4n^2)) / (1 + z^2/n), p = 0.6, n = 10, z = 1.96
    assert pooled_line(rows, "named_first") == "| right effect first | 6 of 10 | 0.60 | 0.31 to 0.83 |"


def test_every_share_in_the_file_is_a_count():
    for entry in read_history():
        for number, (_, count) in SHARES.items():
            if entry[number]:
                hits = float(entry[number]) * int(entry[count])
                assert abs(hits - round(hits)) < 0.02, (entry["seed"], number)


def test_a_scored_seed_is_appended_once(tmp_path):
    path, score = tmp_path / "history.csv", tmp_path / "score.json"
    shutil.copy(FILE, path)
    numbers = {"seed": 99, **dict.fromkeys(NUMBERS, 0.5), "unknown_handled": None, "counts": dict.fromkeys(COUNTS, 2)}
    score.write_text(json.dumps({"tracks_only": numbers}))
    add_row("abc1234", "tracks_only", score, path)
    last = read_history(path)[-1]
    assert (last["seed"], last["part"], last["named_first"], last["unknown_handled"]) == ("99", "set", "0.5", "")
    with pytest.raises(ValueError, match="seed 99"):
        add_row("abc1234", "tracks_only", score, path)


@pytest.mark.parametrize("observation", ["tracks_only", "rgbd"])
def test_the_page_shows_what_the_command_prints(observation):
    page = (ROOT / "docs" / "gap_benchmark.md").read_text()
    assert pooled_table(observation, since=4) in page, "run: python -m benchmarks.gap.history"
