"""The tiny bar of the fits' tests, held at one end, as plans are made for it."""

import dataclasses

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.geometry import patch_weights
from physreal_core.planning import Bounds, Forecast, Grasps, PlanConfig, SearchConfig, grasps_of
from physreal_core.rendering import bind
from physreal_core.simulation import Body
from tests.fitting import scene

BOUNDS = Bounds((-0.05, -0.05, 0.03), (0.09, 0.11, 0.16), 0.8)
"""The hand begins at (0.01, 0.03, 0.06)."""

CONFIG = PlanConfig(
    frames=24, rest=8, spacing=4.0, search=SearchConfig(samples=16, elites=4, rounds=4), evaluations=6, step=0.01
)


def given(dtype: str = "float32") -> tuple[Problem, Model, Grasps]:
    """Body and hold, the true model, the hand."""
    model = scene.model(dtype=dtype, youngs_modulus=6e4)
    problem = scene.problem(model, frames=6, observed=6, with_masks=False)
    return problem, model, grasps_of(problem)


def finer() -> tuple[Problem, Model, Grasps]:
    """The same with particles half as far apart."""
    problem, model, _ = given()
    half = scene.SPACING / 2
    x0 = half * (np.stack(np.meshgrid(*map(np.arange, (14, 6, 4)), indexing="ij"), -1).reshape(-1, 3) + 0.5)
    body = Body(x0, np.full(len(x0), half**3), np.full(len(x0), scene.DENSITY), half)
    patches = model.fields["patch_positions"].numpy()
    near, weights = map(torch.from_numpy, patch_weights(x0, cKDTree(x0).query(patches)[1], 3))
    tracks = dataclasses.replace(problem.tracks, binding=bind(problem.tracks.points0, x0))
    own = {"patch_neighbours": near, "patch_weights": weights, "tracks": tracks}
    problem = dataclasses.replace(problem, body=body, grip=scene.grip(body)[0], **own)
    return problem, model, grasps_of(problem)


def forecast(problem: Problem, model: Model, **further) -> Forecast:
    """Of all particles' places."""
    return Forecast(problem, model, problem.body.x0, **further)


def hidden_way(frames: int, rest: int, to: tuple[float, float, float]) -> np.ndarray:
    """A way that no plan has: straight, from rest to rest, then still; how far the one grasp has moved [m]."""
    s = np.clip(np.arange(frames + 1) / (frames - rest), 0.0, 1.0)[:, None, None]
    return s**2 * (3.0 - 2.0 * s) * np.array(to)
