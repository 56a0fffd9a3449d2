"""How well every model does: metrics per interval, scores per frame."""

import csv
import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from physreal_core.evaluation.scores import FrameScores
from pipeline.products._files import run_again, write_record
from pipeline.reading.text import read_record, read_rows, understood

METRICS, FRAMES = "metrics.json", "frames.csv"
_NAMES = [field.name for field in dataclasses.fields(FrameScores)]
_COUNTS = ("frame", "track_count", "measured_track_count")


@dataclass(frozen=True)
class Scores:
    """metrics.json and frames.csv of evaluate, by fit stage. SI units; IoU is 0 to 1.

    Attributes:
        metrics: `observed` and `future`, as `IntervalScores.to_json` gives them; beside them `tip` and `truth`.
        frames: scores of every frame.
        observed: frames [0, observed) were seen by the fits.
    """

    metrics: Mapping[str, dict[str, Any]]
    frames: Mapping[str, Sequence[FrameScores]]
    observed: int

    def save(self, folder: Path) -> None:
        """Write both files; in frames.csv a cell is empty where a score does not apply."""
        write_record(folder / METRICS, dict(self.metrics))
        with (folder / FRAMES).open("w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["stage", "interval", *_NAMES])
            for stage, rows in self.frames.items():
                for row in rows:
                    cells = [getattr(row, name) for name in _NAMES]
                    shown = ["" if v is None else f"{v:.6g}" if isinstance(v, float) else v for v in cells]
                    writer.writerow([stage, "observed" if row.frame < self.observed else "future", *shown])

    @classmethod
    def load(cls, folder: Path) -> "Scores":
        """Read both files, InputError where one is missing."""
        metrics = read_record(folder / METRICS, (), run_again("evaluate"))
        frames: dict[str, list[FrameScores]] = {}
        observed = 0
        rows = read_rows(folder / FRAMES, ("stage", "interval", *_NAMES), run_again("evaluate"))
        for index, row in enumerate(rows):
            scores = _frame(row, f"{folder / FRAMES}, row {index}")
            frames.setdefault(row["stage"], []).append(scores)
            if row["interval"] == "observed":
                observed = max(observed, scores.frame + 1)
        return cls(metrics, frames, observed)

    def curves(self, score: str, scale: float = 1.0) -> dict[str, dict[int, float]]:
        """Fit stage → frame → `scale` times a score, where it applies."""
        return {
            stage: {row.frame: scale * value for row in rows if (value := getattr(row, score)) is not None}
            for stage, rows in self.frames.items()
        }


def _frame(row: dict[str, str], where: str) -> FrameScores:
    given = {name: row[name] for name in _NAMES if row[name]}
    with understood(where, run_again("evaluate")):
        return FrameScores(**{name: int(cell) if name in _COUNTS else float(cell) for name, cell in given.items()})
