"""How right the answers of a set for development would be at other temperatures of the search.

`python -m benchmarks.gap.development benchmarks/results/gap_development_seed103.jsonl`. A row is one of `benchmarks.gap.rows`: a case,
and the answers that were fitted with their gains [nat]. Some rows also have what was learnt of the sensor. The search's numbers were
chosen on these rows, so they say nothing about other cases. An answer is right by its names and its probability; that a verdict may also
be `unknown` is left out.
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
            for a in row["candidates"]
        )
        found.append(Searched(answers, case.truth))
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


def gains_told(searched: Sequence[Searched]) -> str:
    """Lines of text: what the best wrong single effect gains on each control, and the true one where one is hidden [nat]."""
    wrong = [max(a.gain for a in own.answers if len(a.names) == 1) for own in searched if not own.truth]
    right = [own.answers[own.true].gain for own in searched if own.truth and own.true is not None]
    return "\n".join(
        f"{what}: {', '.join(f'{gain:.0f}' for gain in sorted(gains))}"
        for what, gains in (("best wrong effect on each control", wrong), ("hidden effect, where it was fitted", right))
    )


def correlations_told(rows: Path) -> str:
    """How far the learnt correlation of the sensor's noise is from the true one, in each recording, sorted; "" where no row says."""
    known = [json.loads(line) for line in rows.read_text().splitlines()]
    off = sorted(abs(c - row["unknowns"]["correlation"]) for row in known for c in row.get("correlation", ()))
    return f"learnt correlation off by: {', '.join(f'{own:.2f}' for own in off)}\n" if off else ""


def main(rows: Path) -> None:
    """Print the table, the gains and what was learnt of the sensor."""
    searched = searched_in(rows)
    print(gains_told(searched), correlations_told(rows), sep="\n")
    print("| temperature | first | in class | alarms | surprise [nat] |\n|--:|--:|--:|--:|--:|")
    for temperature in TEMPERATURES:
        print(told(searched, replace(GapSettings(), temperature=temperature)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
