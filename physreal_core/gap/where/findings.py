"""What is found where a simulation and its measurement disagree."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from physreal_core.array_types import Array, Float
from physreal_core.gap.where.comparison import Agreement, Sizes
from physreal_core.gap.where.signatures import Signature

SIGNIFICANT = 0.01
"""Probability of a false alarm."""


@dataclass(frozen=True)
class Onset:
    """The frames in which the disagreement can be seen.

    Args:
        frame: first frame of the first long enough stretch in which it is certain.
        earliest: frame from which on, up to `frame`, it is likely. It may have begun there.
        last: last frame in which it is certain.
    """

    frame: int
    earliest: int
    last: int


@dataclass(frozen=True)
class Cell:
    """Disagreement in one kind of situation.

    Args:
        axis: `motion`, `support` or `part`.
        label: value on that axis, as "swinging", "on the ground", "far end".
        entries: number of measurements in the situation.
        sizes: root mean square distances.
        signatures: patterns of the departure, the one that explains most first.
    """

    axis: str
    label: str
    entries: int
    sizes: Sizes
    signatures: tuple[Signature, ...]


@dataclass(frozen=True)
class Place:
    """The situation in which the disagreement is greatest.

    Args:
        motion, support, part: labels as of `Cell`; None on an axis that does not matter.
        sizes: root mean square distances there, between onset and end.
        signatures: patterns of the departure there.
    """

    motion: str | None
    support: str | None
    part: str | None
    sizes: Sizes
    signatures: tuple[Signature, ...]


@dataclass(frozen=True)
class Where:
    """The disagreement of one interaction.

    Args:
        test: whether there is a disagreement beyond noise and numerical error.
        sizes: root mean square distances over all entries.
        noise_scale: estimated noise over the stated noise.
        onset: when it can be seen; None where no lasting disagreement is seen.
        frames: root mean square distances per frame, shape [T].
        frame_log10_p: decimal logarithm of the p-value of each frame's own test, shape [T].
        tracks: root mean square distances per track, shape [J].
        departure: mean of measured - simulated per track, between onset and end [m], shape [J, 3].
        cells: the disagreement by motion, support and part.
        place: situation in which it is greatest; None where there is no disagreement.
        spans: stretches of one motion: (motion, first frame, frame after the last).
        sentence: for a person.
    """

    test: Agreement
    sizes: Sizes
    noise_scale: float
    onset: Onset | None
    frames: tuple[Sizes, ...]
    frame_log10_p: Float[Array, " T"]
    tracks: tuple[Sizes, ...]
    departure: Float[Array, "J 3"]
    cells: tuple[Cell, ...]
    place: Place | None
    spans: tuple[tuple[str, int, int], ...]
    sentence: str = ""

    @property
    def significant(self) -> bool:
        """Whether there is a disagreement that noise and numerical error do not explain."""
        return self.test.p_value < SIGNIFICANT

    def as_record(self) -> dict[str, Any]:
        """The finding as plain values, ready for JSON."""
        record = asdict(self)
        for name in ("frames", "tracks"):  # one list per number is shorter than one record per frame
            sizes = record[name]
            record[name] = {key: [entry[key] for entry in sizes] for key in sizes[0]}
        for name in ("frame_log10_p", "departure"):
            record[name] = record[name].tolist()
        return record | {"significant": self.significant}
