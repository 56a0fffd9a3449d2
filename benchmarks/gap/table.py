"""The score as a page to read: headline numbers, a line per effect and strength, how honest the probabilities are."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.gap.scoring import Judgement

HEADLINES = (
    ("named_first", "right effect first, middle and high strength", ">= 0.70"),
    ("named_in_class", "in the reported class", ">= 0.85"),
    ("false_alarm_rate", "false alarms where nothing is hidden", "<= 0.10"),
    ("two_effects_both", "two hidden: both named", ">= 0.50"),
    ("unknown_handled", "outside the library: unknown or nearest", ">= 0.70"),
    ("outside_confidently_wrong", "outside: a confident wrong name", "<= 0.15"),
    ("gap_closed_vs_oracle_median", "held-out gap closed, relative to the true model", ">= 0.70"),
    ("size_error_median", "error of the effect's size", "<= 0.25"),
    ("interval_coverage", "90 % intervals that hold the truth", "0.80 to 0.97"),
    ("seconds_median", "seconds of a search, median", ""),
)
RGBD_AIMS = {"named_first": "", "named_in_class": ">= 0.70", "false_alarm_rate": "<= 0.20"}
"""What is wanted of answers from RGB-D, where it is not what is wanted from tracks alone."""


def page(
    title: str, summary: dict[str, Any], judged: Sequence[Judgement], aims: Mapping[str, str] | None = None
) -> str:
    """Markdown of one variant; `aims` are laid over what is wanted."""
    aims = aims or {}
    counts = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in summary["counts"].items())
    lines = [f"## {title}", "", counts + ".", "", "| number | measured | wanted |", "|---|--:|--:|"]
    lines += [f"| {text} | {_number(summary[key])} | {aims.get(key, wanted)} |" for key, text, wanted in HEADLINES]
    return "\n".join([*lines, "", *_by_effect(judged), "", *_reliability(summary["reliability"])]) + "\n"


def _by_effect(judged: Sequence[Judgement]) -> list[str]:
    head = (
        "hidden",
        "strength",
        "cases",
        "first",
        "in class",
        "size error",
        "closed vs oracle",
        "rank",
        "answers",
        "s",
    )
    lines = [f"| {' | '.join(head)} |", "|---|---|" + "--:|" * 6 + "---|--:|"]
    groups: dict[tuple[str, str], list[Judgement]] = {}
    for j in judged:
        groups.setdefault((j.case.effect, "" if j.kind == "none" else j.case.strength), []).append(j)
    order = {"weak": 0, "middle": 1, "high": 2, "": 3}
    for (effect, strength), group in sorted(groups.items(), key=lambda item: (item[0][0], order[item[0][1]])):
        cells = [
            effect,
            strength,
            str(len(group)),
            str(sum(j.first for j in group)),
            str(sum(j.in_class for j in group)),
            _mean(j.size_error for j in group),
            _mean(j.closed_share for j in group if j.first),
            "/".join("-" if j.rank is None else str(j.rank) for j in group) if group[0].truth else "",
            ", ".join(_said(j) for j in group),
            _mean((j.seconds for j in group), digits=0),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return lines


def _reliability(bins: list[dict[str, float]]) -> list[str]:
    lines = ["| stated probability | answers | stated, mean | right |", "|---|--:|--:|--:|"]
    for entry in bins:
        span = f"{entry['from']:g} to {entry['to']:g}"
        lines.append(f"| {span} | {entry['count']} | {entry['stated']:.2f} | {entry['right']:.2f} |")
    return lines


def _said(j: Judgement) -> str:
    """The answer in short."""
    if j.verdict in ("none", "unknown", "failed"):
        return j.verdict
    return f"{'+'.join(j.named)} ({j.probability:.2f})"


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.0f}" if value >= 10 else f"{value:.2f}"


def _mean(values, digits: int = 2) -> str:
    known = [value for value in values if value is not None]
    return f"{sum(known) / len(known):.{digits}f}" if known else ""
