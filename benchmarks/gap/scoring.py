"""The score of hidden-effect captures: answers against truths, one judgement a case, and the numbers over all of them.

Stands on the records of the answers alone: no simulator, no rig. Definitions are those of docs/gap_benchmark.md.
"""

import itertools
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.gap.cases import NEAREST, GapCase, Kind

HEADLINE = ("middle", "high")  # strengths that the headline numbers are about; weak ones are near the noise
BINS = (0.0, 0.5, 0.7, 0.9, 0.97, 1.0)  # of stated probabilities
CONFIDENT = 0.9  # a wrong answer with a probability from here on is a confident one
LEAST_CLOSED = 0.1  # where even the true model closes less of the held-out gap, there is none to close


@dataclass(frozen=True)
class Judgement:
    """One case, judged.

    Args:
        case, kind: which.
        truth: names of the hidden effects that the library has, sorted.
        verdict: its kind, `failed` where there is no answer.
        named: the best answer's effects, sorted.
        members: the reported class, the best first.
        probability: stated for the class.
        first: whether `named` is exactly the truth; for an outside effect, whether the answer is `unknown` or nearest.
        in_class: whether a member is.
        size_error: of the amplitudes, relative, where `first` and an amplitude is known.
        covered: per coefficient whether its interval holds the truth, where `first`.
        closed, oracle_closed: share of the held-out gap that the answer and the true model close.
        rank: place of the truth among all candidates by probability, from 1; None if it is not among them.
        screened: its place by the linear test.
        seconds: of the search.
    """

    case: GapCase
    kind: Kind
    truth: tuple[str, ...]
    verdict: str
    named: tuple[str, ...] = ()
    members: tuple[tuple[str, ...], ...] = ()
    probability: float = 0.0
    first: bool = False
    in_class: bool = False
    size_error: float | None = None
    covered: tuple[bool, ...] = ()
    closed: float | None = None
    oracle_closed: float | None = None
    rank: int | None = None
    screened: int | None = None
    seconds: float | None = None

    @property
    def closed_share(self) -> float | None:
        """What the answer closes relative to the true model; None where there is nothing to close."""
        if self.closed is None or self.oracle_closed is None or not self.oracle_closed >= LEAST_CLOSED:
            return None
        return self.closed / self.oracle_closed


@dataclass(frozen=True)
class Sizes:
    """How the numbers of one effect are compared with the truth.

    Args:
        dormant, scale: of its amplitudes, by name: the effect's size is what they differ from dormant, in units of scale.
        stated: coefficients whose interval must hold the truth. Angles of a direction are left out: a direction and its
            opposite are the same fibre.
    """

    dormant: dict[str, float]
    scale: dict[str, float]
    stated: tuple[str, ...]


def sizes_of(coefficients: Iterable[Any]) -> Sizes:
    """The sizes of an effect with these coefficients (`physreal_core.effects.Coefficient`)."""
    own = list(coefficients)
    amplitudes = [c for c in own if c.kind == "amplitude"]
    return Sizes(
        {c.name: c.dormant for c in amplitudes},
        {c.name: c.scale for c in amplitudes},
        tuple(c.name for c in own if c.kind == "amplitude" or c.unit != "rad"),
    )


def judge(case: GapCase, answer: dict | None, oracle: dict | None, sizes: dict[str, Sizes]) -> Judgement:
    """One case against its truth.

    Args:
        answer: `answer.json`: `report` and `added` as `GapReport` and `Added` write them, `seconds`; None if it failed.
        oracle: `oracle.json`: `truth`, coefficients by effect, and `closed`, the true model's; None if it failed.
        sizes: by effect of the library.
    """
    truth = case.truth
    if answer is None:
        return Judgement(case, case.kind, truth, "failed")
    verdict = answer["report"]["verdict"]
    named = tuple(sorted(verdict["names"]))
    members = tuple(tuple(sorted(member)) for member in verdict["members"])
    first, in_class = (_right(case, verdict["kind"], found, truth) for found in ([named], members or [named]))
    exact = first and case.kind in ("single", "pair")
    fitted = {effect["name"]: effect for effect in _fitted(answer["report"], verdict["names"])}
    true_values = (oracle or {}).get("truth", {})
    return Judgement(
        case,
        case.kind,
        truth,
        verdict["kind"],
        named,
        members,
        verdict["probability"],
        first,
        in_class,
        size_error=_size_error(fitted, true_values, sizes) if exact and case.kind == "single" else None,
        covered=_covered(fitted, true_values, sizes) if exact else (),
        closed=_closed(answer),
        oracle_closed=None if oracle is None else oracle.get("closed"),
        rank=_rank(answer["report"]["candidates"], truth, "probability"),
        screened=_rank(answer["report"]["candidates"], truth, "screened"),
        seconds=answer.get("seconds"),
    )


