"""A toy with a stiff and a soft part, through the stages, against the truth: `python -m benchmarks.two_parts --project FOLDER`

FOLDER is a project that `physreal compose sequences=two_parts` has set up, in which the stages up to `fit_patches` of `toy_swing` and up to
`sample_particles` of `toy_lift` have run (`physreal run`). The field that Stage 2 finds is compared with the moduli of the rig's elements: the ratio of
the two parts, and the place of the border between them. Each stage's model is rolled out on both motions and compared with where all nodes of the
rig's mesh truly were; each starts where frame 0 has it.

Writes `results/two_parts.md`.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.thin.results import RESULTS
from benchmarks.thin.rigged import problem_of
from benchmarks.thin.rigged_fit import errors_of
from data.rig.rig_scene import SOFT_LEGS
from data.rig.truth import load_truth
from physreal_core.array_types import Array, Float
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.transfer import register, transferred
from pipeline.project import Project

FITTED, OTHER = "toy_swing", "toy_lift"
STAGES = {"fit_global": "one material (Stage 1)", "fit_patches": "a material per patch (Stage 2)"}


@dataclass(frozen=True)
class Parts:
    """Two levels that fit a field best, and where they meet.

    Attributes:
        border: place along the axis [m].
        lower, upper: geometric means of the field before and behind it, in its unit.
        explained: share of the variance of the field's logarithm that the two levels explain.
    """

    border: float
    lower: float
    upper: float
    explained: float


def parts_of(places: Float[Array, " N"], field: Float[Array, " N"]) -> Parts:
    """The two levels of a positive field along an axis: least squares of its logarithm, over all borders between two places.

    Args:
        places: along the axis [m].
        field: there.
    """
    order = np.argsort(places, kind="stable")
    x, value = places[order], np.log(field[order])
    count = np.arange(1, len(x))
    total, squares = np.cumsum(value), np.cumsum(value**2)
    before = squares[:-1] - total[:-1] ** 2 / count
    behind = squares[-1] - squares[:-1] - (total[-1] - total[:-1]) ** 2 / (len(x) - count)
    left = np.where(x[1:] > x[:-1], before + behind, np.inf)
    best = int(np.argmin(left))
    whole = squares[-1] - total[-1] ** 2 / len(x)
    levels = np.exp([total[best] / (best + 1), (total[-1] - total[best]) / (len(x) - best - 1)])
    return Parts(float(x[best : best + 2].mean()), *map(float, levels), float(1 - left[best] / max(whole, 1e-30)))


def main() -> None:
    """Measure, and write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.two_parts", description=__doc__)
    parser.add_argument("--project", type=Path, required=True)
    page = report(Project(parser.parse_args().project))
    (RESULTS / "two_parts.md").write_text(page)
    print(page)


def report(project: Project) -> str:
    """The page, of a project in which the fits are done."""
    problems = {name: problem_of(project, name) for name in (FITTED, OTHER)}
    truths = {name: load_truth(project.capture(name)) for name in problems}
    models = {stage: load_model(project.artifact(stage, FITTED)) for stage in STAGES}
    observed, own = problems[FITTED].observed, problems[FITTED].body.x0
    rows, future = [], {}
    for stage, words in STAGES.items():
        cells = []
        for name, problem in problems.items():
            pair = (models[stage], problem) if name == FITTED else transferred(models[stage], own, problem)
            errors = errors_of(pair[1], pair[0], truths[name].vertices.astype(float)).mean(1)
            cells.append(f"{1e3 * errors[:observed].mean():.1f} / {1e3 * errors[observed:].mean():.1f}")
            future[stage, name] = errors[observed:].mean() if name == FITTED else errors.mean()
        rows.append(f"| {words} | {' | '.join(cells)} |")
    gained = [1 - future["fit_patches", name] / future["fit_global", name] for name in problems]
    found = parts_of(*_field(models["fit_patches"], problems[FITTED], truths[FITTED].rest_vertices.astype(float)))
    true = parts_of(*_true_field(truths[FITTED]))
    return "\n".join([*_HEAD, *rows, "", *_told(found, true, models["fit_global"], gained), ""])


def _field(model: Model, problem: Problem, rest: Float[Array, "V 3"]) -> tuple[Array, Array]:
    """Places of the particles along the rig's axis at rest [m], and their moduli [Pa]."""
    near, weights = problem.patch_neighbours.numpy(), problem.patch_weights.numpy()
    moduli = (model.fields["youngs_modulus"].numpy()[near] * weights).sum(1) / weights.sum(1)
    rotation, translation = register(problem.body.x0, rest)
    return (problem.body.x0 @ rotation.T + translation)[:, 0], moduli


def _true_field(truth) -> tuple[Array, Array]:
    return truth.rest_vertices[truth.tets].mean(1)[:, 0].astype(float), truth.moduli.astype(float)


_HEAD = [
    "# A toy with a stiff and a soft part",
    "",
    "`physreal compose sequences=two_parts` in a project, the stages up to `fit_patches` of `toy_swing` and up to `sample_particles` of `toy_lift`, then",
    f"`python -m benchmarks.two_parts --project FOLDER`. In MuJoCo's finite elements the rear half of the plush animal has {SOFT_LEGS.share:g} of the modulus",
    "of the front half. By RGB-D with noise. Given: the stress-free shape, the density, one click on the object and one on the hand, the true camera.",
    "Nobody tells the fits that there are two parts. Errors are means over all nodes of the rig's mesh, seen or not. `toy_swing` is held at the",
    "head and swung, so that both parts bend; nothing is fitted to `toy_lift`, where the hand holds the chest, at the border.",
    "",
    f"| error [mm], frames 0 to 41 / after them | `{FITTED}` | `{OTHER}`, predicted |",
    "|---|--:|--:|",
]


def _told(found: Parts, true: Parts, first: Model, gained: list[float]) -> list[str]:
    one = float(first.fields["youngs_modulus"].mean())
    return [
        f"In frames that no fit saw Stage 2 is better than Stage 1 by {100 * gained[0]:.0f} % (`{FITTED}`, after frame 41) and {100 * gained[1]:.0f} % (`{OTHER}`).",
        "",
        "| the field along the body, two levels | found by Stage 2 | true |",
        "|---|--:|--:|",
        f"| modulus of the rear [kPa] | {found.lower / 1e3:.1f} | {true.lower / 1e3:.1f} |",
        f"| modulus of the front [kPa] | {found.upper / 1e3:.1f} | {true.upper / 1e3:.1f} |",
        f"| front over rear | {found.upper / found.lower:.2f} | {true.upper / true.lower:.2f} |",
        f"| border, x [mm] | {1e3 * found.border:.0f} | {1e3 * true.border:.0f} |",
        f"| variance of log E that two levels explain | {found.explained:.2f} | {true.explained:.2f} |",
        "",
        f"One material for all (Stage 1) has {one / 1e3:.1f} kPa.",
    ]


if __name__ == "__main__":
    main()
