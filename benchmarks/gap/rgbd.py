"""One case from RGB-D, through the stages of the pipeline, in a project folder of its own: `python -m benchmarks.gap.rgbd FOLDER NAME SHAPE`.

The first interaction is fitted, the second is its companion. Every stage is a process of its own, as DVC runs them. The motion that is
kept out goes through perception in a project by itself. It comes into the case's project when the answer is there, and stands in the
companion's place. With `--perceive` a case ends after perception, which needs no card.

SHAPE is `given`: captures have the rig's surface, with colours, and a box around the object; or `seen`: they have neither, and shape and object
are found in the video. The hand's click and the density stay.
"""

import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from benchmarks.gap.case import capture, kept_out, scored
from benchmarks.gap.cases import GapCase
from benchmarks.gap.commit import searched_by
from benchmarks.gap.files import failure_told, write_json
from benchmarks.gap.filming import PERCEIVED
from benchmarks.gap.held_out import models_of
from physreal_core.gap import Experiment, GapSettings
from pipeline.compose import render
from pipeline.config import load_parameters, read_parameters, validate_parameters
from pipeline.products.gap import load_added, load_gap
from pipeline.project import CODE_ROOT, Project
from pipeline.whole_files import write_whole

if TYPE_CHECKING:
    from physreal_core.fitting import Model
    from pipeline.stage import StageContext

SEEN = ("parse_video", "segment_and_track", "build_object", "fit_pose", "sample_particles")
FITTED = (*SEEN, "fit_global", "fit_patches", "find_gap", "add_effect")
SEARCH = ("find_gap", "add_effect")
ON_A_CARD = ("fit_global", "fit_patches", *SEARCH)
Shape = Literal["given", "seen"]


def perceive_case(case: GapCase, folder: Path, shape: Shape = "given") -> None:
    """Films a case in `folder`/<name> and takes its three recordings through perception; what raises leaves `failed.txt`."""
    own = folder / case.name
    with failure_told(own):
        capture(case, own, video=True)
        project, beside = project_of(own, shape), kept_out_project(own, shape)
        motions = [(project, motion) for motion in reversed(_motions(own))] + [(beside, kept_out(own).name)]
        seconds = {f"{stage} {motion}": _run(of, stage, motion) for of, motion in motions for stage in SEEN}
        write_json(own / PERCEIVED, seconds)


def run_case(case: GapCase, folder: Path, shape: Shape = "given") -> None:
    """All steps of a case that have not been done, in `folder`/<name>; a step that raises leaves `failed.txt`."""
    own = folder / case.name
    with failure_told(own):
        capture(case, own, video=True)
        project = project_of(own, shape)
        if not (own / "answer.json").is_file():
            write_json(own / "answer.json", {**_answer(project), "commit": searched_by()})
        if not (own / "oracle.json").is_file():
            experiments, settings = _experiments(own, project, shape)
            write_json(own / "oracle.json", scored(case, own, experiments, settings))


def project_of(own: Path, shape: Shape = "given") -> Project:
    """The case's project: the captures that the search sees under their names, the parameters of this repository for all else."""
    motions = _motions(own)
    return _project(own / "project", [own / "captures" / motion for motion in motions], shape, _parameters(motions))


def kept_out_project(own: Path, shape: Shape = "given") -> Project:
    """A project in which the motion that is kept out stands alone: the search's own never holds anything of it before the answer."""
    further = kept_out(own)
    return _project(own / "project_kept_out", [further], shape, _parameters([further.name]))


def _motions(own: Path) -> list[str]:
    """The two that the search sees; the first is fitted."""
    return sorted(path.name for path in (own / "captures").iterdir())


def _project(root: Path, recordings: list[Path], shape: Shape, parameters: dict[str, Any]) -> Project:
    project = Project(root)
    (root / "data" / "captures").mkdir(parents=True, exist_ok=True)
    _linked(root / "data" / "models", CODE_ROOT / "data" / "models")
    for recording in recordings:
        _put_in(project, recording, shape)
    if not project.parameters.is_file():
        write_whole(project.parameters, render(validate_parameters(parameters)))
    return project


def _put_in(project: Project, capture: Path, shape: Shape) -> None:
    """The capture as one of the project's, with or without what is known of the object's shape and place."""
    own = project.root / "data" / "captures" / capture.name
    if shape == "given":
        return _linked(own, capture)
    own.mkdir(exist_ok=True)
    for file in capture.iterdir():
        if file.stem not in ("shape_prior", "capture"):
            _linked(own / file.name, file)
    facts = json.loads((capture / "capture.json").read_text())
    facts["hints"].pop("object", None)
    write_whole(own / "capture.json", json.dumps(facts))