def read_cases(
    folder: Path, cases: Iterable[GapCase], sizes: dict[str, Sizes]
) -> tuple[list[Judgement], list[GapCase]]:
    """Judgements of the cases in `folder` that have been run, and those that have not."""
    judged, missing = [], []
    for case in cases:
        answer, oracle = (_json(folder / case.name / f"{name}.json") for name in ("answer", "oracle"))
        if answer is None and not (folder / case.name / "failed.txt").is_file():
            missing.append(case)
        else:
            judged.append(judge(case, answer, oracle, sizes))
    return judged, missing


def summary(judged: Sequence[Judgement]) -> dict[str, Any]:
    """The record of one variant for results/gap_benchmark.json; a number is None where no case speaks of it."""
    strong = [j for j in judged if j.kind == "single" and j.case.strength in HEADLINE]
    none, pairs, outside = ([j for j in judged if j.kind == kind] for kind in ("none", "pair", "outside"))
    right = [j for j in strong if j.first]
    shares = [j.closed_share for j in right if j.closed_share is not None]
    covered = [hit for j in judged if j.first for hit in j.covered]
    return {
        "named_first": _share(j.first for j in strong),
        "named_in_class": _share(j.in_class for j in strong),
        "false_alarm_rate": _share(j.verdict not in ("none", "failed") for j in none),
        "two_effects_both": _share(j.in_class for j in pairs),
        "unknown_handled": _share(j.in_class for j in outside),
        "outside_confidently_wrong": _share(not j.in_class and _confident_name(j) for j in outside),
        "gap_closed_vs_oracle_median": _median(shares),
        "size_error_median": _median([j.size_error for j in right if j.size_error is not None]),
        "interval_coverage": _share(covered),
        "largest_class": max((len(j.members) for j in judged), default=0),
        "seconds_median": _median([j.seconds for j in judged if j.seconds is not None]),
        "seconds_max": max((j.seconds for j in judged if j.seconds is not None), default=None),
        "counts": _counts(judged, strong, right, shares, covered),
        "by_strength": {strength: _by_strength(judged, strength) for strength in ("weak", *HEADLINE)},
        "reliability": reliability(judged),
        "confusion_matrix": confusion(judged),
    }


def reliability(judged: Iterable[Judgement]) -> list[dict[str, float]]:
    """Answers grouped by the probability they state: how many, what they state in the mean, how many are right."""
    given = [j for j in judged if j.verdict not in ("failed", "unknown")]
    bins = []
    for low, high in itertools.pairwise(BINS):
        inside = [j for j in given if low <= j.probability < high or (high == 1.0 and j.probability == 1.0)]
        if inside:
            stated = float(np.mean([j.probability for j in inside]))
            bins.append({"from": low, "to": high, "count": len(inside), "stated": stated})
            bins[-1]["right"] = _share(j.in_class for j in inside)
    return bins


def confusion(judged: Iterable[Judgement]) -> dict[str, Any]:
    """Counts of the best answer (`named`) by what was hidden (`truth`); middle and high strength, controls, outside."""
    shown = [j for j in judged if j.kind in ("none", "outside") or (j.kind == "single" and j.case.strength in HEADLINE)]
    truths = sorted({j.case.effect for j in shown}, key=_order)
    answers = sorted({*(t for t in truths if not t.startswith("outside:")), *map(_answer, shown)}, key=_order)
    counts = np.zeros((len(truths), len(answers)), int)
    for j in shown:
        counts[truths.index(j.case.effect), answers.index(_answer(j))] += 1
    return {"truth": truths, "named": answers, "counts": counts.tolist()}


