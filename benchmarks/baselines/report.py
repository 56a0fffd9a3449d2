"""`results/baselines.md`, of rows that were measured."""

from typing import Any

from benchmarks.baselines.methods import METHODS

_COLUMNS = ("track_error_observed", "track_error_future", "vertex_error_observed", "vertex_error_future")

HEAD = [
    "# Other methods on the same sequences",
    "",
    "Every method was given what our fit is given: the particles of the body, the hand's path and the tracks of the observed frames; those of",
    "ours silhouettes, too, where the capture is a video and the name does not say otherwise. All on one machine, one after another. Spring–mass and graph network",
    "may take as long as the command says; the others end by themselves. `python -m benchmarks.baselines --project FOLDER`.",
    "",
    "Tracks: mean distance from the measured ones, which are noisy. True: mean distance of the body's vertices from the truth. Other motion: the same over all frames",
    "of a motion of the same body that no fit saw, where it lies in another place. All in mm.",
    "",
]


def page(rows: list[dict[str, Any]]) -> str:
    """A table for each sequence, then which method is best where."""
    lines = list(HEAD)
    for sequence in dict.fromkeys(row["sequence"] for row in rows):
        own = sorted((r for r in rows if r["sequence"] == sequence), key=lambda r: list(METHODS).index(r["method"]))
        lines += [f"## {sequence}", "", *_table(own), ""]
    return "\n".join(lines)


def _table(rows: list[dict[str, Any]]) -> list[str]:
    others = [name for name in rows[0] if name.startswith("other_")]
    heads = ["tracks observed", "tracks future", "true observed", "true future", *(_words(name) for name in others)]
    lines = [f"| method | {' | '.join(heads)} | numbers | s | GB |", "|---|" + "--:|" * (len(heads) + 3)]
    for row in rows:
        cells = [f"{1e3 * row[name]:.2f}" for name in (*_COLUMNS, *others)]
        cells += [str(row["numbers"]), f"{row['seconds']:.0f}", f"{row['memory'] / 1e9:.1f}"]
        lines.append(f"| {METHODS[row['method']].words} | {' | '.join(cells)} |")
    return lines


def _words(name: str) -> str:
    return f"other motion ({name.removeprefix('other_')})"
