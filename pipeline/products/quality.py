"""What a reader should know of the frames, and of the masks and tracks, before trusting results."""

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pipeline.products._files import run_again, write_record
from pipeline.reading.text import read_record

FILE = "quality.json"


@dataclass(frozen=True)
class Quality:
    """quality.json of parse_video.

    Attributes:
        kind: of the capture, video or tracks.
        frames: how many.
        support_plane: how well the plane fits and how far the world is from it; empty without depth.
        warnings: sentences for the reader.
        brightness: mean grey level of every frame, 0 to 255.
        sharpness: variance of every frame's Laplacian [grey levels squared].
        depth_share: share of every frame's pixels with a usable reading; empty without depth.
        repeated: frames with the same pixels as the one before.
    """

    kind: str
    frames: int
    support_plane: dict[str, Any] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    brightness: list[float] = field(default_factory=list)
    sharpness: list[float] = field(default_factory=list)
    depth_share: list[float] = field(default_factory=list)
    repeated: list[int] = field(default_factory=list)

    def save(self, folder: Path) -> None:
        """Write quality.json."""
        write_record(folder / FILE, dataclasses.asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "Quality":
        """Read quality.json, InputError where it or a key is missing."""
        names = [entry.name for entry in dataclasses.fields(cls)]
        record = read_record(folder / FILE, names, run_again("parse_video"))
        return cls(**{name: record[name] for name in names})


@dataclass(frozen=True)
class PerceptionQuality:
    """quality.json of segment_and_track.

    Attributes:
        warnings: sentences for the reader, each with what to do.
        doubts: the same by rule: `kind`, `frames`, `sentence`.
        sure: how sure the choice of the object in frame 0 is (0.5: the next best is as good, 1: nothing else fits).
        hints: hints.object that would name the chosen object, and the next best one; empty where nothing else fits.
        keyframes: numbers of every thing on its keyframes, as of `physreal_core.perception.association.NUMBERS`.
    """

    warnings: list[str] = field(default_factory=list)
    doubts: list[dict[str, Any]] = field(default_factory=list)
    sure: float = 1.0
    hints: list[dict[str, Any]] = field(default_factory=list)
    keyframes: dict[str, dict[str, dict[str, float]]] = field(default_factory=dict)

    def save(self, folder: Path) -> None:
        """Write quality.json."""
        write_record(folder / FILE, dataclasses.asdict(self))

    @classmethod
    def load(cls, folder: Path) -> "PerceptionQuality":
        """Read quality.json, InputError where it or a key is missing."""
        names = [entry.name for entry in dataclasses.fields(cls)]
        record = read_record(folder / FILE, names, run_again("segment_and_track"))
        return cls(**{name: record[name] for name in names})
