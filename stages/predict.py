"""A sequence no model was fitted on, rolled out with another sequence's models: patches aligned, nothing refitted."""

import numpy as np

from physreal_core.checkpoints import remembered
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model, load_model, save_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.transfer import transferred
from pipeline.graph import FIT_STAGES
from pipeline.products.particles import Particles
from pipeline.products.rollout import Rollout
from pipeline.stage import StageContext, main
from stages._fit import roll_out
from stages._problem import load_problem
from stages._substeps import tell_substeps


def run(context: StageContext) -> None:
    """Rolls this sequence out with each fitted model of the sequence under `model_from`."""
    problem = load_problem(context.input)
    source = Particles.load(context.model_input("sample_particles")).x0.astype(np.float64)
    for stage in FIT_STAGES:
        model, placed = transferred(load_model(context.model_input(stage)), source, problem)
        folder = context.output / stage
        folder.mkdir()
        save_model(folder, model)
        with context.timed(f"rollout {stage}"):
            objective = Objective(placed, model, LossConfig(), device=context.params.device)
            tell_substeps(context, objective.rollouts, model.fields)
            _remembered_rollout(stage, objective, model).save(folder)


def _remembered_rollout(stage: str, objective: Objective, model: Model) -> Rollout:
    """The rollout, from its checkpoint where there is one."""
    shape = objective.problem.frame_count, len(objective.problem.body.x0)
    shapes = {"x": (*shape, 3), "F": (*shape, 3, 3), "x_seen": (None, shape[1], 3)}

    def rolled() -> dict[str, np.ndarray]:
        rollout = roll_out(objective, model)
        seen = np.zeros((0, shape[1], 3), np.float32) if rollout.x_seen is None else rollout.x_seen
        return {"x": rollout.x, "F": rollout.F, "x_seen": seen}

    found = remembered("rollout", lambda: [stage], shapes, rolled)
    return Rollout(found["x"], found["F"], found["x_seen"] if len(found["x_seen"]) else None)


if __name__ == "__main__":
    main("predict", run)
