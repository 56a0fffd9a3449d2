"""The score of all cases in a folder, written where the project keeps its results."""

from collections.abc import Sequence
from pathlib import Path

from benchmarks.gap.cases import GapCase, Variant
from benchmarks.gap.figures import draw_confusion, draw_reliability
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.scoring import read_cases, sizes_of, summary
from benchmarks.gap.table import RGBD_AIMS, page
from physreal_core.effects import EFFECTS

TITLES = {"tracks_only": "Hidden effects, from tracks alone", "rgbd": "Hidden effects, from RGB-D"}


def write_results(variant: Variant, seed: int, folder: Path, cases: Sequence[GapCase], results: Path) -> str:
    """`gap_benchmark.json` (this variant's part of it), `gap_benchmark_<variant>.md` and the figures, in `results`.

    Args:
        variant: which part.
        seed: of the set.
        folder: of the cases.
        cases: the whole set; those without an answer are counted as missing, not as wrong.
        results: folder.

    Returns:
        The page.
    """
    sizes = {name: sizes_of(effect.coefficients) for name, effect in EFFECTS.items()}
    judged, missing = read_cases(folder, cases, sizes)
    if not judged:
        return f"no case has been run yet in {folder}"
    numbers = {"seed": seed, **summary(judged)}
    numbers["counts"]["not_run"] = len(missing)
    text = page(TITLES[variant], numbers, judged, RGBD_AIMS if variant == "rgbd" else None)
    path = results / "gap_benchmark.json"
    write_json(path, {**(read_json(path) or {}), variant: numbers})
    (results / f"gap_benchmark_{variant}.md").write_text(text)
    if numbers["confusion_matrix"]["counts"]:  # pairs are not in it
        draw_confusion(results / f"gap_confusion_{variant}.png", numbers["confusion_matrix"], TITLES[variant])
    draw_reliability(results / f"gap_reliability_{variant}.png", numbers["reliability"], TITLES[variant])
    return text
