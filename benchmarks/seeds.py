"""How far do the example's scores depend on the seed? `python -m benchmarks.seeds [--seeds 0 1 2] [--sequence plush_lift] FOLDER`

Each seed gets a project folder of its own under FOLDER (other sensor noise, pose of the prior, networks' start) and runs through
all stages; a stage whose output is there is not run again, so a stopped run goes on. Prints every seed's scores, the
simulated over the true static deflection (docs/evaluation.md), and the medians.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from statistics import median

ROOT = Path(__file__).resolve().parent.parent
STAGES = (
    "rig", "parse_video", "segment_and_track", "build_object", "fit_pose", "sample_particles",
    "fit_global", "fit_patches", "fit_residual", "evaluate",
)  # fmt: skip
SCORES = ("track_error", "cd_l1_oneway", "cd_l2_twoway", "iou", "psnr")
Scores = dict[str, dict[str, dict[str, float]]]


def run_seed(folder: Path, seed: int, sequence: str) -> Scores:
    """Run all stages of `sequence` with `seed` in a project of its own; gives fit stage → interval → score."""
    project = folder / f"seed_{seed}"
    project.mkdir(parents=True, exist_ok=True)
    parameters = re.sub(r"(?m)^seed: \d+", f"seed: {seed}", (ROOT / "params.yaml").read_text())
    (project / "params.yaml").write_text(parameters)
    (project / "data").mkdir(exist_ok=True)
    if not (project / "data" / "models").exists():
        (project / "data" / "models").symlink_to(ROOT / "data" / "models")
    for stage in STAGES:
        if not (project / "data" / "runs" / stage / f"{sequence}.json").exists():
            print(f"seed {seed}: {stage}", flush=True)
            command = [sys.executable, "-m", "pipeline.cli", "run", stage, sequence]
            subprocess.run(command, cwd=project, env=_environment(), check=True, stdout=subprocess.DEVNULL)
    return json.loads((project / "data" / "artifacts" / "evaluate" / sequence / "metrics.json").read_text())


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def table(found: dict[int, Scores]) -> str:
    """Markdown: a row per fit stage, interval and seed, with a median row under each group."""
    columns = (*SCORES, "sag / true sag")
    lines = ["| stage | interval | seed | " + " | ".join(columns) + " |", "|---|---|---|" + "--:|" * len(columns)]
    stages = [name for name in next(iter(found.values())) if name.startswith("fit_")]
    for stage, interval in itertools.product(stages, ("observed", "future")):
        rows = {str(seed): _row(scores[stage], interval) for seed, scores in found.items()}
        rows["median"] = [median(column) for column in zip(*rows.values(), strict=True)]
        lines += [f"| {stage} | {interval} | {seed} | {_cells(row)} |" for seed, row in rows.items()]
    return "\n".join(lines)


def _row(scores: dict, interval: str) -> list[float]:
    statics = scores["truth"]["statics"]
    return [*(scores[interval][name] for name in SCORES), statics["sag"] / statics["true_sag"]]


def _cells(row: list[float]) -> str:
    return " | ".join(f"{value:.4g}" for value in row)


def main() -> None:
    """Run the seeds and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2])
    parser.add_argument("--sequence", default="plush_lift")
    arguments = parser.parse_args()
    found = {seed: run_seed(arguments.folder.resolve(), seed, arguments.sequence) for seed in arguments.seeds}
    print(table(found))


if __name__ == "__main__":
    main()
