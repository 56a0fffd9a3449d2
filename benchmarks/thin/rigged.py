"""The rig's rope and cloth through the stages, against their truth: `python -m benchmarks.thin.rigged --project FOLDER rope cloth`

FOLDER is a project that `physreal compose sequences=thin` has set up, in which the stages up to `fit_global` of the lift and up to
`sample_particles` of the swing have run (`dvc repro`, or `physreal run`). The lift's model is rolled out on both motions and compared with
where the rig's middle surface or centre line truly was, at all its nodes, seen or not. Each node starts where frame 0 has it.

Writes the parts `rope_lift` and `cloth_lift` of `results/thin.json` and the page `results/thin_rigged.md`.
"""

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.thin.results import RESULTS, write_part
from data.rig.truth import Truth, load_truth
from physreal_core.array_types import Array, Float
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.thin import bind_to_body, ways_along
from physreal_core.fitting.transfer import transfer_model
from pipeline.products.fit import Fit
from pipeline.project import Project
from stages._problem import load_problem

TARGETS = {"observed": 0.005, "future": 0.010, "other_motion": 0.010, "stiffness": 0.2}


def main() -> None:
    """Measure the bodies that are named, then write the page of all that thin.json has."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.thin.rigged", description=__doc__)
    parser.add_argument("bodies", nargs="+", choices=("rope", "cloth"))
    parser.add_argument("--project", type=Path, required=True)
    arguments = parser.parse_args()
    for body in arguments.bodies:
        record = measured(Project(arguments.project), body)
        write_part(f"{body}_lift", record)
        print(json.dumps(record, indent=1))
    write_page()


def measured(project: Project, body: str) -> dict[str, Any]:
    """`track_error` [m], `stiffness_error` (relative), and what the fit chose, of one body."""
    lift, swing = f"{body}_lift", f"{body}_swing"
    own, other = (problem_of(project, sequence) for sequence in (lift, swing))
    model = load_model(project.artifact("fit_global", lift))
    fit = Fit.load(project.artifact("fit_global", lift))
    near, seen = own.patch_neighbours.shape[1], own.observed
    moved, neighbours, weights = transfer_model(model, own.body.x0, other.body.x0, near, ways_along(other.body))
    there = {"patch_neighbours": torch.from_numpy(neighbours), "patch_weights": torch.from_numpy(weights)}
    truths = [load_truth(project.capture(sequence)) for sequence in (lift, swing)]
    errors = errors_of(own, model, truths[0])
    predicted = errors_of(dataclasses.replace(other, **there), moved, truths[1])
    return {
        "track_error": {
            "observed": float(errors[:seen].mean()),
            "future": float(errors[seen:].mean()),
            "other_motion": float(predicted.mean()),
            "other_motion_observed": float(predicted[:seen].mean()),
            "other_motion_future": float(predicted[seen:].mean()),
        },
        "stiffness_error": stiffness_errors(model, truths[0]),
        "friction_coefficient": [float(model.fields["friction_coefficient"]), truths[0].friction_coefficient],
        "grip_reach": model.grip_reach,
        "grip_reaches": fit.grip_reaches,
        "objective": fit.descent.objective,
        "vertices": len(own.body.x0),
        "corrections": len(json.loads((project.capture(lift) / "capture.json").read_text()).get("corrections", [])),
    }


def problem_of(project: Project, sequence: str) -> Problem:
    """What the stages fit to, without silhouettes."""
    return load_problem(lambda stage: project.artifact(stage, sequence))


def errors_of(problem: Problem, model: Model, truth: Truth) -> Float[Array, "frames nodes"]:
    """Distances of the rig's nodes from where the model has them [m]."""
    with torch.no_grad():
        x = Objective(problem, model, LossConfig()).rollout(model.fields, problem.frame_count).x.double().numpy()
    true = truth.middle_vertices.astype(float)
    bound = bind_to_body(true[0], problem.body, 8)
    carried = (x[: len(true), bound.neighbours.numpy()] * bound.weights.double().numpy()[..., None]).sum(2)
    return np.linalg.norm(carried + (true[0] - carried[0]) - true, axis=2)


def stiffness_errors(model: Model, truth: Truth) -> dict[str, float]:
    """Found over true stiffness, less one: of bending E I or D, of stretching E A or E t."""
    E, ratio = (float(model.fields[name].mean()) for name in ("youngs_modulus", "bending_ratio"))
    if truth.geometry == "linear":
        area, moment = math.pi * truth.thickness**2 / 4, math.pi * truth.thickness**4 / 64
        bending, stretching, true = E * ratio * moment, E * area, truth.stretching_stiffness
    else:
        nu = float(model.fields["poissons_ratio"].mean())
        bending, stretching = E * ratio * truth.thickness**3 / 12 / (1 - nu**2), E * truth.thickness
        true = truth.membrane_stiffness
    return {"bending": bending / truth.bending_stiffness - 1, "stretching": stretching / true - 1}


def write_page() -> None:
    """results/thin_rigged.md, of what stands in thin.json."""
    record = json.loads((RESULTS / "thin.json").read_text())
    rows = [_row(body, record[f"{body}_lift"]) for body in ("rope", "cloth") if f"{body}_lift" in record]
    (RESULTS / "thin_rigged.md").write_text("\n".join([*_HEAD, *rows, "", *_FOOT, ""]))


_HEAD = [
    "# The rig's rope and cloth through the stages",
    "",
    "`physreal compose sequences=thin` in a project, the stages up to `fit_global` of the lifts and up to `sample_particles` of the swings, then",
    "`python -m benchmarks.thin.rigged --project FOLDER rope cloth`. Given: the shape and the thickness, the density, one click on the object and",
    "one on the hand, the true camera, and the boxes that the table counts, drawn round the object in later frames where its mask was wrong.",
    "Errors are means over all nodes of the true middle, seen or not. The swing is predicted with the lift's model.",
    "",
    "| body | vertices | boxes | observed [mm] | future [mm] | swing, frames 0 to 41 / 42 to 59 [mm] | bending | stretching | friction, true | held within [mm] |",
    "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
]
_FOOT = [
    "Wanted: 5 mm observed, 10 mm future, 10 mm on the swing, both stiffnesses within 20 %. How a rope or cloth of this kind stretches does not",
    "show: the hanging rope is 0.02 % longer by its own weight, less than a tenth of a millimetre.",
]


def _row(body: str, record: dict[str, Any]) -> str:
    error = {name: f"{1e3 * value:.1f}" for name, value in record["track_error"].items()}
    bending, stretching = (f"{100 * record['stiffness_error'][name]:+.0f} %" for name in ("bending", "stretching"))
    found, true = record["friction_coefficient"]
    reach = "all bound" if record["grip_reach"] is None else f"{1e3 * record['grip_reach']:g}"
    swing = f"{error['other_motion_observed']} / {error['other_motion_future']}"
    cells = [body, record["vertices"], record["corrections"], error["observed"], error["future"], swing]
    return f"| {' | '.join(map(str, [*cells, bending, stretching, f'{found:.2f}, {true:g}', reach]))} |"


if __name__ == "__main__":
    main()
