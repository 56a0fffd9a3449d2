"""What find_gap, add_effect and fit_residual share: the interactions with one object, the search's settings, lines of progress."""

from collections.abc import Callable

from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.transfer import register, transferred
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.settings import GapSettings
from physreal_core.simulation import Body
from pipeline.config.find_gap import FindGap
from pipeline.stage import StageContext
from stages._problem import load_problem
from stages._substeps import tell_substeps


def interactions(context: StageContext, model: Model) -> list[Experiment]:
    """The sequence itself, and its companion where it has one, with `model` where the object lies there."""
    own = load_problem(context.input)
    tell_substeps(context, Rollouts(own, model), model.fields)
    found = [Experiment(own, model, context.params.device)]
    if context.companion:
        moved, other = in_companion(context, own, model)
        placement = register(own.body.x0, other.body.x0)
        found.append(Experiment(other, moved, context.params.device, placement=placement))
    return found


def in_companion(context: StageContext, own: Problem, model: Model) -> tuple[Model, Problem]:
    """The companion, and `model` where the object of `own` lies in it."""
    return transferred(model, own.body.x0, load_problem(context.companion_input), own.patch_neighbours.shape[1])


def settings_of(params: FindGap, seed: int, body: Body) -> GapSettings:
    """The search's settings: the calibrated ones but for what params.yaml gives. By default Stage 1 fits the hold of a thin body alone."""
    return GapSettings(seed=seed, **{"grip_fitted": body.elements is not None} | params.given())


def teller(context: StageContext) -> Callable[[str], None]:
    """Prints a line of progress under the stage's name."""
    return lambda message: print(f"{context.stage} {context.sequence}: {message}", flush=True)
