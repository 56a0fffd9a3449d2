"""How well the first stage sees, on filmed clips and on rendered truth: `python -m benchmarks.perception`.

Every sequence goes through the first stage with its default settings, and then through a plain SAM 2 + DIS baseline that
is given the stage's own choice in frame 0. A sequence that is done is kept in the cache until the code changes, so that a
run that was killed goes on. Tables and numbers go to `perception.md` and `perception.json`.
"""

import argparse
import hashlib
import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

from benchmarks.filmed import CLIPS, has_clip, load_clip
from benchmarks.judged import Judged
from benchmarks.perception_report import write_report
from benchmarks.perception_runs import STAGE, TruthOf, run_baseline, run_stage
from benchmarks.recordings import real_data
from benchmarks.rendered import NAMES, load_rendered, true_points
from pipeline.provenance import digest_file, project_modules

ROOT = Path(__file__).resolve().parent.parent
CACHE = ROOT / "data" / "runs" / "perception"
QUICK = 4
"""Frames of a quick run."""
Task = tuple[str, Callable[[], Judged], TruthOf | None]


def main(arguments: list[str] | None = None) -> None:
    """Reads the command line, runs what is not known yet, writes the report."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.perception", description=__doc__)
    parser.add_argument("--clips", action="store_true", help="the filmed clips; without this and --rendered, all")
    parser.add_argument("--rendered", action="store_true", help="the rendered sequences")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="of these names alone")
    parser.add_argument("--quick", action="store_true", help=f"the first {QUICK} frames: does it run at all?")
    parser.add_argument("--no-baseline", action="store_true", help="the stage alone")
    parser.add_argument("--cache", type=Path, default=CACHE, help="where sequences and finished rows are kept")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "results", help="folder of the report")
    parser.add_argument("--note", default="", help="conditions of the run, for the head of the page")
    told = parser.parse_args(arguments)
    frames = QUICK if told.quick else None
    chosen = [task for task in tasks(told, frames) if not told.only or task[0] in told.only]
    rows = list(run(chosen, told.cache, frames, with_baseline=not told.no_baseline))
    told.out.mkdir(parents=True, exist_ok=True)
    write_report(rows, told.out, told.note)


def tasks(told: argparse.Namespace, frames: int | None) -> Iterator[Task]:
    """What is to be run: a name, how it is loaded, and who knows its true tracks."""
    both = not (told.clips or told.rendered)
    if told.clips or both:
        for name in CLIPS:
            if has_clip(name):
                yield name, lambda name=name: load_clip(name, frames), None
            else:
                print(f"{name}: no clip at {real_data()} (set PHYSREAL_REAL_DATA)", flush=True)
    if told.rendered or both:
        for name in NAMES:
            yield name, lambda name=name: load_rendered(name, told.cache / "sequences", frames), true_points


def run(chosen: Iterable[Task], cache: Path, frames: int | None, with_baseline: bool) -> Iterator[dict[str, Any]]:
    """Rows of the stage and of the baseline, from the cache where they are known for this very code."""
    rows = cache / f"rows_{_code()}{'' if frames is None else f'_{frames}'}"
    rows.mkdir(parents=True, exist_ok=True)
    for name, load, truth_of in chosen:
        file = rows / f"{name}.json"
        known = json.loads(file.read_text()) if file.is_file() else []
        if not known or (with_baseline and len(known) == 1 and known[0]["alive"] is not None):
            known = _run_one(load(), truth_of, with_baseline)
            file.write_text(json.dumps(known))
        print(f"{name}: {_brief(known)}", flush=True)
        yield from known


def _run_one(judged: Judged, truth_of: TruthOf | None, with_baseline: bool) -> list[dict[str, Any]]:
    row, given = run_stage(judged, truth_of)
    if not (with_baseline and given):
        return [row]
    return [row, run_baseline(judged, truth_of=truth_of, **given)]


def _brief(rows: list[dict[str, Any]]) -> str:
    def number(value: float | None) -> str:
        return "-" if value is None else f"{value:.3f}"

    parts = []
    for row in rows:
        iou = row["iou"]
        least, mean = (None, None) if iou is None else (min(iou), sum(iou) / len(iou))
        parts.append(
            f"{row['method']} IoU {number(mean)} least {number(least)}, alive {number(row['alive'])}, "
            f"missed {number(row['missed_6px'])}, error {number(row['track_error_px'])} px, "
            f"{row['seconds_per_frame']:.2f} s a frame"
            + (f", {len(row['warnings'])} warnings" * (row["method"] == STAGE))
        )
    return "; ".join(parts)


def _code() -> str:
    """Digest of all code that a row depends on."""
    sources = (ROOT / "benchmarks" / "perception_runs.py", ROOT / "benchmarks" / "rendered.py")
    modules = sorted({module for source in sources for module in project_modules(source)})
    return hashlib.sha256("".join(map(digest_file, modules)).encode()).hexdigest()[:12]


if __name__ == "__main__":
    main()
