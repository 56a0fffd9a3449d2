"""Stage 3: the residual networks and the patches' latent codes (Theta_3), from the model with the named effect, the experts held.

Of a thin body the model stays as it is. Where an effect was named, the networks are fitted once more without it, to say how much less it leaves them to do.
"""

from physreal_core.fitting.curriculum import NETWORK_FIELDS, patch_start, with_residual
from physreal_core.fitting.descent import DescentResult
from physreal_core.fitting.model import Model, load_model, save_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.share import residual_share
from physreal_core.simulation.laws.residual_config import ResidualConfig
from pipeline.config.fit_residual import FitResidual, Rate
from pipeline.products.fit import Fit, ResidualShare
from pipeline.stage import StageContext, main
from stages._fit import descend, finite_or_none, objective_of, roll_out, summary, variables_of, write_fit
from stages._problem import load_problem
from stages._substeps import tell_substeps


def run(context: StageContext) -> None:
    """Fits what expert laws and named effects leave unexplained in the observed frames."""
    params: FitResidual = context.params
    problem = load_problem(context.input, params.masks if params.losses.mask > 0 else None)
    named = load_model(context.input("add_effect"))
    if problem.body.elements is not None:
        _leave(context, problem, named)
        return
    objective, model, result = _fit(context, problem, named)
    share, share_without = _share(objective, model, result), None
    if named.effects and params.compare:
        without = load_model(context.input("fit_patches"))
        share_without = _share(*_fit(context, problem, without, "fit without the effect"))
    write_fit(context, objective, model, result, residual=share, residual_without_effect=share_without)


def _leave(context: StageContext, problem: Problem, model: Model) -> None:
    """The model as it is, for a thin body: the networks add to the stress of a volume."""
    save_model(context.output, model)
    with context.timed("rollout"):
        roll_out(objective_of(context, problem, model), model).save(context.output)
    Fit(summary(model), left_out="no networks: they add to the stress of a volume, and this body is thin").save(
        context.output
    )


def _fit(
    context: StageContext, problem: Problem, start: Model, label: str = "fit"
) -> tuple[Objective, Model, DescentResult]:
    params: FitResidual = context.params
    model = with_residual(start, ResidualConfig(**params.residual.model_dump()), context.seed)
    objective = objective_of(context, problem, model)
    tell_substeps(context, objective.rollouts, model.fields)
    variables = variables_of(blocks_of(params))
    return objective, *descend(context, objective, model, variables, patch_start(model, variables), label)


def _share(objective: Objective, model: Model, result: DescentResult) -> ResidualShare:
    """What the networks do: their share of the stress, and the objective before and after them."""
    has_stress = objective.rollouts.config.elastic_residual is not None
    return ResidualShare(
        stress_share=residual_share(objective.rollouts, model, objective.problem.observed) if has_stress else None,
        objective_before=next(row["total"] for row in result.history if row["horizon"] == objective.full_horizon),
        objective_after=finite_or_none(result.total),
    )


def blocks_of(params: FitResidual) -> dict[str, Rate]:
    """The rate of each field that moves."""
    return {name: params.latents if name.startswith("latent") else params.networks for name in NETWORK_FIELDS}


if __name__ == "__main__":
    main("fit_residual", run)
