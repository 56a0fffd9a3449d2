"""Stage 3: the residual networks and the patches' latent codes (Theta_3), from the model with the named effect, the experts held.

The networks stay only where they lower the objective in frames that they were not fitted to; else the model stays as it is. Where an effect
was named, the networks are fitted once more without it, to say how much less it leaves them to do. A thin body has one network, of its stress.
"""

from physreal_core.fitting.confirmation import Confirmation, confirmation, measured_from, observed_until
from physreal_core.fitting.curriculum import network_fields, patch_start, with_residual
from physreal_core.fitting.descent import DescentResult
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.share import residual_share
from physreal_core.simulation.laws.residual_config import ResidualConfig
from pipeline.config.fit_residual import FitResidual, Rate
from pipeline.products.fit import Confirmed, ResidualShare
from pipeline.stage import StageContext, main
from stages._fit import descend, finite_or_none, objective_of, variables_of, write_fit
from stages._gap import in_companion
from stages._problem import load_problem
from stages._substeps import tell_substeps


def run(context: StageContext) -> None:
    """Fits what expert laws and named effects leave unexplained in the first observed frames, and keeps it where the last ones confirm it."""
    params: FitResidual = context.params
    problem = load_problem(context.input, params.masks if params.losses.mask > 0 else None)
    named = load_model(context.input("add_effect"))
    seen = observed_until(problem, round(problem.observed * (1.0 - params.kept_back)))
    objective, model, result = _fit(context, seen, named)
    notes = {"residual": _share(objective, model, result)}
    if named.effects and params.compare:
        without = load_model(context.input("fit_patches"))
        notes["residual_without_effect"] = _share(*_fit(context, seen, without, "fit without the effect"))
    if params.kept_back > 0:
        with context.timed("confirmation"):
            recordings, found = _confirmation(context, problem, seen.observed, named, model)
        before, after = ([finite_or_none(value) for value in values] for values in (found.before, found.after))
        notes["confirmation"] = Confirmed(recordings, before, after)
        if not found.confirmed:
            objective, model = objective_of(context, seen, named), named
            notes["left_out"] = _why(recordings, found)
    write_fit(context, objective, model, result, intervals=False, **notes)


def _confirmation(
    context: StageContext, problem: Problem, fitted: int, named: Model, model: Model
) -> tuple[list[str], Confirmation]:
    """Names of the recordings that can confirm the networks, the sequence from frame `fitted` on and its companion, and what they say."""
    losses = LossConfig(**context.params.losses.model_dump())
    unseen = {}
    if losses.settled == 0.0:
        if (late := measured_from(problem, fitted)) is not None:
            unseen[context.sequence] = late, named, model
        if context.companion:
            moved, other = in_companion(context, problem, named)
            unseen[context.companion] = other, moved, in_companion(context, problem, model)[0]
    return list(unseen), confirmation(list(unseen.values()), losses, device=context.params.device)


def _why(recordings: list[str], found: Confirmation) -> str:
    """Why the networks do not stay."""
    if not recordings:
        return "nothing is measured in the frames that were kept back to confirm the networks"
    told = zip(recordings, found.before, found.after, found.denied, strict=True)
    worse = [f"{name} ({before:.4g} without, {after:.4g} with them)" for name, before, after, denied in told if denied]
    return f"the networks do not lower the objective in frames that they were not fitted to, of {' and '.join(worse)}"


def _fit(
    context: StageContext, problem: Problem, start: Model, label: str = "fit"
) -> tuple[Objective, Model, DescentResult]:
    params: FitResidual = context.params
    config = residual_of(params, thin=problem.body.elements is not None)
    model = with_residual(start, config, context.seed)
    objective = objective_of(context, problem, model)
    tell_substeps(context, objective.rollouts, model.fields)
    variables = variables_of(blocks_of(params, config))
    return objective, *descend(context, objective, model, variables, patch_start(model, variables), label)


def _share(objective: Objective, model: Model, result: DescentResult) -> ResidualShare:
    """What the networks do: their share of the stress, and the objective before and after them."""
    has_stress = objective.rollouts.config.elastic_residual is not None
    return ResidualShare(
        stress_share=residual_share(objective.rollouts, model, objective.problem.observed) if has_stress else None,
        objective_before=next(row["total"] for row in result.history if row["horizon"] == objective.full_horizon),
        objective_after=finite_or_none(result.total),
    )


def residual_of(params: FitResidual, *, thin: bool) -> ResidualConfig:
    """Sizes and bounds of the networks of a volume or of a thin body."""
    given = params.residual.model_dump()
    thin_scale = given.pop("thin_strain_scale")
    return ResidualConfig(**given | ({"strain_scale": thin_scale} if thin else {}), thin=thin)


def blocks_of(params: FitResidual, config: ResidualConfig) -> dict[str, Rate]:
    """The rate of each field that moves."""
    named = network_fields(config)
    return {name: params.latents if name.startswith("latent") else params.networks for name in named}


if __name__ == "__main__":
    main("fit_residual", run)
