"""The numbers over many judgements: shares with Wilson's intervals, medians, and the same by body, motion, form and visibility."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from benchmarks.gap.scoring import Judgement, is_confident_name

HEADLINE = ("middle", "high")  # strengths that the headline numbers are about; weak ones are near the noise
BINS = (0.0, 0.5, 0.7, 0.9, 0.97, 1.0)  # of stated probabilities
VISIBILITIES = (0.0, 0.001, 0.002, 0.004, 0.008, np.inf)  # [m]


def summary(judged: Sequence[Judgement]) -> dict[str, Any]:
    """The record of one variant for results/gap_benchmark.json; a number is None where no case speaks of it."""
    strong = strong_singles(judged)
    hits = {name: list(own) for name, own in _shares(judged).items()}
    right = [j for j in strong if j.first]
    shares = [j.closed_share for j in right if j.closed_share is not None]
    return {
        **{name: _share(own) for name, own in hits.items()},
        "calibration_error": calibration_error(judged),
        "gap_closed_vs_oracle_median": _median(shares),
        "size_error_median": _median([j.size_error for j in right if j.size_error is not None]),
        "largest_class": max((len(j.members) for j in judged), default=0),
        "seconds_median": _median([j.seconds for j in judged if j.seconds is not None]),
        "seconds_max": max((j.seconds for j in judged if j.seconds is not None), default=None),
        "pooled": {name: counted(own) for name, own in hits.items()},
        "counts": _counts(judged, strong, right, shares, hits),
        "by_strength": {strength: _by_strength(judged, strength) for strength in ("weak", *HEADLINE)},
        "by_body": _grouped(judged, lambda j: j.case.body),
        "by_motion": _grouped(judged, lambda j: "+".join(j.motions)),
        "by_form": _grouped(judged, lambda j: j.case.form),
        "by_visibility": _by_visibility(judged),
        "reliability": reliability(judged),
        "confusion_matrix": confusion(judged),
    }


def strong_singles(judged: Iterable[Judgement]) -> list[Judgement]:
    """Those of one effect at middle or high strength."""
    return [j for j in judged if j.kind == "single" and j.case.strength in HEADLINE]


def counted(hits: Sequence[bool]) -> dict[str, Any]:
    """How many of how many, the share, and its 95 % interval (Wilson 1927); None where there is none."""
    if not len(hits):
        return {"hits": 0, "count": 0, "share": None, "interval": None}
    low, high = binomtest(int(sum(hits)), len(hits)).proportion_ci(0.95, method="wilson")
    return {"hits": int(sum(hits)), "count": len(hits), "share": sum(hits) / len(hits), "interval": [low, high]}


def reliability(judged: Iterable[Judgement]) -> list[dict[str, float]]:
    """Answers grouped by the probability they state: how many, what they state in the mean, how many are right."""
    given = [j for j in judged if j.verdict not in ("failed", "unknown")]
    bins = []
    for low, high in itertools.pairwise(BINS):
        inside = [j for j in given if low <= j.probability < high or (high == 1.0 and j.probability == 1.0)]
        if inside:
            stated = float(np.mean([j.probability for j in inside]))
            bins.append({"from": low, "to": high, "count": len(inside), "stated": stated})
            bins[-1]["right"] = _share([j.in_class for j in inside])
    return bins


def calibration_error(judged: Iterable[Judgement]) -> float | None:
    """Expected calibration error: how far the stated probability is from the share that is right, over the groups of `reliability` by
    their size."""
    bins = reliability(judged)
    total = sum(entry["count"] for entry in bins)
    return sum(entry["count"] * abs(entry["stated"] - entry["right"]) for entry in bins) / total if total else None


def confusion(judged: Iterable[Judgement]) -> dict[str, Any]:
    """Counts of the best answer (`named`) by what was hidden (`truth`); middle and high strength, controls, outside."""
    shown = [j for j in judged if j.kind in ("none", "outside") or (j.kind == "single" and j.case.strength in HEADLINE)]
    truths = sorted({j.case.effect for j in shown}, key=_order)
    answers = sorted({*(t for t in truths if not t.startswith("outside:")), *map(_answer, shown)}, key=_order)
    counts = np.zeros((len(truths), len(answers)), int)
    for j in shown:
        counts[truths.index(j.case.effect), answers.index(_answer(j))] += 1
    return {"truth": truths, "named": answers, "counts": counts.tolist()}


def _shares(judged: Sequence[Judgement]) -> dict[str, Iterable[bool]]:
    """Of each number that is a share, whether each case (or interval) that it speaks of is a hit."""
    strong = strong_singles(judged)
    none, pairs, outside = ([j for j in judged if j.kind == kind] for kind in ("none", "pair", "outside"))
    return {
        "named_first": (j.first for j in strong),
        "named_in_class": (j.in_class for j in strong),
        "false_alarm_rate": (j.alarm for j in none),
        "two_effects_both": (j.in_class for j in pairs),
        "unknown_handled": (j.in_class for j in outside),
        "outside_confidently_wrong": (not j.in_class and is_confident_name(j) for j in outside),
        "lead_right": (j.lead_right for j in outside if j.lead_right is not None),
        "joint": (j.joint for j in strong if j.shows_held_out),
        "interval_coverage": (hit for j in judged if j.first for hit in j.covered),
    }


def _counts(
    judged: Sequence[Judgement], strong: Sequence, right: Sequence, shares: Sequence, hits: dict[str, Sequence[bool]]
) -> dict[str, int]:
    kinds = {kind: sum(j.kind == kind for j in judged) for kind in ("single", "none", "pair", "outside")}
    return {
        "cases": len(judged),
        **kinds,
        "single_middle_and_high": len(strong),
        "named_first": len(right),
        "gap_closed": len(shares),
        "joint": len(hits["joint"]),
        "lead": len(hits["lead_right"]),
        "intervals": len(hits["interval_coverage"]),
        "failed": sum(j.verdict == "failed" for j in judged),
        "right_with_the_rigs_own": sum(j.with_the_rigs_own for j in judged),
    }


def _by_strength(judged: Sequence[Judgement], strength: str) -> dict[str, Any]:
    own = [j for j in judged if j.kind == "single" and j.case.strength == strength]
    return {
        "count": len(own),
        "named_first": _share([j.first for j in own]),
        "named_in_class": _share([j.in_class for j in own]),
        "said_none": _share([j.verdict == "none" for j in own]),
    }


def _grouped(judged: Sequence[Judgement], key: Callable[[Judgement], str]) -> dict[str, Any]:
    """Of single effects of middle and high strength, and of controls, by `key`."""
    names = sorted({key(j) for j in judged})
    return {name: _group([j for j in judged if key(j) == name]) for name in names}


def _group(own: Sequence[Judgement]) -> dict[str, Any]:
    strong = strong_singles(own)
    return {
        "named_first": counted([j.first for j in strong]),
        "named_in_class": counted([j.in_class for j in strong]),
        "joint": counted([j.joint for j in strong if j.shows_held_out]),
        "false_alarm_rate": counted([j.alarm for j in own if j.kind == "none"]),
    }


def _by_visibility(judged: Sequence[Judgement]) -> list[dict[str, Any]]:
    """Of single effects of any strength, by how far they move what was seen."""
    known = [j for j in judged if j.kind == "single" and j.visible is not None]
    found = []
    for low, high in itertools.pairwise(VISIBILITIES):
        own = [j for j in known if low <= j.visible < high]
        if own:
            span = {"from": low, "to": high if np.isfinite(high) else None}
            first, in_class = (counted([getattr(j, name) for j in own]) for name in ("first", "in_class"))
            said_none = counted([j.verdict == "none" for j in own])
            found.append({**span, "named_first": first, "named_in_class": in_class, "said_none": said_none})
    return found


def _answer(j: Judgement) -> str:
    """Column of the confusion matrix."""
    if j.verdict in ("none", "unknown", "failed"):
        return j.verdict
    return j.named[0] if len(j.named) == 1 else "two effects"


def _order(name: str) -> tuple[int, str]:
    last = ("two effects", "none", "unknown", "failed")
    return (1 + last.index(name) if name in last else 9 * name.startswith("outside:"), name)


def _share(hits: Sequence[bool]) -> float | None:
    return None if not hits else sum(hits) / len(hits)


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None
