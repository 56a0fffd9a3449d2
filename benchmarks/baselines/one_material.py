"""One elastic material for the whole body, by gradient through a material point simulator; the hand is rigid.

PAC-NeRF (Li et al., ICLR 2023) and PhysFlow (Liu et al., CVPR 2025) find E and nu of one material; neither has a hold that gives.
Simulator and descent are our own.
"""

from dataclasses import replace

import torch

from benchmarks.baselines.ours import Material
from benchmarks.baselines.scene import Scene
from physreal_core.fitting.curriculum import ScanConfig, fit_one_material
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.model import uniform_model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.variables import Variable

START = {"youngs_modulus": 5e4, "poissons_ratio": 0.3, "friction_coefficient": 0.4, "grip_damping": 0.01}
RIGID = 150.0
"""Of the hand's bonds [N]: as stiff as our own fit ever makes them."""

VARIABLES = [
    Variable("youngs_modulus", "log", rate=0.1, lower=1e3, upper=5e6),
    Variable("poissons_ratio", "logit", rate=0.1, lower=0.05, upper=0.45),
]
DESCENT = DescentConfig(iterations=30, warmup=3, first_horizon=0.4)


def fit(scene: Scene, seconds: float) -> Material:
    """From the best of a scan of E. It converges long before `seconds` are over."""
    problem = _one_patch(replace(scene.problem, masks=None))
    model = uniform_model(
        torch.as_tensor(problem.body.x0.mean(0, keepdims=True)),
        {**START, "grip_stiffness": RIGID},
        elastic_law="fixed_corotated",
        simulation=scene.settings["fit_global"].simulation.setting(),
    )
    objective = Objective(problem, model, scene.losses)
    model, _ = fit_one_material(objective, model, VARIABLES, ScanConfig(count=7, factor=2.0), DESCENT)
    return Material(model, problem.body.x0, numbers=len(VARIABLES))


def _one_patch(problem: Problem) -> Problem:
    count = len(problem.body.x0)
    one = {"patch_neighbours": torch.zeros((count, 1), dtype=torch.long), "patch_weights": torch.ones((count, 1))}
    return replace(problem, **{name: tensor.to(getattr(problem, name)) for name, tensor in one.items()})
