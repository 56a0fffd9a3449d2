"""The rig's hand that comes, takes and lets go, through the stages, against the truth: `python -m benchmarks.taken --project FOLDER`

FOLDER is a project that `physreal compose sequences=taking` has set up, in which the stages up to `fit_global` have run (`physreal run`). The
fitted model is rolled out and compared with where all nodes of the rig's mesh truly were; each starts where frame 0 has it.

Writes `results/taken.md`.
"""

import argparse
from pathlib import Path

import numpy as np

from benchmarks.thin.results import RESULTS
from benchmarks.thin.rigged import problem_of
from benchmarks.thin.rigged_fit import errors_of
from data.rig.rig_scene import plush_take
from data.rig.truth import load_truth
from physreal_core.fitting.model import load_model
from pipeline.project import Project

SEQUENCE = "plush_take"


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.taken", description=__doc__)
    parser.add_argument("--project", type=Path, required=True)
    project = Project(parser.parse_args().project)
    page = report(project)
    (RESULTS / "taken.md").write_text(page)
    print(page)


def report(project: Project) -> str:
    """The page, of a project in which the fit is done."""
    model, problem = load_model(project.artifact("fit_global", SEQUENCE)), problem_of(project, SEQUENCE)
    truth, grip = load_truth(project.capture(SEQUENCE)), problem.grip
    error = 1e3 * errors_of(problem, model, truth.vertices.astype(float)).mean(1)
    taken, released = int(grip.taken.min()), int(grip.released.min())
    came, left = (round(time * problem.fps) for time in plush_take().holds)
    parts = {
        f"before it is taken (frames 0 to {taken - 1})": error[:taken],
        f"held (to {released - 1})": error[taken:released],
        f"falling and fallen, observed (to {problem.observed - 1})": error[released : problem.observed],
        f"future (to {len(error) - 1})": error[problem.observed :],
    }
    fitted = {name: float(model.fields[name].mean()) for name in ("youngs_modulus", "friction_coefficient")}
    lines = [
        "# A hand that comes, takes and lets go",
        "",
        "`physreal compose sequences=taking` in a project, the stages up to `fit_global`, then `python -m benchmarks.taken --project FOLDER`. Given:",
        "the stress-free shape, the density, one click on the object and one on the hand, the true camera. Errors are means over all nodes of the",
        "rig's mesh, seen or not.",
        "",
        f"The hand takes in frame {came} and lets go in frame {left}; found from the tracks in the pictures: {taken} and {released}.",
        "",
        "| frames | error [mm] |",
        "|---|--:|",
        *(f"| {words} | {np.mean(values):.1f} |" for words, values in parts.items()),
        "",
        f"Young's modulus {fitted['youngs_modulus'] / 1e3:.1f} kPa, true {truth.youngs_modulus / 1e3:g};",
        f"friction {fitted['friction_coefficient']:.2f}, true {truth.friction_coefficient:g}.",
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
