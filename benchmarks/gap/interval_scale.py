"""How much wider than the posterior's curvature says intervals must be to hold nine of ten true numbers, from answers that are kept.

`python -m benchmarks.gap.interval_scale [ROWS.jsonl ...]`, by default all sets of tracks alone. The rows of sets that were searched by
a commit with another `GapSettings.interval_scale` hold intervals that are wider already: the factor is on what stands in the rows.
"""

import copy
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

from benchmarks.gap.rows import Row, read_rows
from benchmarks.gap.scoring import Sizes, judge, sizes_of
from physreal_core.effects import EFFECTS

ROWS = Path(__file__).parents[1] / "results" / "gap"
FACTORS = (1.0, 1.5, 1.75, 2.0, 2.2, 2.5, 3.0, 4.0)


def covered(rows: Iterable[Row], factor: float, sizes: dict[str, Sizes]) -> list[bool]:
    """Whether each interval of rightly named effects holds the true number, were it `factor` times as wide about the found one."""
    return [hit for row in rows for hit in judge(_widened(row, factor), sizes).covered]


def _widened(row: Row, factor: float) -> Row:
    row = copy.deepcopy(row)
    for coefficients in (row.get("coefficients") or {}).values():
        for name, (value, (low, high)) in coefficients.items():
            coefficients[name] = [value, [value - factor * (value - low), value + factor * (high - value)]]
    return row


def main(files: Sequence[Path]) -> None:
    """Prints the shares, a line each factor, of each file and of all."""
    sizes = {name: sizes_of(effect.coefficients) for name, effect in EFFECTS.items()}
    sets = {file.stem: list(read_rows(file)) for file in files}
    print("| factor |", " | ".join([*sets, "all"]), "|")
    for factor in FACTORS:
        hits = [covered(rows, factor, sizes) for rows in sets.values()]
        hits.append([hit for own in hits for hit in own])
        print(f"| {factor:g} |", " | ".join(f"{sum(own)} of {len(own)}" for own in hits), "|")


if __name__ == "__main__":
    main([Path(given) for given in sys.argv[1:]] or sorted(ROWS.glob("tracks_only-*.jsonl")))