def _linked(link: Path, target: Path) -> None:
    if not link.is_symlink():
        link.symlink_to(target.resolve())


def _parameters(motions: list[str], kept_out: str | None = None) -> dict[str, Any]:
    """This repository's params.yaml with the case's interactions for its sequences, on a card if there is one.

    As from tracks alone, the hand holds as a vice does, which is Stage 1's default, so that one which gives way can be named.

    Args:
        motions: that the search sees, the first is fitted; or one alone, which is not.
        kept_out: stands in the companion's place where it is given.
    """
    import torch

    first, *others = motions
    companion = kept_out or next(iter(others), None)
    own = read_parameters(CODE_ROOT / "params.yaml")
    if torch.cuda.is_available():
        own |= {stage: {**own[stage], "device": "cuda:0"} for stage in ON_A_CARD}
    fits = {first: {"companion": companion}} if companion else {}
    sequences = {"sequences": {name: {} for name in (first, companion) if name}, "fits": fits}
    emptied = {"clips": {}, "rigged": {}, "predictions": {}}
    return own | sequences | emptied


def _answer(project: Project) -> dict[str, Any]:
    """Runs the stages; the answer as that of a case of tracks alone."""
    parameters = load_parameters(project.parameters)
    ((first, fit),) = parameters.values.fits.items()
    stages = [*((s, fit.companion) for s in SEEN), *((s, first) for s in FITTED)]
    seconds = {f"{stage} {sequence}": _run(project, stage, sequence) for stage, sequence in stages}
    report, added = load_gap(project.artifact("find_gap", first)), load_added(project.artifact("add_effect", first))
    return {
        "report": report.as_record(),
        "added": added.as_record(),
        "models": models_of(report, added),
        "seconds": sum(seconds[f"{stage} {first}"] for stage in SEARCH),
        "seconds_by_stage": seconds,
    }


def _run(project: Project, stage: str, sequence: str) -> float:
    """Runs a stage that has no output yet, in a process of its own; the seconds that it took."""
    begun = time.perf_counter()
    if not project.artifact(stage, sequence).is_dir():
        command = [sys.executable, "-m", "pipeline.cli", "run", stage, sequence]
        path = os.pathsep.join(filter(None, [str(CODE_ROOT), os.environ.get("PYTHONPATH")]))
        subprocess.run(command, cwd=project.root, env=os.environ | {"PYTHONPATH": path}, check=True)
    return time.perf_counter() - begun


def seen_interactions(own: Path, project: Project) -> tuple["StageContext", "Model", list[Experiment]]:
    """Of a case whose material has been fitted: `find_gap` as a stage, the fitted model, and the interactions that the search sees."""
    from physreal_core.fitting import load_model
    from pipeline.stage import StageContext
    from stages._gap import interactions

    context = StageContext("find_gap", _motions(own)[0], project, load_parameters(project.parameters), code="")
    model = load_model(context.input("fit_patches"))
    return context, model, interactions(context, model)


def _experiments(own: Path, project: Project, shape: Shape) -> tuple[list[Experiment], GapSettings]:
    """The interactions that the search had, and last the one that was kept out; and the search's settings."""
    from pipeline.stage import StageContext
    from stages._gap import interactions, settings_of

    given, motions = project.parameters, _motions(own)
    seen, model, found = seen_interactions(own, project)
    further, searched = kept_out(own), given.read_text()
    _put_in(project, further, shape)
    _perceived_beside(own, project, shape)
    write_whole(given, render(validate_parameters(_parameters(motions, further.name))))
    try:
        beside = StageContext("find_gap", motions[0], project, load_parameters(given), code="")
        found.append(interactions(beside, model)[-1])
    finally:
        write_whole(given, searched)
    return found, settings_of(seen.params, seen.seed, found[0].problem.body)


def _perceived_beside(own: Path, project: Project, shape: Shape) -> None:
    """What is seen of the motion that was kept out comes into the case's project."""
    beside, motion = kept_out_project(own, shape), kept_out(own).name
    for stage in SEEN:
        _run(beside, stage, motion)
        if not project.artifact(stage, motion).is_dir():
            shutil.copytree(beside.artifact(stage, motion), project.artifact(stage, motion))


if __name__ == "__main__":
    run = perceive_case if "--perceive" in sys.argv[4:] else run_case
    run(GapCase.named(sys.argv[2]), Path(sys.argv[1]), sys.argv[3])
