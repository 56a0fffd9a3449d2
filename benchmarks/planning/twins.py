"""The models that are planned with: of the plush animal that of a project, from RGB-D; of rope and cloth Stage 1 on tracks of the rig's lift."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.gap.problems import Discretisation, baseline_model, problems_of
from benchmarks.planning.cases import Case
from benchmarks.thin.rigged_fit import refitted
from data.rig import recording
from data.rig.rig_scene import RigScene
from data.rig.thin_files import write_middle_at_frame_zero
from data.rig.thin_simulate import run
from physreal_core.fitting.curriculum import ScanConfig
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.model import Model, load_model, save_model
from physreal_core.fitting.problem import Problem
from pipeline.config.fit_global import FitGlobal
from pipeline.project import Project
from stages._fit import variables_of

Fitted = tuple[Problem, Model]
FINE = Discretisation(edge=0.006)
"""Of a cloth that is fitted; plans are made on triangles of the usual size. With that size in the fit, too, the cloth is drawn along later in
the lift, which a friction of 0.30 makes up for where 0.4 is true; with 6 mm it is 0.39."""


def fitted(case: Case, work: Path, project: Path, stage: str) -> Fitted:
    """The twin that plans for a case.

    Args:
        case: what is planned for.
        work: where models of thin bodies are kept.
        project, stage: of the plush animal's model.
    """
    if case.body == "plush":
        return plush(Project(project.resolve()), stage)
    return thin(case.setting.scene(), work)


def plush(project: Project, stage: str) -> Fitted:
    """What a stage has fitted to `plush_lift`."""
    from applications.twin import Twin

    twin = Twin.load(project, "plush_lift", stage)
    return twin.problem, twin.model


def thin(scene: RigScene, work: Path) -> Fitted:
    """A rope or a cloth from 150 points on it in the lift, with 1 mm of noise and gaps; the hand's points are exact."""
    folder, fitted = work / scene.name / "captures" / scene.name, work / scene.name / "model"
    if not (folder / "capture.json").is_file():
        folder.mkdir(parents=True, exist_ok=True)
        random, moved = np.random.default_rng(0), run(scene)
        measured = recording.ideal(scene, moved, random)
        write_middle_at_frame_zero(folder, moved, scene.body)
        recording.write(folder, scene, measured, recording.at_frame_zero(moved), random)
    problem = problems_of(folder.parent)[scene.name]
    if not fitted.is_dir():
        model = _on_patches_of(
            problem, _one_material(problems_of(folder.parent, FINE)[scene.name], scene.body.geometry)
        )
        fitted.mkdir(parents=True)
        save_model(fitted, model)
    return problem, load_model(fitted)


def _one_material(problem: Problem, geometry: str) -> Model:
    """Stage 1 on tracks alone, with the pipeline's settings."""
    params = FitGlobal()
    variables = variables_of(params.variables(geometry))
    scan, descent = ScanConfig(**params.scan.model_dump()), DescentConfig(**params.descent.model_dump())
    return refitted(problem, baseline_model(problem), variables, scan, descent, "cpu")[0]


def _on_patches_of(problem: Problem, model: Model) -> Model:
    """A model of one material for a body that is cut otherwise."""
    fields = {name: value for name, value in model.fields.items() if name != "patch_positions"}
    return baseline_model(problem).with_fields(**{n: v[:1] if v.dim() else v for n, v in fields.items()})
