"""All scored seeds in one file, and their shares pooled: `python -m benchmarks.gap.history` prints the table of the page.

`benchmarks/results/gap_history.csv` has a row per seed and observation: the commit of the search, the numbers of
`results/gap_benchmark.json` and how many cases each of them speaks of. `--add COMMIT` appends a new seed's row.
"""

import argparse
import csv
import json
from collections.abc import Sequence
from pathlib import Path

from scipy.stats import binomtest

FILE = Path(__file__).parents[1] / "results" / "gap_history.csv"
SCORE = Path("results/gap_benchmark.json")

SHARES = {
    "named_first": ("right effect first", "single_middle_and_high"),
    "named_in_class": ("right effect in the reported class", "single_middle_and_high"),
    "false_alarm_rate": ("false alarms", "none"),
    "two_effects_both": ("two hidden: both named", "pair"),
    "unknown_handled": ("outside the library: `unknown`, or the nearest", "outside"),
    "outside_confidently_wrong": ("outside the library: a confident wrong name", "outside"),
    "interval_coverage": ("90 % intervals that hold the truth", "intervals"),
}
"""Numbers that are a share: how they are called, and the count they are a share of."""

MEDIANS = ("gap_closed_vs_oracle_median", "size_error_median", "seconds_median")
COUNTS = ("single_middle_and_high", "none", "pair", "outside", "gap_closed", "intervals", "failed", "not_run")
NUMBERS = tuple(SHARES) + MEDIANS


def read_history(path: Path = FILE) -> list[dict[str, str]]:
    """The rows, values as text; an empty one where no case speaks of a number."""
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def add_row(commit: str, observation: str, score: Path = SCORE, path: Path = FILE) -> None:
    """Appends the numbers of `score` to the history.

    Args:
        commit: of the search that gave the answers.
        observation: `tracks_only` or `rgbd`.
        score: `gap_benchmark.json`, as `python -m benchmarks.gap --score` writes it.
        path: the history.

    Raises:
        ValueError: the history has a row of this seed, observation and commit.
    """
    rows, numbers = read_history(path), json.loads(score.read_text())[observation]
    row = {"seed": numbers["seed"], "commit": commit, "observation": observation, "part": "set"}
    if any(all(old[key] == str(row[key]) for key in ("seed", "commit", "observation")) for old in rows):
        raise ValueError(f"{path} has a row of seed {row['seed']}, {observation}, {commit} already")
    row |= {key: "" if numbers[key] is None else f"{numbers[key]:.4g}" for key in NUMBERS}
    row |= {key: numbers["counts"][key] for key in COUNTS}
    with path.open("a", newline="") as file:
        csv.DictWriter(file, fieldnames=list(rows[0]), lineterminator="\n").writerow(row)


def pooled(rows: Sequence[dict[str, str]], number: str) -> tuple[int, int]:
    """How many of how many cases (or intervals) of all `rows` together."""
    count = SHARES[number][1]
    known = [(round(float(row[number]) * int(row[count])), int(row[count])) for row in rows if row[number]]
    return sum(hits for hits, _ in known), sum(total for _, total in known)


def pooled_line(rows: Sequence[dict[str, str]], number: str) -> str:
    """A row of the table: share, count, 95 % interval (Wilson 1927)."""
    hits, total = pooled(rows, number)
    low, high = binomtest(hits, total).proportion_ci(0.95, method="wilson")
    return f"| {SHARES[number][0]} | {hits} of {total} | {hits / total:.2f} | {low:.2f} to {high:.2f} |"


def pooled_table(observation: str, since: int, rows: Sequence[dict[str, str]] | None = None) -> str:
    """Markdown of the shares over all seeds from `since` on; rows of hand-picked cases (`part` is `chosen`) are left out."""
    rows = [
        row
        for row in (read_history() if rows is None else rows)
        if row["observation"] == observation and int(row["seed"]) >= since and row["part"] != "chosen"
    ]
    lines = [pooled_line(rows, number) for number in SHARES if pooled(rows, number)[1]]
    seeds = ", ".join(row["seed"] + (" (pairs)" if row["part"] == "pairs" else "") for row in rows)
    return "\n".join([f"| seeds {seeds} | count | share | 95 % interval |", "|---|--:|--:|--:|", *lines])


def main() -> None:
    """The command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gap.history", description=__doc__)
    parser.add_argument("--since", type=int, default=4, help="first seed that is pooled")
    parser.add_argument("--add", metavar="COMMIT", help="append the score in results/ instead, of this commit's search")
    parser.add_argument("--observation", choices=("tracks_only", "rgbd"), default="tracks_only", help="of the score")
    parsed = parser.parse_args()
    if parsed.add:
        add_row(parsed.add, parsed.observation)
        return
    for observation in ("tracks_only", "rgbd"):
        print(pooled_table(observation, parsed.since), end="\n\n")


if __name__ == "__main__":
    main()
