"""The rig's rope and cloth through the stages, against their truth: `python -m benchmarks.thin.rigged --project FOLDER rope cloth`

FOLDER is a project that `physreal compose sequences=thin` (of `corner` `thin_corner`) has set up, in which the stages up to `fit_global` of the lift and up to
`sample_particles` of the swing have run (`dvc repro`, or `physreal run`). The lift's model is rolled out on both motions and compared with
where the rig's middle surface or centre line truly was, at all its nodes, seen or not. Each node starts where frame 0 has it.

`--hold true` gives the hold that the rig has, too, and fits once more, to the tracks alone. The parts then end in `_hold_given`.
`--shape seen` says that the project's captures have neither shape nor thickness, so that both are those of frame 0: the parts end in
`_shape_seen`.

Writes the parts `rope_lift`, `cloth_lift` and `corner_lift` of `results/thin.json` and the page `results/thin_rigged.md`.
"""

import argparse
import json
from pathlib import Path
from typing import Any

from benchmarks.thin.results import RESULTS, write_part
from benchmarks.thin.rigged_fit import errors_of, held_at, refitted, stiffness_errors, track_errors
from data.rig.truth import load_truth
from physreal_core.fitting.curriculum import ScanConfig
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.transfer import transferred
from physreal_core.simulation import Body
from pipeline.config.fit_global import FitGlobal
from pipeline.products.fit import Fit
from pipeline.products.particles import Particles
from pipeline.project import Project
from stages._fit import variables_of
from stages._problem import load_problem
from stages.fit_global import initial_model

NAMES = {"rope": "rope", "cloth": "cloth", "corner": "cloth, held at a corner"}
"""Of bodies in the table, by their sequences' names."""


