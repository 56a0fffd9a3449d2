"""The score as a page to read: headline numbers, a line per effect and strength, how honest the probabilities are."""

from collections.abc import Mapping, Sequence
from typing import Any

from benchmarks.gap.scoring import Judgement

HEADLINES = (
    ("named_first", "right effect first, middle and high strength", ">= 0.80"),
    ("named_in_class", "in the reported class", ">= 0.90"),
    ("false_alarm_rate", "false alarms where nothing is hidden", "<= 0.02"),
    ("two_effects_both", "two hidden: both named", ">= 0.60"),
    ("unknown_handled", "outside the library: unknown or nearest", ">= 0.85"),
    ("outside_confidently_wrong", "outside: a confident wrong name", "<= 0.08"),
    ("gap_closed_vs_oracle_median", "held-out gap closed, relative to the true model", ">= 0.70"),
    ("size_error_median", "error of the effect's size", "<= 0.25"),
    ("interval_coverage", "90 % intervals that hold the truth", "0.85 to 0.95"),
    ("joint", "named first, and half of the true model's gap closed on the held-out motion", ">= 0.75"),
    ("calibration_error", "stated probability against share that is right", "<= 0.06"),
    ("lead_right", "`unknown` outside the library: the formula's first term is right", ""),
    ("seconds_median", "seconds of a search, median", ""),
)
RGBD_AIMS = {
    "named_first": ">= 0.70",
    "named_in_class": ">= 0.83",
    "false_alarm_rate": "<= 0.05",
    "joint": ">= 0.60",
    "calibration_error": "<= 0.08",
    "interval_coverage": "0.80 to 0.97",
}
"""What is wanted of answers from RGB-D, where it is not what is wanted from tracks alone."""


def page(
    title: str, summary: dict[str, Any], judged: Sequence[Judgement], aims: Mapping[str, str] | None = None
) -> str:
    """Markdown of one variant; `aims` are laid over what is wanted."""
    aims = aims or {}
    counts = ", ".join(f"{count} {name.replace('_', ' ')}" for name, count in summary["counts"].items())
    sets = f"Sets {', '.join(map(str, summary['seeds']))}, searched by {', '.join(summary['commits'])}."
    lines = [f"## {title}", "", sets, counts + ".", ""]
    lines += ["| number | measured | count | 95 % interval | wanted |", "|---|--:|--:|---|--:|"]
    lines += [_headline(key, text, aims.get(key, wanted), summary) for key, text, wanted in HEADLINES]
    tables = [_by_group(summary), _by_effect(judged), _reliability(summary["reliability"])]
    return "\n".join([*lines, *(line for table in tables for line in ("", *table))]) + "\n"


def _headline(key: str, text: str, wanted: str, summary: dict[str, Any]) -> str:
    pooled = summary["pooled"].get(key) or {}
    count = f"{pooled['hits']} of {pooled['count']}" if pooled.get("count") else ""
    return f"| {text} | {_number(summary[key])} | {count} | {_interval(pooled.get('interval'))} | {wanted} |"


def _by_group(summary: dict[str, Any]) -> list[str]:
    """Single effects of middle and high strength by body, motions, form and visibility, and controls beside them."""
    names = ("named_first", "named_in_class", "joint", "false_alarm_rate")
    lines = ["| | first | in class | joint | alarms |", "|---|---|---|---|---|"]
    for part in ("by_body", "by_motion", "by_form"):
        for group, own in summary[part].items():
            lines.append(f"| {group} | {' | '.join(_counted(own[name]) for name in names)} |")
    for own in summary["by_visibility"]:
        above = f" to {1e3 * own['to']:g}" if own["to"] else " and more"
        cells = (_counted(own[name]) for name in names[:2])
        lines.append(f"| visible by {1e3 * own['from']:g}{above} mm, any strength | {' | '.join(cells)} | | |")
    return lines


def _counted(share: dict[str, Any]) -> str:
    if not share["count"]:
        return ""
    return f"{share['hits']} of {share['count']} ({_interval(share['interval'])})"


def _interval(interval: Sequence[float] | None) -> str:
    return "" if interval is None else f"{interval[0]:.2f} to {interval[1]:.2f}"


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
