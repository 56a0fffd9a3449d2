"""The score of hidden-effect captures: one judgement a case, from its row alone.

Stands on the rows of the answers: no simulator, no rig. Definitions are those of docs/gap_benchmark.md.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from benchmarks.gap.cases import LEADING, NEAREST, GapCase, Kind
from benchmarks.gap.rows import Row

CONFIDENT = 0.9  # a wrong answer with a probability from here on is a confident one
LEAST_CLOSED = 0.1  # where even the true model closes less of the held-out gap, there is none to close
SHOWN = 0.001  # [m]: an effect that moves the held-out motion by less than its noise cannot be told from it there


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
        first: whether `named` is exactly the truth, but for what the rig's body has anyway; for an outside effect, whether the answer is
            `unknown` or nearest.
        in_class: whether a member is.
        size_error: of the amplitudes, relative, where `first` and an amplitude is known.
        covered: per coefficient whether its interval holds the truth, where `first`.
        closed, oracle_closed: share of the gap on the held-out motion that the answer and the true model close.
        lead_right: for an `unknown` outside effect, whether the formula's first term is right.
        rank: place of the truth among all candidates by probability, from 1; None if it is not among them.
        screened: its place by the linear test.
        seconds: of the search.
        motions: that the search saw.
        visible: how far the effect moves what was seen [m]; None where it is not known.
        visible_held_out: the same of the motion that was kept out.
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
    lead_right: bool | None = None
    rank: int | None = None
    screened: int | None = None
    seconds: float | None = None
    motions: tuple[str, ...] = ()
    visible: float | None = None
    visible_held_out: float | None = None

    @property
    def closed_share(self) -> float | None:
        """What the answer closes relative to the true model; None where there is nothing to close."""
        if self.closed is None or self.oracle_closed is None or not self.oracle_closed >= LEAST_CLOSED:
            return None
        return self.closed / self.oracle_closed

    @property
    def alarm(self) -> bool:
        """Of a control: whether the answer names what is not there; `unknown` is an alarm too."""
        return not self.first and self.verdict != "failed"

    @property
    def with_the_rigs_own(self) -> bool:
        """Whether the answer is right, and names what the rig's body has anyway."""
        return self.first and self.case.hidden_of(self.named) != self.named

    @property
    def shows_held_out(self) -> bool:
        """Whether the effect can be seen in the motion that was kept out."""
        return self.visible_held_out is None or self.visible_held_out >= SHOWN

    @property
    def joint(self) -> bool:
        """Whether the effect is named first, and the answer closes half or more of what the true model closes."""
        if not self.first or self.closed is None or self.oracle_closed is None:
            return False
        return self.closed > 0.0 and self.closed >= 0.5 * self.oracle_closed


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


def judge(row: Row, sizes: dict[str, Sizes]) -> Judgement:
    """One case against its truth.

    Args:
        row: as of `rows.row_of`.
        sizes: by effect of the library.
    """
    case = GapCase.named(row["case"])
    truth, visible = case.truth, row["visibility_by_motion"]
    filmed = {
        "motions": tuple(row["seen"]),
        "visible": row["visibility"],
        "visible_held_out": visible.get(row["held_out"]),
    }
    if row["verdict"] == "failed":
        return Judgement(case, case.kind, truth, "failed", **filmed)
    named = tuple(sorted(row["names"]))
    members = tuple(tuple(sorted(member)) for member in row["members"])
    first, in_class = (_right(case, row["verdict"], found, truth) for found in ([named], members or [named]))
    exact = first and case.kind in ("single", "pair")
    found, true_values = row["coefficients"], row["truth"]
    return Judgement(
        case,
        case.kind,
        truth,
        row["verdict"],
        named,
        members,
        row["probability"],
        first,
        in_class,
        size_error=_size_error(found, true_values, sizes) if exact and case.kind == "single" else None,
        covered=_covered(found, true_values, sizes) if exact else (),
        closed=(row["closed"] if row["adopted"] else 0.0),
        oracle_closed=row["oracle"],
        lead_right=_lead_right(case, row),
        rank=row["rank"],
        screened=row["screened"],
        seconds=row["seconds"],
        **filmed,
    )


def is_confident_name(j: Judgement) -> bool:
    """Whether the answer names something and is sure of it."""
    return j.verdict in ("effect", "effects", "class") and j.probability >= CONFIDENT


def _right(case: GapCase, verdict: str, answers: Iterable[tuple[str, ...]], truth: tuple[str, ...]) -> bool:
    """Whether one of the answers is right; what the rig's body has anyway may be named in it."""
    if case.kind == "none":
        return verdict == "none" or (verdict != "unknown" and any(a and not case.hidden_of(a) for a in answers))
    if case.kind == "outside":
        nearest = NEAREST[case.effect.partition(":")[2]]
        return verdict == "unknown" or any(len(a) == 1 and a[0] in nearest for a in answers)
    return verdict not in ("none", "unknown") and truth in map(case.hidden_of, answers)


def _lead_right(case: GapCase, row: Row) -> bool | None:
    """Of an outside effect that is answered with `unknown`; a lead without a formula is wrong."""
    if case.kind != "outside" or row["verdict"] != "unknown":
        return None
    return bool(row["lead"]) and row["lead"][0] in LEADING[case.effect.partition(":")[2]]


def _size_error(found: Row, truth: Row, sizes: dict[str, Sizes]) -> float | None:
    """|found - true| / |true| over the amplitudes of the one effect, each from its dormant value, in units of its scale."""
    if len(truth) != 1:
        return None
    ((name, true_values),) = truth.items()
    own = sizes[name]
    known = [key for key in own.dormant if key in true_values]
    found_values = {key: value for key, (value, _) in found[name].items()}

    def size(values: dict) -> np.ndarray:
        return np.array([(values[key] - own.dormant[key]) / own.scale[key] for key in known])

    true = np.linalg.norm(size(true_values))
    return float(np.linalg.norm(size(found_values) - size(true_values)) / true) if true > 0 else None


def _covered(found: Row, truth: Row, sizes: dict[str, Sizes]) -> tuple[bool, ...]:
    """Per coefficient whose truth is known, whether its 90 % interval holds it."""
    hits = []
    for name, values in truth.items():
        for key in sizes[name].stated:
            if key in values:
                low, high = found[name][key][1]
                hits.append(low <= values[key] <= high)
    return tuple(hits)
