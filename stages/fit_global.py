"""Stage 1: a homogeneous expert material (Theta_1 = E, nu, mu_f) and the grip's stiffness and damping (eq. interaction_force).

A scan of E and the grip's stiffness gives the start of a descent with a growing horizon; what has rate 0 is held. A thin body
has the ratios of its bending, weft and shear stiffness beside E; a rope has no Poisson's ratio to be found.
"""

import torch

from physreal_core.fitting.curriculum import ScanConfig, start_from_scan, uniform_start
from physreal_core.fitting.model import Model, uniform_model
from pipeline.config.fit_global import FitGlobal
from pipeline.products.particles import Particles
from pipeline.stage import StageContext, main
from stages._fit import descend, finite_or_none, objective_of, variables_of, write_fit
from stages._problem import load_problem
from stages._substeps import tell_substeps


def run(context: StageContext) -> None:
    """Fits one material for the whole object, and the grip, to the observed frames."""
    params: FitGlobal = context.params
    problem = load_problem(context, params.masks if params.losses.mask > 0 else None)
    particles = Particles.load(context.input("sample_particles"))
    model = _initial_model(params, particles)
    objective = objective_of(context, problem, model)
    variables = variables_of(params.variables(particles.geometry))
    tell_substeps(context, objective.rollouts, model.fields, variables)
    config = ScanConfig(**params.scan.model_dump())
    with context.timed("scan"):
        model, found = start_from_scan(objective, model, variables, config)
    scan = [{**entry, "objective": finite_or_none(entry["objective"])} for entry in found]
    model, result = descend(context, objective, model, variables, uniform_start(model, variables))
    write_fit(context, objective, model, result, scan=scan)


def _initial_model(params: FitGlobal, particles: Particles) -> Model:
    variables = params.variables(particles.geometry)
    acting = {name: v for name, v in variables.items() if name not in OPTIONAL or v.rate > 0 or v.initial != 1.0}
    held = {"poissons_ratio": params.poissons_ratio.initial}  # a rope has none of its own
    return uniform_model(
        torch.from_numpy(particles.patch_positions).double(),
        held | {name: variable.initial for name, variable in acting.items()},
        elastic_law=params.material.elastic_law,
        plastic_law=params.material.plastic_law,
        plastic=params.material.plastic(),
        simulation=params.simulation.setting(),
    )


OPTIONAL = ("weft_ratio", "shear_ratio")
"""What a model has where it is fitted or differs from 1."""


if __name__ == "__main__":
    main("fit_global", run)
