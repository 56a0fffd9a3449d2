"""Stage 1: a homogeneous expert material (Theta_1 = E, nu, mu_f), the grip's stiffness and damping (eq. interaction_force), and the friction
of a hand that pushes.

A scan of E and the grip's stiffness gives the start of a descent with a growing horizon; what has rate 0 is held. A thin body
has the ratios of its bending, weft and shear stiffness beside E; a rope has no Poisson's ratio to be found. How far a hand holds it is
not seen, and moves what hangs from it: scan and descent run once for each distance in `grip_reaches`, and the best is kept; of a volume
the farthest that is not much worse, for some motions hardly tell, and in a hold that is too short a body seems too stiff.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import torch

from physreal_core.fitting.curriculum import ScanConfig, start_from_scan, uniform_start
from physreal_core.fitting.descent import DescentResult
from physreal_core.fitting.grip import distinct_reaches, farthest_as_good
from physreal_core.fitting.model import Model, uniform_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.variables import Variable
from pipeline.config.fit_global import FitGlobal
from pipeline.products.particles import Particles
from pipeline.stage import StageContext, main
from stages._fit import descend, finite_or_none, objective_of, variables_of, write_fit
from stages._problem import load_problem
from stages._substeps import tell_substeps

MUCH_WORSE = 0.1
"""Share by which the objective of a farther reach of a volume's hold may be above the least."""


def run(context: StageContext) -> None:
    """Fits one material for the whole object, and the grip, to the observed frames."""
    params: FitGlobal = context.params
    problem = load_problem(context.input, params.masks if params.losses.mask > 0 else None)
    particles = Particles.load(context.input("sample_particles"))
    model = initial_model(params, particles)
    variables = acting(variables_of(params.variables(particles.geometry, pushed=particles.pushed)), problem)
    tell_substeps(context, objective_of(context, problem, model).rollouts, model.fields, variables)
    given = params.of(particles.geometry).grip_reaches
    reaches = (distinct_reaches(problem.grip, given) if problem.grip else []) or [None]
    fits = [_fit(context, problem, dataclasses.replace(model, grip_reach=reach), variables) for reach in reaches]
    worse = MUCH_WORSE if particles.geometry == "volumetric" else 0.0
    best = fits[farthest_as_good([fit.result.total for fit in fits], worse)]
    holds = [{"reach": fit.model.grip_reach, "objective": finite_or_none(fit.result.total)} for fit in fits]
    notes = {"scan": best.scan} | ({"grip_reaches": holds} if len(holds) > 1 else {})
    write_fit(context, best.objective, best.model, best.result, **notes)


@dataclass(frozen=True)
class _Fitted:
    """One scan and descent."""

    objective: Objective
    model: Model
    result: DescentResult
    scan: list[dict[str, Any]]


def _fit(context: StageContext, problem: Problem, model: Model, variables: list[Variable]) -> _Fitted:
    label = "fit" if model.grip_reach is None else f"fit, reach {1e3 * model.grip_reach:g} mm"
    objective = objective_of(context, problem, model)
    config = ScanConfig(**context.params.scan.model_dump())
    with context.timed("scan"):
        model, found = start_from_scan(objective, model, variables, config)
    scan = [{**entry, "objective": finite_or_none(entry["objective"])} for entry in found]
    model, result = descend(context, objective, model, variables, uniform_start(model, variables), label)
    return _Fitted(objective, model, result, scan)


def acting(variables: list[Variable], problem: Problem) -> list[Variable]:
    """The variables without those of a grip where the hand only pushes."""
    pushes_only = problem.tool is not None and problem.grip is None
    return [v for v in variables if not (pushes_only and v.name.startswith("grip_"))]


def initial_model(params: FitGlobal, particles: Particles) -> Model:
    """One material for the whole object, of the starting values."""
    variables = params.variables(particles.geometry, pushed=particles.pushed)
    present = {name: v for name, v in variables.items() if name not in OPTIONAL or v.rate > 0 or v.initial != 1.0}
    held = {"poissons_ratio": params.poissons_ratio.initial}  # a rope has none of its own
    return uniform_model(
        torch.from_numpy(particles.patch_positions).double(),
        held | {name: variable.initial for name, variable in present.items()},
        elastic_law=params.material.elastic_law,
        plastic_law=params.material.plastic_law,
        plastic=params.material.plastic(),
        simulation=params.simulation.setting(),
    )


OPTIONAL = ("weft_ratio", "shear_ratio")
"""What a model has where it is fitted or differs from 1."""


if __name__ == "__main__":
    main("fit_global", run)
