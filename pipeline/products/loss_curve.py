"""The objective and its terms over a descent, one row per evaluation."""

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.reading.text import read_rows, understood

FILE = "loss.csv"


@dataclass(frozen=True)
class LossCurve:
    """loss.csv of a fit stage.

    Attributes:
        rows: column → value, where it applies. `iteration`; `horizon` [frames]; `rejected` steps; `total`, the
            objective; its terms, unweighted; means of the variables in the units of `fitting.model.UNITS`.
    """

    rows: Sequence[dict[str, Any]]

    def save(self, folder: Path) -> None:
        """Write loss.csv."""
        columns = list(dict.fromkeys(name for row in self.rows for name in row))
        with (folder / FILE).open("w", newline="") as file:
            writer = csv.DictWriter(file, columns, restval="")
            writer.writeheader()
            writer.writerows(
                {name: f"{v:.9g}" if isinstance(v, float) else v for name, v in row.items()} for row in self.rows
            )

    @classmethod
    def load(cls, folder: Path) -> "LossCurve":
        """Read loss.csv, InputError where there is none; all values are floats."""
        remedy = "run the fit stage again"
        rows = read_rows(folder / FILE, remedy=remedy)
        with understood(folder / FILE, remedy):
            return cls([{name: float(cell) for name, cell in row.items() if cell} for row in rows])

    def of(self, column: str) -> list[float]:
        """One column, in the order of the evaluations, where it applies."""
        return [row[column] for row in self.rows if column in row]
