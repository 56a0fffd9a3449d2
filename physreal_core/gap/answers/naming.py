"""Which effect: evidence of fitted candidates, probabilities, the class that the data cannot tell apart, or `unknown`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.effects import EFFECTS, Effect
from physreal_core.gap.answers.telling import telling
from physreal_core.gap.fits.least_squares import Fit
from physreal_core.gap.noise.evidence import Evidence
from physreal_core.gap.report import Candidate, FittedEffect, Verdict
from physreal_core.gap.settings import GapSettings

NINETY = 1.6449  # standard deviations on either side that hold 90 % of a Gaussian


@dataclass(frozen=True)
class Answer:
    """One answer that was fitted: no effect, one or two.

    Args:
        fit: to the training frames of all interactions.
        screened: gain that the score test promised [nat].
        gain: in log evidence over the baseline [nat].
        held_out: gain in half the squared residual of the held-out frames [nat].
        excess, telling: as of `Candidate`.
    """

    fit: Fit
    screened: float | None
    gain: float
    held_out: float
    excess: float
    telling: tuple[float, ...]

    @property
    def names(self) -> tuple[str, ...]:
        return self.fit.unknowns.effects


def answer_of(fit: Fit, screened: float | None, held_out: float, baseline: Fit, evidence: Evidence) -> Answer:
    """A fit beside the baseline, with what it gains on the held-out frames [nat]."""
    held_out = held_out if np.isfinite(held_out) else -np.inf
    gain = fit.log_evidence - baseline.log_evidence
    return Answer(fit, screened, gain, held_out, evidence.excess(fit), telling(fit, baseline, evidence.train))


def fitted_effects(fit: Fit, best_gain: float, settings: GapSettings) -> tuple[FittedEffect, ...]:
    """Coefficients with intervals from the curvature of the posterior whose likelihood is tempered as the gains are, or more."""
    J, temperature = fit.jacobian, settings.interval_temperature * temperature_of(best_gain, settings)
    covariance = np.linalg.inv(J.T @ J / temperature + fit.unknowns.block.precision)
    deviations = fit.unknowns.deviations(covariance)
    return tuple(
        _fitted(EFFECTS[name], values, deviations[name]) for name, values in fit.unknowns.values(fit.vector).items()
    )


def _fitted(effect: Effect, values: dict[str, float], deviations: dict[str, float]) -> FittedEffect:
    intervals = {}
    for c in effect.coefficients:
        value, reach = values[c.name], NINETY * deviations[c.name]
        intervals[c.name] = (max(c.lower, value - reach), min(c.upper, value + reach))
    return FittedEffect(effect.name, values, intervals, effect.units)


def probabilities(answers: Sequence[Answer], settings: GapSettings, library: int) -> Array:
    """Of the answers, from their gains at the calibrated temperature and their priors."""
    names, held_out = [answer.names for answer in answers], [answer.held_out for answer in answers]
    gains = np.array([weighed(answer.gain, answer.held_out, settings) for answer in answers])
    return chances([*map(len, names)], confirmed(names, gains, held_out, settings), settings, library)


def weighed(gain: float, held_out: float, settings: GapSettings) -> float:
    """An answer's gain in evidence, less what it loses on held-out frames or with a share of what it gains there [nat].

    A loss there speaks against an effect. A gain counts in part, and no more than what the evidence has promised already: else
    an effect with none of its own would be named for the luck of one late swing.
    """
    promised = max(gain, 0.0)
    if held_out < 0.0:
        return gain + max(held_out, -settings.held_out_loss * promised)
    return gain + settings.held_out_share * min(held_out, promised)


def confirmed(
    names: Sequence[tuple[str, ...]],
    gains: Float[Array, " answers"],
    held_out: Sequence[float],
    settings: GapSettings,
) -> Float[Array, " answers"]:
    """The gains [nat], of two effects no more beyond the better of them alone than they confirm on held-out frames.

    A spare second effect bends to what the first one leaves in the training frames, and does nothing beyond them.
    """
    if not any(held_out):  # there are no such frames
        return gains
    found, alone = gains.copy(), {own[0]: number for number, own in enumerate(names) if len(own) == 1}
    for number, own in enumerate(names):
        if len(own) == 2 and (parts := [alone[name] for name in own if name in alone]):
            better = max(parts, key=gains.__getitem__)
            more = held_out[number] - held_out[better] if held_out[number] > held_out[better] else 0.0
            found[number] = min(gains[number], gains[better] + more / settings.confirmed)
    return found


def chances(sizes: Sequence[int], gains: Float[Array, " answers"], settings: GapSettings, library: int) -> Array:
    """Probabilities of answers with so many effects each and these gains [nat].

    What two effects gain beyond one, the best two beyond the best one, is weighed by itself: the misfit of one is in both answers.
    """
    effects = np.asarray(sizes)
    best = float(gains.max())
    beyond = np.where(effects == 2, best - gains[effects < 2].max(), 0.0).clip(0.0)
    weights = np.log(_priors(settings, library))[effects]
    weights += (gains - beyond) / temperature_of(best, settings) + beyond / second_temperature_of(best, settings)
    weights = np.exp(weights - weights.max())
    return weights / weights.sum()


def _priors(settings: GapSettings, library: int) -> tuple[float, float, float]:
    """Of nothing, of each effect of a library, of each pair."""
    something, pairs = 1.0 - settings.prior_none, max(library * (library - 1) // 2, 1)
    single, pair = something * (1.0 - settings.prior_pair) / library, something * settings.prior_pair / pairs
    return settings.prior_none, single, pair


def worth_of_a_second(gain: float, settings: GapSettings, library: int) -> float:
    """What a second effect must gain beyond a best one of this gain, for two to belong to the class [nat]."""
    _, single, pair = _priors(settings, library)
    return second_temperature_of(gain, settings) * max(0.0, float(np.log(settings.class_ratio * single / pair)))


def temperature_of(best_gain: float, settings: GapSettings) -> float:
    """By which gains are divided where the best answer gains this much [nat]; see `GapSettings.misfit`."""
    return max(settings.temperature, settings.misfit * best_gain)


def second_temperature_of(best_gain: float, settings: GapSettings) -> float:
    """The same for what a second effect gains; see `GapSettings.remainder`."""
    return max(settings.temperature, settings.remainder * best_gain)


def candidates_of(answers: Sequence[Answer], chances: Array, settings: GapSettings) -> tuple[Candidate, ...]:
    """Records of the answers, the most probable first."""
    best = max(answer.gain for answer in answers)
    found = [
        Candidate(
            fitted_effects(a.fit, best, settings),
            a.screened,
            a.gain,
            a.held_out,
            float(p),
            a.fit.unknowns.baseline_fields(a.fit.vector),
            a.excess,
            a.telling,
        )
        for a, p in zip(answers, chances, strict=True)
    ]
    return tuple(sorted(found, key=lambda c: -c.probability))


def verdict_of(
    candidates: Sequence[Candidate], threshold: float, significant: bool, explained: float, settings: GapSettings
) -> Verdict:
    """The answer.

    Args:
        candidates: the most probable first.
        threshold: gain that a candidate reaches by chance in the allowed share of captures without a missing effect.
        significant: whether there is any disagreement beyond noise and numerics.
        explained: share of the disagreement beyond noise and numerics that the best candidate closes.
        settings: says what a class is.
    """
    best = candidates[0]
    none = next(c for c in candidates if not c.names)
    named = [c for c in candidates if c.names and c.gain is not None and c.gain > max(threshold, 0.0)]
    if best not in named:
        return _none(none, significant)
    if significant and explained < settings.unexplained:
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
    """What to film next to tell the members of a class apart."""
    effects = dict.fromkeys(name for names in members for name in names)
    return "; ".join(f"{_words(name)}: {EFFECTS[name].told_by}" for name in effects)


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
