"""The score of rows, written where the project keeps its results: of one set, or of all sets that one commit searched."""

from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks.gap.cases import SHAPE_OF, GapCase, Variant
from benchmarks.gap.figures import draw_confusion, draw_reliability
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.rows import Row, put_rows, read_rows, row_of, rows_file
from benchmarks.gap.scoring import judge, sizes_of
from benchmarks.gap.summary import summary
from benchmarks.gap.table import RGBD_AIMS, page
from physreal_core.effects import EFFECTS

TITLES = {
    "tracks_only": "Hidden effects, from tracks alone",
    "rgbd": "Hidden effects, from RGB-D",
    "rgbd_seen": "Hidden effects, from RGB-D with the shape that the camera saw",
    "thin": "Hidden effects in a rope and a cloth, from tracks alone",
}


def collect(cases: Iterable[GapCase], folder: Path, rows: Path, variant: Variant, seed: int) -> list[Row]:
    """The rows of those cases in `folder` that have been run; they are put into the set's file in the folder `rows`."""
    found = [row_of(case, folder / case.name, variant=variant, seed=seed) for case in cases]
    known = [row for row in found if row is not None]
    if known:
        put_rows(rows_file(rows, variant, seed), known)
    return known


def pool(rows: Path, variant: Variant, commit: str | None = None) -> tuple[str | None, list[Row]]:
    """All rows that one commit searched, over all sets.

    Args:
        rows: folder with the files of the sets.
        variant: which part.
        commit: as its rows state it, or the beginning of that; None: the one with the most rows.

    Returns:
        The commit, None where there is no row of it; and its rows, the last of each case.
    """
    known = [row for path in sorted(rows.glob(f"{variant}-seed*.jsonl")) for row in read_rows(path)]
    matching = [row["commit"] for row in known if commit is None or row["commit"].startswith(commit)]
    if not matching:
        return None, []
    ((chosen, _),) = Counter(matching).most_common(1)
    return chosen, list({row["case"]: row for row in known if row["commit"] == chosen}.values())


def write_results(variant: Variant, rows: Sequence[Row], results: Path, not_run: int = 0) -> str:
    """`gap_benchmark.json` (this variant's part of it), `gap_benchmark_<variant>.md` and the figures, in `results`.

    Args:
        variant: which part.
        rows: of the cases that have been run.
        results: folder.
        not_run: how many cases of the set have no row: they are counted as missing, not as wrong.

    Returns:
        The page.
    """
    if not rows:
        return "no case has been run yet"
    sizes = {name: sizes_of(effect.coefficients) for name, effect in EFFECTS.items()}
    judged = [judge(row, sizes) for row in rows]
    numbers = {**_origin(rows), **summary(judged)}
    numbers["counts"]["not_run"] = not_run
    text = page(TITLES[variant], numbers, judged, RGBD_AIMS if variant in SHAPE_OF else None)
    path = results / "gap_benchmark.json"
    write_json(path, {**(read_json(path) or {}), variant: numbers})
    (results / f"gap_benchmark_{variant}.md").write_text(text)
    if numbers["confusion_matrix"]["counts"]:  # pairs are not in it
        draw_confusion(results / f"gap_confusion_{variant}.png", numbers["confusion_matrix"], TITLES[variant])
    draw_reliability(results / f"gap_reliability_{variant}.png", numbers["reliability"], TITLES[variant])
    return text


def _origin(rows: Sequence[Row]) -> dict[str, Any]:
    """Which sets and commits the rows are of; `seed` is the set's, or that of the first of several."""
    seeds, commits = sorted({row["set"] for row in rows}), sorted({row["commit"] for row in rows})
    return {"seed": seeds[0], "seeds": seeds, "commits": commits}