def main() -> None:
    """Measure the bodies that are named, then write the page of all that thin.json has."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thin.rigged", description=__doc__)
    parser.add_argument("bodies", nargs="+", choices=tuple(NAMES))
    parser.add_argument("--project", type=Path, required=True)
    parser.add_argument("--hold", choices=("found", "true"), default="found")
    parser.add_argument("--shape", choices=("given", "seen"), default="given")
    parser.add_argument("--device", default="cpu")
    arguments = parser.parse_args()
    for body in arguments.bodies:
        project = Project(arguments.project)
        measure = measured if arguments.hold == "found" else measured_with_hold
        record = measure(project, body, arguments.device)
        end = "" if arguments.hold == "found" else "_hold_given"
        write_part(f"{body}_lift{end}" + ("" if arguments.shape == "given" else "_shape_seen"), record)
        print(json.dumps(record, indent=1))
    write_page()


def measured(project: Project, body: str, device: str) -> dict[str, Any]:
    """`track_error` [m], `stiffness_error` (relative), and what the fit chose, of one body."""
    model = load_model(project.artifact("fit_global", f"{body}_lift"))
    problems = [problem_of(project, f"{body}_{motion}") for motion in ("lift", "swing")]
    fit = Fit.load(project.artifact("fit_global", f"{body}_lift"))
    record = compared(project, body, problems, model, device)
    return record | {
        "grip_reach": model.grip_reach,
        "grip_reaches": fit.grip_reaches,
        "objective": fit.descent.objective,
    }


def measured_with_hold(project: Project, body: str, device: str) -> dict[str, Any]:
    """The same of a model that is fitted anew with the true hold."""
    problems = []
    for motion in ("lift", "swing"):
        truth = load_truth(project.capture(f"{body}_{motion}"))
        rig = truth.middle_vertices[0].astype(float), truth.middle_elements, truth.middle_gripped
        problems.append(held_at(problem_of(project, f"{body}_{motion}"), *rig))
    params, particles = FitGlobal(), Particles.load(project.artifact("sample_particles", f"{body}_lift"))
    variables = variables_of(params.variables(particles.geometry))
    scan, descent = ScanConfig(**params.scan.model_dump()), DescentConfig(**params.descent.model_dump())
    model, total = refitted(problems[0], initial_model(params, particles), variables, scan, descent, device)
    return compared(project, body, problems, model, device) | {"objective": total}


def compared(project: Project, body: str, problems: list[Problem], model: Model, device: str) -> dict[str, Any]:
    """What a model of the lift makes of both motions, beside the truth."""
    own, other = problems
    truths = [load_truth(project.capture(f"{body}_{motion}")) for motion in ("lift", "swing")]
    moved, placed = transferred(model, own.body.x0, other)
    pairs = (own, model), (placed, moved)
    errors = [errors_of(*pair, t.middle_vertices.astype(float), device) for pair, t in zip(pairs, truths, strict=True)]
    described = json.loads((project.capture(f"{body}_lift") / "capture.json").read_text())
    return {
        "track_error": track_errors(*errors, own.observed),
        "stiffness_error": stiffness_errors(model, vars(truths[0])),
        "friction_coefficient": [float(model.fields["friction_coefficient"]), truths[0].friction_coefficient],
        "vertices": len(own.body.x0),
        "thickness": thickness_of(own.body),
        "corrections": len(described.get("corrections", [])),
    }


def thickness_of(body: Body) -> float:
    """Of a cloth, or the diameter of a rope [m]."""
    return 2.0 * body.elements.half_height


def problem_of(project: Project, sequence: str) -> Problem:
    """What the stages fit to, without silhouettes."""
    return load_problem(lambda stage: project.artifact(stage, sequence))


def write_page() -> None:
    """results/thin_rigged.md, of what stands in thin.json."""
    record = json.loads((RESULTS / "thin.json").read_text())
    ends = {"": "", ", hold given": "_hold_given", ", shape seen": "_shape_seen"}
    named = [(name + words, f"{body}_lift{end}") for body, name in NAMES.items() for words, end in ends.items()]
    rows = [_row(label, record[part]) for label, part in named if part in record]
    (RESULTS / "thin_rigged.md").write_text("\n".join([*_HEAD, *rows, "", *_FOOT, ""]))


_HEAD = [
    "# The rig's rope and cloth through the stages",
    "",
    "`physreal compose sequences=thin` (of the corner `thin_corner`) in a project, the stages up to `fit_global` of the lifts and up to `sample_particles` of the swings, then",
    "`python -m benchmarks.thin.rigged --project FOLDER rope cloth` (`corner`). Given: the shape and the thickness, the density, one click on the object and",
    "one on the hand, the true camera, and the boxes that the table counts, drawn round the object in later frames where its mask was wrong.",
    "Errors are means over all nodes of the true middle, seen or not. The swing is predicted with the lift's model. In a row with the hold",
    "given (`--hold true`) the vertices that the rig holds are given, too, and the tracks alone are fitted. In a row with the shape seen",
    "(`--shape seen`) neither shape nor thickness is given: both are what frame 0 shows, behind the hand too.",
    "",
    "| body | vertices | boxes | observed [mm] | future [mm] | swing, frames 0 to 41 / 42 to 59 [mm] | bending | stretching | friction, true | reach of the hand [mm] |",
    "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
]
_FOOT = [
    "Wanted: 5 mm observed, 10 mm future, 10 mm on the swing, both stiffnesses within 20 %. How a rope or cloth of this kind stretches does not",
    "show: the hanging rope is 0.02 % longer by its own weight, less than a tenth of a millimetre.",
    "",
    "The fits were made on a CPU. How far the hand reaches is fitted with them: each of `grip_reaches`, of which the least objective over the observed",
    "frames is kept (thin.json has all of them); for a cloth beyond the outline of the hand's points, negative within it. A cloth folds along the edge",
    "of its hold. The seen outline of the rig's hand reaches 5 mm beyond the hold that the rig has. The rectangle and the distances were chosen",
    "with the hold of the row `cloth` in view. The cloth that is held at a corner was filmed and fitted once, after they were fixed: the same reach is found,",
    "and the cloth is followed less well. It can fold in two ways as it leaves the table, and small differences decide: with elements of 6 mm in place",
    "of 8 the rig itself moves the nodes by 28 mm in the mean over the lift, and by 3.4 mm where the cloth is held in the middle of its edge",
    "(`python -m data.rig.thin_convergence --scenes`).",
]


def _row(label: str, record: dict[str, Any]) -> str:
    error = {name: f"{1e3 * value:.1f}" for name, value in record["track_error"].items()}
    bending, stretching = (f"{100 * record['stiffness_error'][name]:+.0f} %" for name in ("bending", "stretching"))
    found, true = record["friction_coefficient"]
    reach = "" if record.get("grip_reach") is None else f"{1e3 * record['grip_reach']:g}"
    swing = f"{error['other_motion_observed']} / {error['other_motion_future']}"
    cells = [label, record["vertices"], record["corrections"], error["observed"], error["future"], swing]
    return f"| {' | '.join(map(str, [*cells, bending, stretching, f'{found:.2f}, {true:g}', reach]))} |"


if __name__ == "__main__":
    main()
