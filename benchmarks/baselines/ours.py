"""Our own first two stages, whole and with a part of the objective or the patches left out."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import torch

from benchmarks.baselines.moved import Moved
from benchmarks.baselines.scene import Scene
from physreal_core.array_types import Array, Float
from physreal_core.fitting.curriculum import ScanConfig, fit_material, fit_one_material, patch_start
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.fitting.transfer import transferred
from physreal_core.fitting.variables import Variable
from stages._fit import variables_of
from stages.fit_global import acting, initial_model


@dataclass(frozen=True)
class Material:
    """A model of ours as a `Fitted`.

    Attributes:
        model: fitted.
        x0: particles of frame 0 of the sequence it was fitted to [m].
        numbers: how many of its numbers were fitted.
    """

    model: Model
    x0: Float[Array, "n 3"]
    numbers: int

    def moved(self, problem: Problem) -> Moved:
        """As of `Fitted`; the patches are carried to where the body lies."""
        model, there = transferred(self.model, self.x0, problem)
        rollouts = Rollouts(there, model)
        with torch.no_grad():
            inputs = rollouts.inputs(model.fields, frames=rollouts.frames_needed(problem.frame_count))
            states = rollouts.simulate(inputs)
        x, F = (state[: problem.frame_count].double().numpy() for state in (states.x, states.F))
        return Moved(problem.body.x0, x, F)


def fit(scene: Scene, seconds: float) -> Material:
    """Stage 1 and Stage 2, with the settings that the sequence has in params.yaml; how long they take is theirs."""
    return _fit(scene, scene.losses, patches=True)


def without_patches(scene: Scene, seconds: float) -> Material:
    """Stage 1: one material and the hold."""
    return _fit(scene, scene.losses, patches=False)


def without_motion(scene: Scene, seconds: float) -> Material:
    """Silhouettes alone."""
    return _fit(scene, dataclasses.replace(scene.losses, motion=0.0), patches=True)


def without_masks(scene: Scene, seconds: float) -> Material:
    """Tracks alone."""
    return _fit(scene, dataclasses.replace(scene.losses, mask=0.0), patches=True)


def with_effect(scene: Scene, seconds: float) -> Material:
    """What the project's stages have adopted: Stages 1 and 2 and the effect that the search named."""
    model, found = load_model(scene.read("add_effect")), scene.settings["fit_global"]
    names = {v.name for v in variables_of(found.variables(scene.particles.geometry, pushed=scene.particles.pushed))}
    numbers = sum(model.fields[name].numel() for name in names if name in model.fields)
    numbers += sum(len(effect["values"]) for effect in model.effects)
    return Material(model, scene.problem.body.x0, numbers)


def _fit(scene: Scene, losses: LossConfig, *, patches: bool) -> Material:
    first, second = scene.settings["fit_global"], scene.settings["fit_patches"]
    geometry, problem = scene.particles.geometry, scene.problem
    model = initial_model(first, scene.particles)
    variables = acting(variables_of(first.variables(geometry, pushed=scene.particles.pushed)), problem)
    objective = Objective(problem, model, losses)
    scan = ScanConfig(**first.scan.model_dump())
    model, _ = fit_one_material(objective, model, variables, scan, _descent(first))
    if patches:
        objective = Objective(problem, model, losses)
        variables += (own := variables_of({n: b for n, b in second.variables(geometry).items() if n in model.fields}))
        model, _ = fit_material(objective, model, own, patch_start(model, own), _descent(second))
    return Material(model, problem.body.x0, _numbers(model, variables, patches))


def _descent(settings) -> DescentConfig:
    return DescentConfig(**settings.descent.model_dump())


def _numbers(model: Model, variables: list[Variable], patches: bool) -> int:
    """Each name once: what Stage 2 moves has a number a patch, all else is one number."""
    return sum(model.fields[name].numel() if patches else 1 for name in {v.name for v in variables})
