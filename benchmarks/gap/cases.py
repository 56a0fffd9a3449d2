"""Which captures the benchmark consists of: every effect at three strengths, controls without any, pairs, and strangers.

A case's seed follows from its name and the benchmark's, so that a longer list leaves the cases of a shorter one as they were.
"""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatch
from typing import Literal

Kind = Literal["none", "single", "pair", "outside"]
Variant = Literal["tracks_only", "rgbd"]
STRENGTHS = ("weak", "middle", "high")
CONTROLS = {"tracks_only": 24, "rgbd": 5}

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
}
"""Effects that are not in the library, and the names in it that would be physically nearest."""


@dataclass(frozen=True)
class GapCase:
    """One hidden-effect capture.

    Args:
        effect: name of the registry, `none`, `a+b` or `outside:<name>`.
        strength: how far it moves the tracks; of no meaning for `none`.
        seed: of material, motions and noise.
    """

    effect: str
    strength: str
    seed: int

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

    @property
    def name(self) -> str:
        """Name of its folder."""
        return f"{self.effect.replace(':', '.')}-{self.strength}-{self.seed:06d}"

    @classmethod
    def named(cls, name: str) -> "GapCase":
        """The case whose folder has this name."""
        effect, strength, seed = name.rsplit("-", 2)
        return cls(effect.replace("outside.", "outside:"), strength, int(seed))


def benchmark_cases(effects: Iterable[str], *, variant: Variant, seed: int = 0) -> list[GapCase]:
    """All cases in an order whose every beginning is a fair sample: middle and high before weak, controls in between.

    Args:
        effects: names of the library.
        variant: `tracks_only`: everything; `rgbd`: each effect at high strength once, and few controls.
        seed: of the benchmark; another one gives another set.
    """
    known = list(effects)
    controls = [_case("none", "middle", seed, number) for number in range(CONTROLS[variant])]
    if variant == "rgbd":
        return _interleaved([_case(effect, "high", seed) for effect in known], controls)
    pairs = [_case(pair, "high", seed) for pair in PAIRS if set(pair.split("+")) <= set(known)]
    strangers = [_case(f"outside:{name}", strength, seed) for strength in ("high", "middle") for name in NEAREST]
    strong = [_case(effect, strength, seed) for strength in ("high", "middle") for effect in known]
    weak = [_case(effect, "weak", seed) for effect in known]
    return _interleaved(strong, controls + pairs + strangers) + weak


def calibration_cases(effects: Iterable[str], count: int, *, seed: int = 0) -> list[GapCase]:
    """Captures that are in no benchmark, on which numbers of the search are set: every other one without an effect."""
    known = list(effects)
    hidden = [known[(3 * number) % len(known)] for number in range(count // 2)]
    singles = [_case(name, ("high", "middle")[i % 2], seed, -1 - i) for i, name in enumerate(hidden)]
    return _interleaved([_case("none", "middle", seed, -1 - number) for number in range(count - len(singles))], singles)


def chosen(cases: list[GapCase], patterns: Iterable[str]) -> list[GapCase]:
    """Those whose names fit one of the patterns (`linear_drag-*`); all where there is no pattern."""
    wanted = list(patterns)
    return [case for case in cases if not wanted or any(fnmatch(case.name, pattern) for pattern in wanted)]


def _case(effect: str, strength: str, seed: int, number: int = 0) -> GapCase:
    return GapCase(effect, strength, zlib.crc32(f"{effect} {strength} {seed} {number}".encode()) % 1_000_000)


def _interleaved(many: list[GapCase], few: list[GapCase]) -> list[GapCase]:
    """Both lists in their own order, mixed evenly."""
    if not few:
        return many
    places = [(index + 0.5) / len(many) for index in range(len(many))]
    others = [(index + 0.5) / len(few) for index in range(len(few))]
    ordered = sorted(zip(places + others, many + few, strict=True), key=lambda pair: pair[0])
    return [case for _, case in ordered]
