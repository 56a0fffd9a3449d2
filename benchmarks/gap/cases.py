"""Which captures the benchmark consists of: every effect at two strengths and some more, controls without any, pairs, and strangers; and,
as a part of its own, what acts on a rope and on a cloth.

Bodies and forms are dealt out as in a Latin square whose rows a seed has shuffled: every body comes about equally often, no effect
twice with the same body, and a law of another form as often as the library's own where there is one. Motions, frame rates and what
is off follow from a case's own seed (`data/rig/session.py`).
"""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatch
from itertools import zip_longest
from typing import Literal

import numpy as np

Kind = Literal["none", "single", "pair", "outside"]
Variant = Literal["tracks_only", "rgbd", "rgbd_seen", "thin"]
SHAPE_OF = {"rgbd": "given", "rgbd_seen": "seen"}
"""Parts that go through the whole pipeline, of the same cases, and whose shape the object has: the rig's, or the one that the camera saw."""

STRENGTHS = ("weak", "middle", "high")
CONTROLS = {"tracks_only": 20, "rgbd": 10, "rgbd_seen": 10, "thin": 6}  # of thin bodies for each
FURTHER = 8  # single effects of middle and high strength beyond one each
WEAK = 9  # effects that are tried at weak strength

PAIRS = (
    "gravity+kelvin_voigt",
    "grip_slip+linear_drag",
    "kelvin_voigt+payload",
    "ground_adhesion+soft_spot",
    "grip_compliance+quadratic_drag",
    "maxwell_creep+wind",
    "camera_drift+payload",
    "fibres+linear_drag",
    "grip_lag+kelvin_voigt",
    "obstacle_post+wind",
)
"""Two at once, of different families, one of which would not hide the other."""

NEAREST = {
    "magnet": ("gravity", "wind", "ground_adhesion", "payload", "density_gradient"),
    "breathing": ("rest_shape", "maxwell_creep", "plastic_yield"),
    "turntable": ("gravity", "wind", "quadratic_drag"),
    "tether": ("ground_adhesion", "wind", "gravity", "obstacle_post"),
    "charge": ("gravity", "wind", "payload", "density_gradient"),
    "gradient_field": ("wind", "gravity", "density_gradient"),
    "gyration": ("linear_drag", "quadratic_drag", "wind"),
}
"""Effects that are not in the library, and the names in it that would be physically nearest."""

_ATTRACTION = "(p - x) / |p - x|^3"
LEADING = {
    "magnet": (_ATTRACTION,),
    "breathing": ("x - centre",),
    "turntable": ("ez \u00d7 v", "x ex", "y ey"),
    "tether": (_ATTRACTION, "z ez"),
    "charge": (_ATTRACTION,),
    "gradient_field": ("x ey",),
    "gyration": ("ez \u00d7 v",),
}
"""Of the same: the terms of `physreal_core.gap.lead.force_library`, any of which is the right first term of a formula. A turning table
gives Coriolis' force and the centrifugal one; a cord pulls towards its foot, the more the higher its end is."""


OF_THE_RIG = {"cloth": ("kelvin_voigt",)}
"""Effects that a body has in the rig whatever is hidden: MuJoCo's implicit step damps a cloth as a retardation time as long as the step, 0.5 ms.
An answer may name them beside the truth or leave them out."""


