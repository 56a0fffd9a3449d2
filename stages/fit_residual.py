"""Stage 3: the residual networks and the patches' latent codes (Theta_3), from Stage 2's model, the experts held."""

from physreal_core.fitting.curriculum import NETWORK_FIELDS, patch_start, with_residual
from physreal_core.fitting.model import load_model
from physreal_core.simulation.constitutive.residual_config import ResidualConfig
from pipeline.config.fit_residual import FitResidual, Rate
from pipeline.stage import StageContext, main
from stages._fit import descend, objective_of, variables_of, write_fit
from stages._problem import load_problem


def run(context: StageContext) -> None:
    """Fits what the expert laws leave unexplained in the observed frames."""
    params: FitResidual = context.params
    problem = load_problem(context, params.masks if params.losses.mask > 0 else None)
    model = load_model(context.input("fit_patches"))
    model = with_residual(model, ResidualConfig(**params.residual.model_dump()), context.seed)
    objective = objective_of(context, problem, model)
    variables = variables_of(blocks_of(params))
    model, result = descend(context, objective, model, variables, patch_start(model, variables))
    write_fit(context, objective, model, result)


def blocks_of(params: FitResidual) -> dict[str, Rate]:
    """The rate of each field that moves."""
    return {name: params.latents if name.startswith("latent") else params.networks for name in NETWORK_FIELDS}


if __name__ == "__main__":
    main("fit_residual", run)
