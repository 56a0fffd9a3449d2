"""Stage 1: a homogeneous expert material (Theta_1 = E, nu, mu_f) and the grip's stiffness and damping (eq. interaction_force).

A scan of E and the grip's stiffness gives the start of a descent with a growing horizon; what has rate 0 is held.
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

VARIABLES = ("youngs_modulus", "poissons_ratio", "friction_coefficient", "grip_stiffness", "grip_damping")


def run(context: StageContext) -> None:
    """Fits one material for the whole object, and the grip, to the observed frames."""
    params: FitGlobal = context.params
    problem = load_problem(context, params.masks if params.losses.mask > 0 else None)
    model = _initial_model(context)
    objective = objective_of(context, problem, model)
    variables = variables_of({name: getattr(params, name) for name in VARIABLES})
    tell_substeps(context, objective.rollouts, model.fields, variables)
    config = ScanConfig(**params.scan.model_dump())
    with context.timed("scan"):
        model, found = start_from_scan(objective, model, variables, config)
    scan = [{**entry, "objective": finite_or_none(entry["objective"])} for entry in found]
    model, result = descend(context, objective, model, variables, uniform_start(model, variables))
    write_fit(context, objective, model, result, scan=scan)


def _initial_model(context: StageContext) -> Model:
    params: FitGlobal = context.params
    return uniform_model(
        torch.from_numpy(Particles.load(context.input("sample_particles")).patch_positions).double(),
        {name: getattr(params, name).initial for name in VARIABLES},
        elastic_law=params.material.elastic_law,
        plastic_law=params.material.plastic_law,
        plastic=params.material.plastic(),
        simulation=params.simulation.setting(),
    )


if __name__ == "__main__":
    main("fit_global", run)