@dataclass(frozen=True)
class GapCase:
    """One hidden-effect capture.

    Args:
        effect: name of the registry, `none`, `a+b` or `outside:<name>`.
        strength: how large it is; of no meaning for `none`.
        seed: of size, material, motions and noise.
        body: name of the body.
        form: `same` as the library's law, or `other`, where there is one.
    """

    effect: str
    strength: str
    seed: int
    body: str = "bar"
    form: str = "same"

    @property
    def kind(self) -> Kind:
        """What is hidden."""
        if self.effect == "none" or self.effect.startswith("outside:"):
            return "none" if self.effect == "none" else "outside"
        return "pair" if "+" in self.effect else "single"

    @property
    def truth(self) -> tuple[str, ...]:
        """Names of the library that are right, sorted; none for what is outside it."""
        return tuple(sorted(self.effect.split("+"))) if self.kind in ("single", "pair") else ()

    def hidden_of(self, names: Iterable[str]) -> tuple[str, ...]:
        """These names, sorted, without those of what the rig's body has whatever is hidden."""
        own = {*OF_THE_RIG.get(self.body, ())} - {*self.truth}
        return tuple(sorted(name for name in names if name not in own))

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.effect.replace(':', '.')}-{self.strength}-{self.body}-{self.form}-{self.seed:06d}"

    @classmethod
    def named(cls, name: str) -> "GapCase":
        """The case whose folder has this name."""
        effect, strength, body, form, seed = name.rsplit("-", 4)
        return cls(effect.replace("outside.", "outside:"), strength, int(seed), body, form)


def benchmark_cases(effects: Iterable[str], *, variant: Variant, seed: int = 0) -> list[GapCase]:
    """All cases in an order whose every beginning is a fair sample: middle and high before weak, controls in between.

    Args:
        effects: names of the library.
        variant: `tracks_only`: everything; `rgbd`, `rgbd_seen`: each effect at high strength once, and few controls; `thin`: of a rope and
            a cloth from tracks alone, each effect that acts on it once, and controls.
        seed: of the benchmark; another one gives another set.
    """
    if variant == "thin":
        return [case for pair in zip_longest(*_thin_cases(effects, seed)) for case in pair if case is not None]
    deal = _Deal(sorted(_acting_on("volume", effects)), seed)
    controls = [deal.case("none", "middle", number, number) for number in range(CONTROLS[variant])]
    high = [deal.single(effect, "high") for effect in deal.effects]
    if variant in SHAPE_OF:
        return _interleaved(high, controls)
    middle = [deal.single(effect, "middle") for effect in deal.effects]
    further = [deal.single(effect, ("high", "middle")[i % 2], 2) for i, effect in enumerate(deal.effects[:FURTHER])]
    pairs = [deal.case(p, "high", i) for i, p in enumerate(PAIRS) if set(p.split("+")) <= set(deal.effects)]
    strangers = [deal.case(f"outside:{name}", "high", i + 2) for i, name in enumerate(NEAREST)]
    again = list(NEAREST)[deal.shift % len(NEAREST)]
    strangers.append(deal.case(f"outside:{again}", "middle", len(strangers)))
    weak = [deal.single(effect, "weak", 3) for effect in deal.effects[-WEAK:]]
    return _interleaved(high + middle + further, controls + pairs + strangers) + weak


def _thin_cases(effects: Iterable[str], seed: int) -> list[list[GapCase]]:
    """Of each thin body: in a shuffled order its effects, of high and middle strength in turn, and by a law of another form in two of four."""
    # not at the top: rows are scored where there is no rig
    from data.rig.bodies import THIN_BODIES
    from data.rig.hidden.forms import OTHER_FORMS, VOLUMES_ALONE

    other, known, found = {*OTHER_FORMS} - {*VOLUMES_ALONE}, sorted(effects), []
    for number, body in enumerate(THIN_BODIES, start=10):
        random = np.random.default_rng([seed, 8, number])
        acting = _acting_on(body, known)
        shuffled, singles = [acting[i] for i in random.permutation(len(acting))], []
        for i, effect in enumerate(shuffled):
            strength, form = ("high", "middle")[i % 2], "other" if effect in other and i % 4 > 1 else "same"
            singles.append(GapCase(effect, strength, _seed(effect, strength, seed, number), body, form))
        controls = [
            GapCase("none", "middle", _seed("none", "middle", seed, 100 * number + i), body)
            for i in range(CONTROLS["thin"])
        ]
        found.append(_interleaved(singles, controls))
    return found


