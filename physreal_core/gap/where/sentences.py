"""A disagreement in one sentence for a person. ± is half the width of a 90 % interval."""

from __future__ import annotations

import numpy as np
from scipy import stats

from physreal_core.array_types import Array, Bool, Float
from physreal_core.gap.where.findings import Onset, Place, Where
from physreal_core.gap.where.signatures import Signature

_HALF_WIDTH = float(stats.norm.ppf(0.95))
_MOTION_WORDS = {
    "still": "before anything moves",
    "driven": "while the hand moves",
    "swinging": "while swinging",
    "settled": "once all has come to rest",
}
_CLEAR = 0.25
"""Least share of the departure that a pattern must explain to be mentioned: a person would not see a weaker one."""


def where_sentence(where: Where) -> str:
    """The whole finding: when, in which phase, which part of the body, how and by how much; or that there is none."""
    if not where.significant:
        return _agreement_sentence(where)
    place = where.place
    touches = any(cell.label == "on the ground" for cell in where.cells)
    phase = _phase(place, touches)
    if phase and place.motion and _motion_at_onset(where) not in (None, place.motion):
        phase = f"most of all {phase}"
    parts = [_when(where.onset, len(where.frames)), phase]
    start = ", ".join(part for part in parts if part)
    subject = f"the {place.part} of the body" if place.part else "the body"
    sentence = f"{start}, {subject} {_departure(place)}" if start else f"{subject} {_departure(place)}"
    return f"{sentence[0].upper()}{sentence[1:]}{_before(where)}."


def _agreement_sentence(where: Where) -> str:
    """The test knows no effect and averages over a tenth of a second: an effect may be named beside it, and the words allow that."""
    sizes, frames = where.sizes, len(where.frames)
    numerics = f" and {millimetres(sizes.numerics)} of numerical error" if sizes.numerics > 0 else ""
    floor = f"{millimetres(sizes.noise)} of noise{numerics}"
    apart, chance = f"{millimetres(sizes.residual)} apart (RMS)", f"p = {where.test.p_value:.2g}"
    if loud := int(_loud(where.frame_log10_p, frames).sum()):
        return (
            f"Simulation and measurement are {apart}. In {loud} of {frames} frames, each by itself, that is further than {floor} "
            f"would explain; averaged over a tenth of a second it is not ({chance}), so it comes and goes faster than that."
        )
    test = f"({chance} in a test that knows no effect; the search, which knows their patterns, can see more)"
    if sizes.gap < 0.5 * sizes.residual:
        return f"Simulation and measurement agree: they are {apart}, as {floor} would have it {test}."
    return (
        f"Simulation and measurement are {apart}, more than {floor} would give on average, but not for certain {test}."
    )


def _when(onset: Onset | None, frames: int) -> str:
    if onset is None:
        return ""
    lasts = onset.last >= frames - 1 - max(2, frames // 10)
    if onset.frame <= 2:
        return "from the start on" if lasts else f"up to frame {onset.last}"
    return f"from frame {onset.frame} on" if lasts else f"between frames {onset.frame} and {onset.last}"


def _motion_at_onset(where: Where) -> str | None:
    if where.onset is None:
        return None
    return next(motion for motion, first, after_last in where.spans if first <= where.onset.frame < after_last)


def _phase(place: Place, touches: bool) -> str:
    """The motion, and the contact if the body both touches the ground and does not, or swings free."""
    motion = _MOTION_WORDS.get(place.motion or "", "")
    if place.motion == "swinging" and place.support == "free":
        return "while swinging free"
    if place.support is None or not touches:
        return motion
    support = "where it is free" if place.support == "free" else "where it touches the ground"
    return f"{motion} and {support}" if motion else support


def _departure(place: Place) -> str:
    first = place.signatures[0] if place.signatures else None
    away = f"is {quantity(place.sizes.gap, place.sizes.deviation)} away from where the simulation has it"
    if first is None or first.explained < _CLEAR or abs(first.size) < 2.0 * first.size_deviation:
        return away
    words = {"offset": _offset_words, "lag": _lag_words, "swing": _swing_words}[first.kind](first)
    return f"{words}" if first.explained > 0.5 else f"{words}, which is {first.explained:.0%} of the gap"


def _lag_words(signature: Signature) -> str:
    verb = "lags behind" if signature.value > 0 else "is ahead of"
    late = f"{1e3 * abs(signature.value):.0f} ms"
    return f"{verb} the simulation by {quantity(signature.size, signature.size_deviation)} ({late})"


def _swing_words(signature: Signature) -> str:
    verb = "less" if signature.value < 0 else "further"
    share = f"{abs(signature.value):.0%}"
    return f"moves {verb} than the simulation, by {quantity(signature.size, signature.size_deviation)} ({share})"


def _offset_words(signature: Signature) -> str:
    size = quantity(signature.size, signature.size_deviation)
    x, y, z = signature.direction
    if abs(z) > 0.8:
        return f"is {size} {'higher' if z > 0 else 'lower'} than the simulation has it"
    heading = (("+x", "-x"), ("+y", "-y"))[int(abs(y) > abs(x))][int((x if abs(x) >= abs(y) else y) < 0)]
    if abs(z) < 0.45:
        return f"is {size} off to the side, towards {heading}"
    return f"is {size} off, {'up' if z > 0 else 'down'} and towards {heading}"


def _before(where: Where) -> str:
    if where.onset is None or where.onset.frame <= 2:
        return ""
    quiet = where.frame_log10_p[: where.onset.earliest]
    if len(quiet) == 0 or _loud(quiet, len(where.frames)).any():
        return ""
    return "; nothing wrong before"


def _loud(log10_p: Float[Array, " n"], frames: int) -> Bool[Array, " n"]:
    """Which frames alone, among so many, would raise an alarm."""
    return log10_p < np.log10(0.01 / frames)


def quantity(size: float, deviation: float) -> str:
    """A length [m] with its 90 % half width, in millimetres: "9 ± 2 mm"."""
    half = 1e3 * _HALF_WIDTH * deviation
    digits = 0 if half >= 1.0 else 1
    return f"{1e3 * abs(size):.{digits}f} ± {max(half, 10.0**-digits):.{digits}f} mm"


def millimetres(size: float) -> str:
    """A length [m]: "1.2 mm"."""
    return f"{1e3 * size:.1f} mm"
