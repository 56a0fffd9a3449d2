"""What find_gap and add_effect share: the interactions with one object, the search's settings, lines of progress."""

from collections.abc import Callable

from physreal_core.fitting.model import Model
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.transfer import register, transferred
from physreal_core.gap.interactions.experiment import Experiment
from physreal_core.gap.settings import GapSettings
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
        other = load_problem(context.companion_input)
        moved, other = transferred(model, own.body.x0, other, own.patch_neighbours.shape[1])
        placement = register(own.body.x0, other.body.x0)
        found.append(Experiment(other, moved, context.params.device, placement=placement))
    return found


def settings_of(params: FindGap, seed: int) -> GapSettings:
    """The search's settings: the calibrated ones but for what params.yaml gives."""
    return GapSettings(seed=seed, **params.search())


def teller(context: StageContext) -> Callable[[str], None]:
    """Prints a line of progress under the stage's name."""
    return lambda message: print(f"{context.stage} {context.sequence}: {message}", flush=True)
