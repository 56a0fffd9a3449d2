"""The rig's stick that pushes and never holds, through the stages, against the truth: `python -m benchmarks.pushed --project FOLDER`

FOLDER is a project that `physreal compose sequences=pushing` has set up, in which the stages up to `fit_patches` of `plush_poke` and up to
`sample_particles` of `plush_shove` have run (`physreal run`). Each model is rolled out on both and compared with where all nodes of the rig's
mesh truly were; each starts where frame 0 has it.

Where FOLDER also has a sequence `plush_poke_seen` with the stages up to `sample_particles`, Stage 1's model is rolled out on it, too. It is the
capture `plush_poke` without its `controllers.npz`, `contact: push` and `segment_and_track.controller_thickness: 0.02`: its stick is what the
pictures show.

With `--firm FOLDER`, another such project whose `fit_global.tool_stiffness.initial` is larger and in which `fit_global` of `plush_poke` has run, the
page says what modulus a firmer contact gives.

Writes `results/pushed.md`.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.thin.results import RESULTS
from benchmarks.thin.rigged import problem_of
from benchmarks.thin.rigged_fit import errors_of
from data.rig.rig_scene import plush_poke
from data.rig.truth import Truth, load_truth
from physreal_core.array_types import Array
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.transfer import transferred
from pipeline.products.fit import Fit
from pipeline.project import Project

FITTED, OTHER, SEEN = "plush_poke", "plush_shove", "plush_poke_seen"
STAGES = {"fit_global": "one material (Stage 1)", "fit_patches": "a material per patch (Stage 2)"}


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pushed", description=__doc__)
    parser.add_argument("--project", type=Path, required=True)
    parser.add_argument("--firm", type=Path)
    arguments = parser.parse_args()
    page = report(Project(arguments.project), None if arguments.firm is None else Project(arguments.firm))
    (RESULTS / "pushed.md").write_text(page)
    print(page)


def report(project: Project, firm: Project | None = None) -> str:
    """The page, of a project in which the fits are done, and of one with a firmer contact."""
    problems = {name: problem_of(project, name) for name in (FITTED, OTHER)}
    truths = {name: load_truth(project.capture(name)) for name in problems}
    observed, own = problems[FITTED].observed, problems[FITTED].body.x0
    rows = {"if nothing moved it": {name: _moved(truth) for name, truth in truths.items()}}
    models = {stage: load_model(project.artifact(stage, FITTED)) for stage in STAGES}
    for stage, words in STAGES.items():
        rows[words] = {}
        for name, problem in problems.items():
            pair = (models[stage], problem) if name == FITTED else transferred(models[stage], own, problem)
            rows[words][name] = _errors(*pair, truths[name])
    if project.artifact("sample_particles", SEEN).is_dir():
        seen = _errors(*transferred(models["fit_global"], own, problem_of(project, SEEN)), truths[FITTED])
        rows["Stage 1, the stick as the pictures show it"] = {FITTED: seen}
    table = [
        f"| {words} | {' | '.join(_cell(errors[n], observed) if n in errors else '' for n in problems)} |"
        for words, errors in rows.items()
    ]
    found = [*_found(models["fit_global"], truths[FITTED]), "", *_told(project, firm)]
    return "\n".join([*_head(truths[FITTED]), *table, "", *found]) + "\n"


def _head(truth: Truth) -> list[str]:
    last = len(truth.vertices) - 1
    return [
        "# A stick that pushes and never holds",
        "",
        "`physreal compose sequences=pushing` in a project, the stages up to `fit_patches` of `plush_poke` and up to `sample_particles` of",
        "`plush_shove`, then `python -m benchmarks.pushed --project FOLDER`. MuJoCo's contact pushes the animal; we see it by RGB-D with noise. Given:",
        "the stress-free shape, the density, one click on the object and one on the stick, the true camera, and the stick's way and radius, as a robot",
        "knows those of its tool. Not given: where and when it touches, material, both frictions. Errors are means over all nodes of the rig's mesh,",
        f"seen or not. `plush_poke` is fitted to its frames 0 to 41; in frames 42 to {last} the stick pushes on. Nothing is fitted to `plush_shove`,",
        "where it pushes the other end. In the row of the pictures the stick's way and shape are not given either: points on its seen face and up to 20 mm",
        "behind it push, joined by capsules of 6 mm (`python -m benchmarks.pushed --help` says how it is made). Its lower end goes behind the head.",
        "",
        "| error [mm], frames 0 to 41 / after them | `plush_poke` | `plush_shove`, predicted |",
        "|---|--:|--:|",
    ]


def _found(model: Model, truth: Truth) -> list[str]:
    value = {name: float(model.fields[name].mean()) for name in model.fields if name != "patch_positions"}
    return [
        f"Stage 1: Young's modulus {value['youngs_modulus'] / 1e3:.1f} kPa, true {truth.youngs_modulus / 1e3:g};",
        f"friction with the table {value['friction_coefficient']:.2f}, true {truth.friction_coefficient:g};",
        f"friction with the stick {value['tool_friction']:.2f}, true {plush_poke().push_friction:g}.",
    ]


def _told(project: Project, firm: Project | None) -> list[str]:
    """How far a push tells the modulus."""
    fit = Fit.load(project.artifact("fit_global", FITTED))
    tried = ", ".join(f"{row['objective']:.2f} at {row['youngs_modulus'] / 1e3:g}" for row in fit.scan)
    lines = [
        f"What Stage 1's objective is at other moduli [kPa], in its scan: {tried}; at its end {fit.descent.objective:.2f}."
    ]
    if firm is not None:
        usual, other = (load_model(p.artifact("fit_global", FITTED)).fields for p in (project, firm))
        times = float(other["tool_stiffness"] / usual["tool_stiffness"])
        modulus = float(other["youngs_modulus"].mean()) / 1e3
        lines.append(
            f"With a contact {times:.0f} times as firm (`fit_global.tool_stiffness.initial`) it finds {modulus:.0f} kPa."
        )
    return lines


def _errors(model: Model, problem, truth: Truth) -> Array:
    """Mean distance in every frame [m]."""
    return errors_of(problem, model, truth.vertices.astype(float)).mean(1)


def _moved(truth: Truth) -> Array:
    """How far the nodes are from where they were in frame 0, in every frame [m]."""
    return np.linalg.norm(truth.vertices - truth.vertices[0], axis=2).mean(1)


def _cell(errors: Array, observed: int) -> str:
    return f"{1e3 * errors[:observed].mean():.1f} / {1e3 * errors[observed:].mean():.1f}"


if __name__ == "__main__":
    main()
