"""What a fit stage found and how, in numbers for tables and report; the model itself lies beside it."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.products._files import write_record
from pipeline.reading.text import read_record, understood

FILE = "fit.json"
_SHARES = ("residual", "residual_without_effect")
_PLAIN = ("scan", "grip_reaches", "left_out")
_FURTHER = (*_PLAIN, *_SHARES, "confirmation", "valley")


@dataclass(frozen=True)
class Descent:
    """How a descent went.

    Attributes:
        objective: the least; None where it never was finite.
        iterations: steps taken.
        ended_early: why it stopped before the last step; None where it did not.
        observed_frames, fitted_frames: frames that the fit may see, and those it was fitted on in the end.
        particles, patches: how many.
    """

    objective: float | None
    iterations: int
    ended_early: str | None
    observed_frames: int
    fitted_frames: int
    particles: int
    patches: int


@dataclass(frozen=True)
class ResidualShare:
    """What the residual networks do.

    Attributes:
        stress_share: their stress over the expert law's; None where they add no stress.
        objective_before, objective_after: without and with them; None where it is not finite.
    """

    stress_share: float | None
    objective_before: float | None
    objective_after: float | None


@dataclass(frozen=True)
class Confirmed:
    """What a change does to the objective where its fit did not look.

    Attributes:
        recordings: names of the recordings.
        before, after: the objective in each, without and with the change; None where it is not finite.
    """

    recordings: list[str]
    before: list[float | None]
    after: list[float | None]


@dataclass(frozen=True)
class Valley:
    """Two numbers that the measurement does not tell apart: a softer body in a firmer hold moves nearly alike.

    Attributes:
        names: of both.
        correlation: of their logarithms.
        ends: both numbers at the two ends of the 90 % interval along the way in which they are known least [SI units].
    """

    names: list[str]
    correlation: float
    ends: list[list[float]]


_RECORDS = {"confirmation": Confirmed, "valley": Valley}


@dataclass(frozen=True)
class Fit:
    """fit.json of the fit stages and of add_effect.

    Attributes:
        values: name of a quantity → its `value`, or `mean`, `min` and `max`, its `unit`, and where it is known the 90 % `interval` of
            value or mean.
        descent: None where nothing descended (add_effect).
        scan: objectives of the scan before Stage 1's descent, in its order; None for the other stages.
        grip_reaches: of Stage 1, each distance up to which the hand holds, and its objective; None where there was no choice.
        residual: of Stage 3's networks; None for the other stages.
        residual_without_effect: the same of networks fitted without the named effect, where that was done.
        confirmation: of Stage 3's networks on frames that they were not fitted to; None where none were kept back.
        left_out: why the stage passed the model on as it was; None where it did not.
        valley: of modulus and hold; None where the measurement tells them apart, or nothing is said of it.
    """

    values: dict[str, dict[str, Any]]
    descent: Descent | None = None
    scan: list[dict[str, Any]] | None = None
    grip_reaches: list[dict[str, Any]] | None = None
    residual: ResidualShare | None = None
    residual_without_effect: ResidualShare | None = None
    confirmation: Confirmed | None = None
    left_out: str | None = None
    valley: Valley | None = None

    def save(self, folder: Path) -> None:
        """Write fit.json, leaving out what does not apply."""
        plain = dataclasses.asdict(self)
        further = {name: plain[name] for name in _FURTHER if plain[name] is not None}
        write_record(folder / FILE, {"values": self.values, **(plain["descent"] or {}), **further})

    @classmethod
    def load(cls, folder: Path) -> "Fit":
        """Read fit.json, InputError where it or its values are missing."""
        remedy = "run the fit stage again"
        record = read_record(folder / FILE, ("values",), remedy)
        names = [field.name for field in dataclasses.fields(Descent)]
        with understood(folder / FILE, remedy):
            descent = Descent(**{name: record[name] for name in names}) if names[0] in record else None
            shares = {name: ResidualShare(**record[name]) for name in _SHARES if name in record}
            further = {name: record.get(name) for name in _PLAIN}
            further |= {name: kind(**record[name]) for name, kind in _RECORDS.items() if name in record}
            return cls(record["values"], descent, **further, **shares)
