"""Stage summarise: one summary.json for `dvc metrics`, tables as Markdown and CSV, curves for `dvc plots`."""

import csv
import json
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path

from pipeline.faults import one_sentence
from pipeline.gap_summary import GapSummary
from pipeline.graph import FIT_STAGES
from pipeline.results import INTERVALS, Results
from pipeline.tables import tables


def run(results: Results) -> None:
    """Write results/summary.json, results/tables and results/plots."""
    folder = results.project.results
    for name in ("tables", "plots"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    (folder / "summary.json").write_text(json.dumps(summary(results), indent=1) + "\n")
    for name, table in tables(results).items():
        table.write(folder / "tables", name)
    _write_curves(folder / "plots" / "loss.csv", "iteration", _losses(results))
    _write_curves(folder / "plots" / "frames.csv", "frame", _track_errors(results))


def summary(results: Results) -> dict:
    """sequences.<name>.<fit stage>.<interval>.<metric>, SI units, with sequences.<name>.shape, given or seen; missing_effect.<name> of every fitted sequence, and baselines.<name>.<method>
    where they were measured; a number that does not apply is absent."""
    own = {
        "missing_effect": {name: _missing(gap) for name in results.sequences if (gap := results.gap(name))},
        "sequences": {
            sequence: {"shape": results.shape(sequence)}
            | {
                stage: {interval: results.scores(sequence, stage, interval) for interval in INTERVALS}
                for stage in FIT_STAGES
                if stage in results.metrics[sequence]
            }
            for sequence in results.sequences
        },
    }
    return own | ({"baselines": _baselines(results)} if results.baselines else {})


def _baselines(results: Results) -> dict:
    """<sequence>.<method>: errors by interval [m], of other motions, and what it cost."""
    named = ("observed", "future", "other_motions", "numbers", "seconds", "memory")
    found: dict = {}
    for row in results.baselines:
        found.setdefault(row["sequence"], {})[row["method"]] = {name: row[name] for name in named}
    return found


def _missing(gap: GapSummary) -> dict:
    """The verdict on a model, and the shares of the gap that what was adopted closes."""
    known = {
        "probability": gap.verdict.probability,
        "closed": gap.after.closed if gap.after.adopted else None,
        "closed_on_other_motion": gap.closed_on_other_motion,
    }
    return {
        "verdict": gap.verdict.kind,
        "named": " + ".join(gap.verdict.names),
        **{name: share for name, share in known.items() if share is not None},
    }


Curves = dict[str, dict[int, list[float]]]  # fit stage → iteration or frame → one value per sequence


def _losses(results: Results) -> Curves:
    """The objective of every fitted sequence."""
    losses = [pair for name in results.sequences for pair in results.losses(name).items()]
    return _collect((stage, int(row["iteration"]), row.get("total")) for stage, loss in losses for row in loss.rows)


def _track_errors(results: Results) -> Curves:
    """The track error of every fitted sequence, per frame [m]."""
    fitted = (name for name in results.sequences if results.model_from(name) is None)
    scored = [pair for name in fitted for pair in results.evaluated(name).frames.items()]
    return _collect((stage, score.frame, score.track_error) for stage, scores in scored for score in scores)


def _collect(entries: Iterable[tuple[str, int, float | None]]) -> Curves:
    curves: Curves = {stage: defaultdict(list) for stage in FIT_STAGES}
    for stage, at, value in entries:
        if value is not None:
            curves[stage][at].append(value)
    return curves


def _write_curves(path: Path, axis: str, curves: Curves) -> None:
    """One column per fit stage, the mean over sequences."""
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow([axis, *curves])
        for at in sorted({at for curve in curves.values() for at in curve}):
            values = [curve.get(at) for curve in curves.values()]
            writer.writerow([at, *(f"{sum(value) / len(value):.6g}" if value else "" for value in values)])


if __name__ == "__main__":
    with one_sentence("summarise"):
        run(Results.open())
