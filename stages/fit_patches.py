"""Stage 2: Young's modulus and Poisson's ratio per patch (Theta_2), from Stage 1's model; of a thin body the bending ratio, too."""

from physreal_core.fitting.curriculum import patch_start
from physreal_core.fitting.model import load_model
from pipeline.config.fit_patches import FitPatches
from pipeline.products.particles import Particles
from pipeline.stage import StageContext, main
from stages._fit import descend, objective_of, variables_of, write_fit
from stages._problem import load_problem
from stages._substeps import tell_substeps


def run(context: StageContext) -> None:
    """Fits a material per patch to the observed frames."""
    params: FitPatches = context.params
    problem = load_problem(context.input, params.masks if params.losses.mask > 0 else None)
    model = load_model(context.input("fit_global"))
    objective = objective_of(context, problem, model)
    blocks = params.variables(Particles.load(context.input("sample_particles")).geometry)
    variables = variables_of({name: block for name, block in blocks.items() if name in model.fields})
    tell_substeps(context, objective.rollouts, model.fields, variables)
    model, result = descend(context, objective, model, variables, patch_start(model, variables))
    write_fit(context, objective, model, result)


if __name__ == "__main__":
    main("fit_patches", run)
