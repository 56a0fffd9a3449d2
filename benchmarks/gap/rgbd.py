"""One case from RGB-D, through the stages of the pipeline, in a project folder of its own: `python -m benchmarks.gap.rgbd FOLDER NAME`.

The first interaction is fitted, the second is its companion. Every stage is a process of its own, as DVC runs them.
"""

import os
import subprocess
import sys
import time
import traceback
from pathlib import Path
from typing import Any

from benchmarks.gap.case import capture, truth_of
from benchmarks.gap.cases import GapCase
from benchmarks.gap.files import read_json, write_json
from benchmarks.gap.oracle import oracle_closed
from benchmarks.gap.problems import GUESS
from pipeline.compose import render
from pipeline.config import load_parameters, read_parameters, validate_parameters
from pipeline.products.gap import load_added, load_gap
from pipeline.project import CODE_ROOT, Project
from pipeline.whole_files import write_whole

SEEN = ("parse_video", "segment_and_track", "build_object", "fit_pose", "sample_particles")
FITTED = (*SEEN, "fit_global", "fit_patches", "find_gap", "add_effect")
SEARCH = ("find_gap", "add_effect")
ON_A_CARD = ("fit_global", "fit_patches", *SEARCH)


def run_case(case: GapCase, folder: Path) -> None:
    """All steps of a case that have not been done, in `folder`/<name>; a step that raises leaves `failed.txt`."""
    own = folder / case.name
    own.mkdir(parents=True, exist_ok=True)
    try:
        capture(case, own, video=True)
        project = project_of(own)
        if not (own / "answer.json").is_file():
            write_json(own / "answer.json", _answer(project))
        if not (own / "oracle.json").is_file():
            write_json(own / "oracle.json", {"truth": truth_of(own), "closed": _oracle(case, own, project)})
    except Exception:
        (own / "failed.txt").write_text(traceback.format_exc())
        raise


def project_of(own: Path) -> Project:
    """The case's project: its captures under their names, the parameters of this repository for all else."""
    project = Project(own / "project")
    motions = sorted(path.name for path in (own / "captures").iterdir())
    (project.root / "data").mkdir(parents=True, exist_ok=True)
    for name, target in (("captures", own / "captures"), ("models", CODE_ROOT / "data" / "models")):
        link = project.root / "data" / name
        if not link.is_symlink():
            link.symlink_to(target.resolve())
    if not project.parameters.is_file():
        write_whole(project.parameters, render(validate_parameters(_parameters(motions))))
    return project


def _parameters(motions: list[str]) -> dict[str, Any]:
    """This repository's params.yaml with the case's interactions for its sequences, on a card if there is one.

    As from tracks alone, the hand is known to hold as a vice does, so that one which gives way can be named.
    """
    import torch

    first, second = motions
    own = read_parameters(CODE_ROOT / "params.yaml")
    if torch.cuda.is_available():
        own |= {stage: {**own[stage], "device": "cuda:0"} for stage in ON_A_CARD}
    sequences = {"sequences": {first: {}, second: {}}, "fits": {first: {"companion": second}}}
    own["fit_global"]["grip_stiffness"] |= {"initial": GUESS["grip_stiffness"], "rate": 0.0}
    own["find_gap"]["grip_fitted"] = False
    emptied = {"clips": {}, "rigged": {}, "predictions": {}}
    return own | sequences | emptied


def _answer(project: Project) -> dict[str, Any]:
    """Runs the stages; the answer as that of a case of tracks alone."""
    parameters = load_parameters(project.parameters)
    ((first, fit),) = parameters.values.fits.items()
    seconds: dict[str, float] = {}
    for stage, sequence in [*((s, fit.companion) for s in SEEN), *((s, first) for s in FITTED)]:
        begun = time.perf_counter()
        if not project.artifact(stage, sequence).is_dir():
            command = [sys.executable, "-m", "pipeline.cli", "run", stage, sequence]
            path = os.pathsep.join(filter(None, [str(CODE_ROOT), os.environ.get("PYTHONPATH")]))
            subprocess.run(command, cwd=project.root, env=os.environ | {"PYTHONPATH": path}, check=True)
        seconds[f"{stage} {sequence}"] = time.perf_counter() - begun
    return {
        "report": load_gap(project.artifact("find_gap", first)).as_record(),
        "added": load_added(project.artifact("add_effect", first)).as_record(),
        "seconds": sum(seconds[f"{stage} {first}"] for stage in SEARCH),
        "seconds_by_stage": seconds,
    }


def _oracle(case: GapCase, own: Path, project: Project) -> float | None:
    """What the true model closes of the held-out gap, where the answer named it."""
    from physreal_core.fitting import load_model
    from pipeline.stage import StageContext
    from stages._gap import interactions, settings_of

    found = read_json(own / "answer.json")
    if case.kind != "single" or found["report"]["verdict"]["names"] != [case.effect]:
        return None
    parameters = load_parameters(project.parameters)
    context = StageContext("find_gap", next(iter(parameters.values.fits)), project, parameters, code="")
    experiments = interactions(context, load_model(context.input("fit_patches")))
    return oracle_closed(experiments, [case.effect], found["added"], settings_of(context.params, context.seed))


if __name__ == "__main__":
    run_case(GapCase.named(sys.argv[2]), Path(sys.argv[1]))
