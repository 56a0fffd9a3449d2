"""What find_gap and add_effect found, in sentences and tables: for the terminal, the report and the tables of results."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.table import Table

if TYPE_CHECKING:  # the core is heavy for those who only ask what can be done
    from physreal_core.gap.report import Added, Candidate, Disagreement, FittedEffect, GapReport, Verdict

SHOWN_ANSWERS = 8
SHOWN_MOTIONS = 4

NOT_SEARCHED = "not_searched"
TO_ASK = "`find_gap: {search: true}` under the sequence in params.yaml asks."


@dataclass(frozen=True)
class GapSummary:
    """What is missing in one sequence's model.

    Attributes:
        gap, after: what find_gap answered, and what add_effect made of it.
        interactions: the sequence and its companion.
    """

    gap: GapReport
    after: Added
    interactions: tuple[str, ...]

    @classmethod
    def read(cls, found: Path, added: Path, interactions: tuple[str, ...]) -> GapSummary:
        """From the folders of find_gap and add_effect."""
        from pipeline.products.gap import load_added, load_gap

        return cls(load_gap(found), load_added(added), interactions)

    @property
    def verdict(self) -> Verdict:
        return self.gap.verdict

    @property
    def sentences(self) -> list[str]:
        """Where, what, what became of it, and what to film next."""
        compared = zip(self.interactions, self.gap.where, strict=True) if self.gap.where else ()
        where = [f"{name}: {w['sentence']}" for name, w in compared]
        what_next = self.verdict.next_motion
        absent = self.gap.settings.get("left_out", {})
        left_out = (
            [f"Not tried: {'; '.join(f'{name}, for {reason}' for name, reason in absent.items())}."] if absent else []
        )
        following = [f"Next: {what_next}."] if what_next else []
        if self.verdict.kind == NOT_SEARCHED:
            return [*where, f"{self.verdict.sentence} {TO_ASK}" if where else self.verdict.sentence]
        return [*where, self.verdict.sentence, *left_out, self._adopted(), *following]

    def _adopted(self) -> str:
        if self.after.adopted:
            names = " and ".join(effect.name for effect in self.after.effects)
            if not math.isfinite(self.after.closed):
                return (
                    f"In the model from now on: {names}; without it, the model cannot be simulated on held-out frames."
                )
            on_other = self.closed_on_other_motion
            further = "" if on_other is None else f", of the gap on the motion that the fit never saw {on_other:.0%}"
            return f"In the model from now on: {names}; of the held-out gap it closes {self.after.closed:.0%}{further}."
        if not all(math.isfinite(entry.rms) for entry in self.after.after):
            return "Not adopted: with it, the model cannot be simulated on frames that the fit never saw."
        if self.after.after:
            return "Not adopted: on frames that the fit never saw, the gap does not shrink, so what is named is probably not what is missing."
        return "The model stays as it was."

    @property
    def closed_on_other_motion(self) -> float | None:
        """Share of the gap that the effect closes in the interaction that the compared models were not fitted to, beyond the
        noise floor; None where there is none, nothing was adopted or a model cannot be simulated there."""
        if not self.after.adopted or not math.isfinite(self.after.closed):
            return None
        before, after = (self._gap_elsewhere(found) for found in (self.after.before, self.after.after))
        return 1.0 - after / before if before else None

    @property
    def closed(self) -> str:
        """Share of the held-out gap that the effect closes, for a cell of a table."""
        if not self.after.adopted:
            return "not adopted" if self.after.after else ""
        return f"{self.after.closed:.0%}" if math.isfinite(self.after.closed) else "only with it can it be simulated"

    def _gap_elsewhere(self, entries: tuple[Disagreement, ...]) -> float:
        """Mean square distance beyond the noise floor [m2], over the interactions that were not fitted."""
        other = [entry for entry in entries if entry.interaction != self.after.fitted_on]
        return sum(max(entry.rms**2 - entry.floor**2, 0.0) for entry in other)

    def tables(self) -> list[Table]:
        """The answers, the gap before and after, and motions that would tell look-alikes apart."""
        answers = [] if self.verdict.kind == NOT_SEARCHED else [self._answers()]
        return [*answers, self._before_after(), *([self._motions()] if self.gap.next_motions else [])]

    def _answers(self) -> Table:
        fitted = [candidate for candidate in self.gap.candidates if candidate.gain is not None]
        rows = [
            [_name(c), f"{c.probability:.0%}", f"{c.gain:.1f}", f"{c.held_out:.1f}", _sizes(c.effects)]
            for c in fitted[:SHOWN_ANSWERS]
        ]
        caption = "Answers that were fitted, the most probable first; gains over no effect."
        return Table(caption, ["answer", "probability", "training [nat]", "held out [nat]", "size"], rows)

    def _before_after(self) -> Table:
        names = ("before", "after", "runner_up")
        entries = {name: _by_interval(getattr(self.after, name)) for name in names}
        rows = [
            [
                self.interactions[interaction],
                interval.replace("_", " "),
                *(_cell(entries[name].get((interaction, interval))) for name in names),
                _millimetres(before.floor),
                _millimetres(_get(self.after.numerical_floor, interaction)),
            ]
            for (interaction, interval), before in entries["before"].items()
        ]
        rival = " + ".join(self.after.runner_up_names) or "none fitted"
        caption = f"Root mean square distance of the tracks, and in units of sensor noise; runner-up: {rival}."
        headings = ["interaction", "frames", "before [mm]", "after [mm]", "runner-up [mm]"]
        return Table(caption, [*headings, "sensor floor [mm]", "numerical floor [mm]"], rows)

    def _motions(self) -> Table:
        shown = self.gap.next_motions[:SHOWN_MOTIONS]
        rows = [[m.words, f"{'about ' if m.rough else ''}{m.information:.2f}"] for m in shown]
        caption = f"Motions to film next; there are {shown[0].entropy:.2f} nat to know about which answer is right."
        return Table(caption, ["motion", "expected information [nat]"], rows)


def _by_interval(disagreements: tuple[Disagreement, ...]) -> dict[tuple[int, str], Disagreement]:
    return {(entry.interaction, entry.interval): entry for entry in disagreements}


def _cell(entry: Disagreement | None) -> str:
    if entry is None:
        return ""
    return f"{1e3 * entry.rms:.2f} ({entry.noise_units:.1f})" if math.isfinite(entry.rms) else "cannot be simulated"


def _get(values: tuple[float, ...], index: int) -> float | None:
    return values[index] if index < len(values) else None


def _millimetres(metres: float | None) -> str:
    return "" if metres is None else f"{1e3 * metres:.2f}"


def _name(candidate: Candidate) -> str:
    return " + ".join(candidate.names) or "none"


def _sizes(effects: tuple[FittedEffect, ...]) -> str:
    return ", ".join(_size(effect, name) for effect in effects for name in effect.values)


def _size(effect: FittedEffect, name: str) -> str:
    unit = "" if effect.units[name] == "1" else f" {effect.units[name]}"
    interval = effect.intervals.get(name)
    within = f" ({interval[0]:.3g} to {interval[1]:.3g})" if interval else ""
    return f"{name} {effect.values[name]:.3g}{unit}{within}"