def _acting_on(body: str, effects: Iterable[str]) -> list[str]:
    """Effects of the library that act on a thin body, or on a volume."""
    from physreal_core.effects import EFFECTS, lacking
    from physreal_core.simulation import Body, rod_body, shell_body

    make = {
        "volume": lambda: Body(np.eye(3), np.ones(3), np.ones(3), 1.0),
        "rope": lambda: rod_body(np.outer(np.arange(3.0), np.eye(3)[0]), 0.1, 1.0),
        "cloth": lambda: shell_body(np.eye(3), np.array([[0, 1, 2]]), 0.1, 1.0),
    }
    sample = make[body]()
    return [name for name in effects if not lacking(EFFECTS[name], sample)]


class _Deal:
    """Deals out bodies and forms, from a seed.

    Attributes:
        effects: shuffled.
        shift: where the bodies begin.
    """

    def __init__(self, effects: Sequence[str], seed: int) -> None:
        # not at the top: rows are scored where there is no rig
        from data.rig.bodies import BODIES
        from data.rig.hidden.forms import OTHER_FORMS

        random = np.random.default_rng([seed, 7])
        self.effects = [effects[i] for i in random.permutation(len(effects))]
        self.shift = int(random.integers(1000))
        self._bodies = [list(BODIES)[i] for i in random.permutation(len(BODIES))]
        self._seed, self._other_forms = seed, set(OTHER_FORMS)

    def single(self, effect: str, strength: str, column: int | None = None) -> GapCase:
        """Of one effect, in a column of the square: those of middle, high, further and weak cases."""
        row, column = self.effects.index(effect), STRENGTHS.index(strength) - 1 if column is None else column
        return self.case(
            effect, strength, row + column, column, other=(row // len(self._bodies) + row + column) % 2 == 1
        )

    def case(self, effect: str, strength: str, place: int, number: int = 0, *, other: bool | None = None) -> GapCase:
        """With the body at a place in their order; every second one by a law of another form if nothing is said."""
        body = self._bodies[(self.shift + place) % len(self._bodies)]
        known = any(name in self._other_forms for name in effect.split("+"))
        form = "other" if known and (place % 2 == 1 if other is None else other) else "same"
        return GapCase(effect, strength, _seed(effect, strength, self._seed, number), body, form)


def calibration_cases(effects: Iterable[str], count: int, *, seed: int = 0) -> list[GapCase]:
    """Captures that are in no benchmark, on which numbers of the search are set: every other one without an effect."""
    known = _acting_on("volume", effects)
    deal = _Deal(sorted(known), seed)
    hidden = [known[(3 * number) % len(known)] for number in range(count // 2)]
    singles = [deal.case(name, ("high", "middle")[i % 2], i, -1 - i) for i, name in enumerate(hidden)]
    controls = [deal.case("none", "middle", number, -1 - number) for number in range(count - len(singles))]
    return _interleaved(controls, singles)


def chosen(cases: list[GapCase], patterns: Iterable[str]) -> list[GapCase]:
    """Those whose names fit one of the patterns (`linear_drag-*`); all where there is no pattern."""
    wanted = list(patterns)
    return [case for case in cases if not wanted or any(fnmatch(case.name, pattern) for pattern in wanted)]


def _seed(effect: str, strength: str, seed: int, number: int) -> int:
    return zlib.crc32(f"{effect} {strength} {seed} {number}".encode()) % 1_000_000


def _interleaved(many: list[GapCase], few: list[GapCase]) -> list[GapCase]:
    """Both lists in their own order, mixed evenly."""
    if not few:
        return many
    places = [(index + 0.5) / len(many) for index in range(len(many))]
    others = [(index + 0.5) / len(few) for index in range(len(few))]
    ordered = sorted(zip(places + others, many + few, strict=True), key=lambda pair: pair[0])
    return [case for _, case in ordered]