def _right(case: GapCase, verdict: str, answers: Iterable[tuple[str, ...]], truth: tuple[str, ...]) -> bool:
    """Whether one of the answers is right."""
    if case.kind == "none":
        return verdict == "none"
    if case.kind == "outside":
        nearest = NEAREST[case.effect.partition(":")[2]]
        return verdict == "unknown" or any(len(a) == 1 and a[0] in nearest for a in answers)
    return verdict not in ("none", "unknown") and truth in list(answers)


def _fitted(report: dict, names: Sequence[str]) -> list[dict]:
    """The effects of the candidate that the verdict names, as fitted."""
    for candidate in report["candidates"]:
        if sorted(effect["name"] for effect in candidate["effects"]) == sorted(names):
            return candidate["effects"]
    return []


def _size_error(fitted: dict, truth: dict, sizes: dict[str, Sizes]) -> float | None:
    """|found - true| / |true| over the amplitudes of the one effect, each from its dormant value, in units of its scale."""
    if len(truth) != 1:
        return None
    ((name, true_values),) = truth.items()
    own, found_values = sizes[name], fitted[name]["values"]
    known = [key for key in own.dormant if key in true_values]

    def size(values: dict) -> np.ndarray:
        return np.array([(values[key] - own.dormant[key]) / own.scale[key] for key in known])

    true = np.linalg.norm(size(true_values))
    return float(np.linalg.norm(size(found_values) - size(true_values)) / true) if true > 0 else None


def _covered(fitted: dict, truth: dict, sizes: dict[str, Sizes]) -> tuple[bool, ...]:
    """Per coefficient whose truth is known, whether its 90 % interval holds it."""
    hits = []
    for name, values in truth.items():
        for key in sizes[name].stated:
            if key in values:
                low, high = fitted[name]["intervals"][key]
                hits.append(low <= values[key] <= high)
    return tuple(hits)


def _closed(answer: dict) -> float:
    """Share of the held-out gap that the adopted effect closed; nothing adopted, nothing closed."""
    added = answer.get("added") or {}
    return float(added["closed"]) if added.get("adopted") else 0.0


def _rank(candidates: list[dict], truth: tuple[str, ...], key: str) -> int | None:
    """Place of the truth among the candidates by `key`, the largest first; those without it come last."""
    known = [c for c in candidates if c[key] is not None and (key != "probability" or c["gain"] is not None)]
    ordered = sorted(known, key=lambda c: -c[key])
    names = [tuple(sorted(effect["name"] for effect in candidate["effects"])) for candidate in ordered]
    return names.index(truth) + 1 if truth in names else None


def _counts(judged: Sequence, strong: Sequence, right: Sequence, shares: Sequence, covered: Sequence) -> dict[str, int]:
    kinds = {kind: sum(j.kind == kind for j in judged) for kind in ("single", "none", "pair", "outside")}
    return {
        "cases": len(judged),
        **kinds,
        "single_middle_and_high": len(strong),
        "named_first": len(right),
        "gap_closed": len(shares),
        "intervals": len(covered),
        "failed": sum(j.verdict == "failed" for j in judged),
    }


def _by_strength(judged: Sequence[Judgement], strength: str) -> dict[str, Any]:
    own = [j for j in judged if j.kind == "single" and j.case.strength == strength]
    return {
        "count": len(own),
        "named_first": _share(j.first for j in own),
        "named_in_class": _share(j.in_class for j in own),
        "said_none": _share(j.verdict == "none" for j in own),
    }


def _confident_name(j: Judgement) -> bool:
    return j.verdict in ("effect", "effects", "class") and j.probability >= CONFIDENT


def _answer(j: Judgement) -> str:
    """Column of the confusion matrix."""
    if j.verdict in ("none", "unknown", "failed"):
        return j.verdict
    return j.named[0] if len(j.named) == 1 else "two effects"


def _order(name: str) -> tuple[int, str]:
    last = ("two effects", "none", "unknown", "failed")
    return (1 + last.index(name) if name in last else 9 * name.startswith("outside:"), name)


def _share(hits: Iterable[bool]) -> float | None:
    values = list(hits)
    return None if not values else sum(values) / len(values)


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if len(values) else None


def _json(path: Path) -> dict | None:
    return json.loads(path.read_text()) if path.is_file() else None
