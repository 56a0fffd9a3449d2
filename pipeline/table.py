"""A table of ready text, written as Markdown and CSV."""

import csv
from dataclasses import dataclass
from pathlib import Path
from typing import Any


@dataclass(frozen=True)
class Table:
    """A caption, headings, and rows of ready text."""

    caption: str
    headings: list[str]
    rows: list[list[str]]

    def markdown(self) -> str:
        lines = [self.headings, ["---"] * len(self.headings), *self.rows]
        return f"{self.caption}\n\n" + "\n".join(f"| {' | '.join(line)} |" for line in lines) + "\n"

    def on_terminal(self) -> Any:
        """As rich shows it."""
        from rich.markup import escape
        from rich.table import Table as TerminalTable

        table = TerminalTable(*map(escape, self.headings), title=escape(self.caption), title_justify="left")
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table

    def write(self, folder: Path, name: str) -> None:
        """<name>.md and <name>.csv."""
        (folder / f"{name}.md").write_text(self.markdown())
        with (folder / f"{name}.csv").open("w", newline="") as file:
            csv.writer(file).writerows([self.headings, *self.rows])
