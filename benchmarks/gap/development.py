"""How right the answers of a set for development would be at other temperatures of the search.

`python -m benchmarks.gap.development benchmarks/results/gap_development_seed102.jsonl`. A row has a case, the answers that were fitted
with their gains [nat], and what was off. The search's numbers were chosen on these rows, so they say nothing about other cases.
"""

import json
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from benchmarks.gap.calibration import TEMPERATURES, Gained, Searched, chances, surprise
from benchmarks.gap.cases import GapCase
from physreal_core.effects import EFFECTS
from physreal_core.gap import GapSettings


def searched_in(rows: Path) -> list[Searched]:
    """The searches of a file of rows."""
    found = []
    for line in rows.read_text().splitlines():
        row = json.loads(line)
        case = GapCase.named(row["case"])
        answers = tuple(
            Gained(tuple(sorted(a["names"])), a["gain"], -np.inf if a["held_out"] is None else a["held_out"])
            for a in row["answers"]
        )
        names = [answer.names for answer in answers]
        found.append(Searched(answers, names.index(case.truth) if case.truth in names else None, case.truth))
    return found


def told(searched: Sequence[Searched], settings: GapSettings) -> str:
    """A line of a table at a temperature: right first, in the class, alarms, surprise."""
    first = in_class = alarms = 0
    for own in searched:
        given = chances(own.answers, settings, len(EFFECTS))
        order = np.argsort(-given)
        best = own.answers[order[0]].names
        members = [
            own.answers[n].names
            for n in order[: settings.class_size]
            if given[n] >= settings.class_ratio * given[order[0]]
        ]
        alarms += not own.truth and bool(best)
        first += bool(own.truth) and best == own.truth
        in_class += bool(own.truth) and bool(best) and own.truth in members
    hidden = sum(bool(own.truth) for own in searched)
    lost = surprise(searched, settings, len(EFFECTS))
    return (
        f"| {settings.temperature:g} | {first} of {hidden} | {in_class} of {hidden} "
        f"| {alarms} of {len(searched) - hidden} | {lost:.2f} |"
    )


def main(rows: Path) -> None:
    """Print the table."""
    searched = searched_in(rows)
    print("| temperature | first | in class | alarms | surprise [nat] |\n|--:|--:|--:|--:|--:|")
    for temperature in TEMPERATURES:
        print(told(searched, replace(GapSettings(), temperature=temperature)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
