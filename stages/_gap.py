"""What find_gap and add_effect share: the interactions with one object, the search's settings, lines of progress."""

import dataclasses
from collections.abc import Callable

import torch

from physreal_core.fitting.model import Model
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.thin import ways_along
from physreal_core.fitting.transfer import register, transfer_model
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
        source, target = own.body.x0, other.body.x0
        near, ways = own.patch_neighbours.shape[1], ways_along(other.body)
        moved, neighbours, weights = transfer_model(model, source, target, near, ways)
        near = {"patch_neighbours": torch.from_numpy(neighbours), "patch_weights": torch.from_numpy(weights)}
        other = dataclasses.replace(other, **near)
        found.append(Experiment(other, moved, context.params.device, placement=register(source, target)))
    return found


def settings_of(params: FindGap, seed: int) -> GapSettings:
    """The search's settings: the calibrated ones but for what params.yaml gives."""
    return GapSettings(seed=seed, **params.search())


def teller(context: StageContext) -> Callable[[str], None]:
    """Prints a line of progress under the stage's name."""
    return lambda message: print(f"{context.stage} {context.sequence}: {message}", flush=True)
