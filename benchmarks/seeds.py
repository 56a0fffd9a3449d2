"""How far do the example's scores depend on the seed? `python -m benchmarks.seeds [--seeds 0 1 2] [--recorded] FOLDER`

Each seed gets a project folder of its own under FOLDER (other sensor noise, pose of the prior, networks' start) and runs through
all stages; with `--recorded` all take the recording in data/captures, so that only what looks at it differs. A stage whose output
is there is not run again, so a stopped run goes on. Prints every seed's scores, the simulated over the true static deflection
(docs/evaluation.md), and the medians; and what the search says is missing.
"""

from __future__ import annotations

import argparse
import itertools
import os
import re
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from physreal_core.gap import GapReport

ROOT = Path(__file__).resolve().parent.parent
SCORES = ("track_error", "cd_l1_oneway", "cd_l2_twoway", "iou", "psnr")
Metrics = dict[str, dict[str, dict[str, float]]]


def run_seed(folder: Path, seed: int, sequence: str, recorded: bool) -> Path:
    """Run all stages of `sequence` with `seed` in a project of its own; gives the folder of their outputs."""
    project = folder / f"seed_{seed}"
    project.mkdir(parents=True, exist_ok=True)
    parameters = re.sub(r"(?m)^seed: \d+", f"seed: {seed}", (ROOT / "params.yaml").read_text())
    (project / "params.yaml").write_text(parameters)
    (project / "data").mkdir(exist_ok=True)
    if not (project / "data" / "models").exists():
        (project / "data" / "models").symlink_to(ROOT / "data" / "models")
    if recorded and not (project / "data" / "captures").exists():
        (project / "data" / "captures").symlink_to(ROOT / "data" / "captures")
    for stage in _stages(recorded):
        if not (project / "data" / "runs" / stage / f"{sequence}.json").exists():
            print(f"seed {seed}: {stage}", flush=True)
            command = [sys.executable, "-m", "pipeline.cli", "run", stage, sequence]
            subprocess.run(command, cwd=project, env=_environment(), check=True, stdout=subprocess.DEVNULL)
    return project / "data" / "artifacts"


def _stages(recorded: bool) -> list[str]:
    """Stages of a sequence that models are fitted on, with the one that makes its recording or without."""
    from pipeline.graph import STAGES  # the benchmarks' modules can be imported where there is no pipeline

    return [name for name in STAGES if name != "predict" and not (recorded and name == "rig")]


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def table(found: dict[int, Metrics]) -> str:
    """Markdown: a row per fit stage, interval and seed, with a median row under each group."""
    columns = (*SCORES, "sag / true sag")
    lines = ["| stage | interval | seed | " + " | ".join(columns) + " |", "|---|---|---|" + "--:|" * len(columns)]
    stages = [name for name in next(iter(found.values())) if name.startswith("fit_")]
    for stage, interval in itertools.product(stages, ("observed", "future")):
        rows = {str(seed): _row(scores[stage], interval) for seed, scores in found.items()}
        rows["median"] = [median(column) for column in zip(*rows.values(), strict=True)]
        lines += [f"| {stage} | {interval} | {seed} | {_cells(row)} |" for seed, row in rows.items()]
    return "\n".join(lines)


def answers(found: dict[int, GapReport]) -> str:
    """Markdown: a row per seed with the verdict on it, and the probabilities of what is in its class and of nothing."""
    lines = ["| seed | verdict | probability | members | `none` |", "|--:|---|--:|---|--:|"]
    for seed, report in found.items():
        verdict, own = report.verdict, {candidate.names: candidate.probability for candidate in report.candidates}
        members = ", ".join(f"{' + '.join(names)} {own[names]:.2f}" for names in verdict.members if names)
        none = own.get((), 0.0)
        lines.append(f"| {seed} | {verdict.kind} | {verdict.probability:.2f} | {members} | {none:.2f} |")
    return "\n".join(lines)


def _row(scores: dict, interval: str) -> list[float]:
    statics = scores["truth"]["statics"]
    return [*(scores[interval][name] for name in SCORES), statics["sag"] / statics["true_sag"]]


def _cells(row: list[float]) -> str:
    return " | ".join(f"{value:.4g}" for value in row)


def main() -> None:
    """Run the seeds and print both tables."""
    from pipeline.products.gap import load_gap  # the benchmarks' modules can be imported where there is no pipeline
    from pipeline.products.scores import Scores

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--sequence", default="plush_lift")
    parser.add_argument("--recorded", action="store_true", help="all seeds look at the recording that is there")
    arguments = parser.parse_args()
    folder, sequence = arguments.folder.resolve(), arguments.sequence
    folders = {seed: run_seed(folder, seed, sequence, arguments.recorded) for seed in arguments.seeds}

    scores = {seed: Scores.load(own / "evaluate" / sequence).metrics for seed, own in folders.items()}
    print(table(scores), answers({s: load_gap(own / "find_gap" / sequence) for s, own in folders.items()}), sep="\n\n")


if __name__ == "__main__":
    main()
