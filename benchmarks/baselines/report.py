"""`results/baselines.md`, of rows that were measured."""

from typing import Any

from benchmarks.baselines.methods import METHODS
from benchmarks.baselines.spring_simulator import MOST_SUBSTEPS

HEAD = """# Other methods on the same sequences

Every method was given what our fit is given: the particles of the body, the hand's path and the tracks of the observed frames; the rows of ours silhouettes,
too, where the capture is a video and the name does not say otherwise. The shape is given, as in the example. All ran on one machine, one after another.
Spring–mass and graph network may take {seconds:g} s; the springs end earlier where they ask for more than {substeps} substeps a frame. The others end by themselves.
{machine}. `python -m benchmarks.baselines --project FOLDER --seconds {seconds:g}`.

Tracks: mean distance from the measured ones, which are noisy. True: mean distance of the body's vertices from the truth. Other motion: the same over all
frames of a motion of the same body that no fit saw, where it lies in another place. All in mm.
"""


def page(measured: dict[str, Any]) -> str:
    """A table for each sequence.

    Args:
        measured: `machine`, `seconds` that a method may take, and `rows`, as baselines.json has them.
    """
    rows = measured["rows"]
    lines = [HEAD.format(seconds=measured["seconds"], machine=measured["machine"], substeps=MOST_SUBSTEPS)]
    for sequence in dict.fromkeys(row["sequence"] for row in rows):
        own = sorted((r for r in rows if r["sequence"] == sequence), key=lambda r: list(METHODS).index(r["method"]))
        lines += [f"## {sequence}", "", *_table(own), ""]
    return "\n".join(lines)


def _table(rows: list[dict[str, Any]]) -> list[str]:
    others = list(rows[0]["other_motions"])
    heads = ["tracks observed", "tracks future", "true observed", "true future"]
    heads += [f"true, other motion ({name})" for name in others]
    lines = [f"| method | {' | '.join(heads)} | numbers | s | GB |", "|---|" + "--:|" * (len(heads) + 3)]
    for row in rows:
        spans = (row["observed"], row["future"])
        errors = [own[name] for name in ("track_error", "vertex_error") for own in spans]
        errors += [row["other_motions"][name]["vertex_error"] for name in others]
        cells = [f"{1e3 * error:.2f}" for error in errors]
        cells += [str(row["numbers"]), f"{row['seconds']:.0f}", f"{row['memory'] / 1e9:.1f}"]
        lines.append(f"| {row['words']} | {' | '.join(cells)} |")
    return lines
