"""A table of ready text, written as Markdown and CSV."""

import csv
from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Table:
    """A caption, headings, and rows of ready text."""

    caption: str
    headings: list[str]
    rows: list[list[str]]

    def markdown(self) -> str:
        lines = [self.headings, ["---"] * len(self.headings), *self.rows]
        return f"{self.caption}\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"

    def write(self, folder: Path, name: str) -> None:
        """<name>.md and <name>.csv."""
        (folder / f"{name}.md").write_text(self.markdown())
        with (folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([self.headings, *self.rows])
