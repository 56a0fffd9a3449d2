"""Stage 1: a homogeneous expert material (Theta_1 = E, nu, mu_f) from a scan of E and a descent with a growing horizon."""

import torch

from physreal_core.fitting.curriculum import ScanConfig, scan_youngs_modulus, uniform_start
from physreal_core.fitting.model import Model, uniform_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.variables import Variable
from pipeline.config.fit_global import FitGlobal
from pipeline.stage import StageContext, main
from stages._fit import descend, finite_or_none, objective_of, variable_of, write_fit
from stages._problem import load_problem, patch_positions

TRANSFORMS = {
    "youngs_modulus": "log",
    "poissons_ratio": "logit",
    "friction_coefficient": "log",
    "grip_stiffness": "log",
    "grip_damping": "log",
}


def run(context: StageContext) -> None:
    """Fits one material for the whole object to the observed frames."""
    params: FitGlobal = context.params
    problem = load_problem(context, params.masks if params.losses.mask > 0 else None)
    model = _initial_model(context)
    objective = objective_of(context, problem, model)
    variables = [variable_of(name, transform, getattr(params, name)) for name, transform in TRANSFORMS.items()]
    variables = [variable for variable in variables if variable.rate > 0]
    with context.timed("scan"):
        model, scan = _scan(context, objective, model, variables)
    model, result = descend(context, objective, model, variables, uniform_start(model, variables))
    write_fit(context, objective, model, result, scan=scan)


def _initial_model(context: StageContext) -> Model:
    params: FitGlobal = context.params
    return uniform_model(
        patch_positions(context.input("sample_particles") / "particles.npz"),
        {name: getattr(params, name).initial for name in TRANSFORMS},
        elastic_law=params.material.elastic_law,
        plastic_law=params.material.plastic_law,
        plastic=params.material.plastic(),
        simulation=params.simulation.setting(),
    )


def _scan(
    context: StageContext, objective: Objective, model: Model, variables: list[Variable]
) -> tuple[Model, list[dict[str, float | None]]]:
    """The model at the best Young's modulus of the scan, and what the scan found."""
    moved = next((v for v in variables if v.name == "youngs_modulus"), None)
    if context.params.scan.count < 2 or moved is None:
        return model, []
    config = ScanConfig(**context.params.scan.model_dump())
    found = scan_youngs_modulus(objective, model, moved, config, context.scratch / "scan.json")
    best = min(found, key=lambda entry: entry[1])[0]
    model = model.with_fields(youngs_modulus=torch.full((1,), best))
    return model, [{"youngs_modulus": modulus, "objective": finite_or_none(total)} for modulus, total in found]


if __name__ == "__main__":
    main("fit_global", run)
