"""The verdict: no effect, one or two, a class of answers that the data cannot tell apart, or an unknown effect."""

from __future__ import annotations

from collections.abc import Sequence

from physreal_core.effects import EFFECTS
from physreal_core.gap.report import Candidate, FittedEffect, Verdict
from physreal_core.gap.settings import GapSettings


def verdict_of(
    candidates: Sequence[Candidate],
    threshold: float,
    significant: bool,
    left: bool,
    explained: float,
    settings: GapSettings,
) -> Verdict:
    """The verdict on some answers.

    Args:
        candidates: the most probable first.
        threshold: gain that a candidate reaches by chance in the allowed share of captures without a missing effect
            [nat].
        significant: whether there is a disagreement beyond noise and numerical error.
        left: whether the best candidate leaves one, too.
        explained: share of that disagreement that the best candidate explains.
        settings: of the search; they say what belongs to a class.
    """
    best = candidates[0]
    none = next(c for c in candidates if not c.names)
    named = [c for c in candidates if c.names and c.gain is not None and c.gain > max(threshold, 0.0)]
    if best not in named:
        return _none(none, significant)
    if significant and left and explained < settings.unexplained:
        members = tuple(c.names for c in named[: settings.class_size])
        return Verdict("unknown", best.names, members, 1.0 - none.probability, _unknown_sentence(best, explained))
    members = [c for c in named if c.probability >= settings.class_ratio * best.probability][: settings.class_size]
    total = sum(member.probability for member in members)
    names = tuple(member.names for member in members)
    if len(members) > 1:
        return Verdict("class", best.names, names, total, _class_sentence(members), next_motion(names))
    kind = "effect" if len(best.names) == 1 else "effects"
    return Verdict(kind, best.names, names, total, _named_sentence(best))


def next_motion(members: Sequence[tuple[str, ...]]) -> str:
    """The motions to film next, which tell the members of a class apart."""
    effects = dict.fromkeys(name for names in members for name in names)
    return "; ".join(f"{_words(name)}: {EFFECTS[name].distinguished_by}" for name in effects)


def _none(none: Candidate, significant: bool) -> Verdict:
    sentence = (
        "There is a disagreement beyond noise and numerical error, but no effect of the library explains it better than chance."
        if significant
        else "Nothing is missing that these frames could show beyond noise and numerical error."
    )
    return Verdict("unknown" if significant else "none", (), ((),), none.probability, sentence)


def _words(name: str) -> str:
    return name.replace("_", " ")


def _sizes(candidate: Candidate) -> str:
    parts = []
    for effect in candidate.effects:
        amplitudes = [c for c in EFFECTS[effect.name].coefficients if c.kind == "amplitude"]
        sizes = ", ".join(_size(effect, c.name) for c in amplitudes)
        parts.append(f"{_words(effect.name)} ({sizes})")
    return " and ".join(parts)


def _size(effect: FittedEffect, name: str) -> str:
    low, high = effect.intervals[name]
    unit = "" if effect.units[name] == "1" else f" {effect.units[name]}"
    return f"{_words(name)} {effect.values[name]:.3g}{unit}, 90 % within {low:.3g} to {high:.3g}"


def _named_sentence(best: Candidate) -> str:
    return f"Missing: {_sizes(best)}, with probability {best.probability:.2f}."


def _class_sentence(members: Sequence[Candidate]) -> str:
    listed = "; ".join(f"{_sizes(member)}, probability {member.probability:.2f}" for member in members)
    return f"These frames cannot tell apart: {listed}."


def _unknown_sentence(best: Candidate, explained: float) -> str:
    return (
        f"Something is missing that the library does not hold: the best candidate, {_sizes(best)}, closes "
        f"{100 * explained:.0f} % of the disagreement beyond noise and numerical error."
    )
