"""What `benchmarks.thin.rigged` computes, on arrays alone, so that a machine with a card and little else can do it, too."""

import dataclasses
import itertools
import math

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Bool, Float, Int
from physreal_core.fitting.curriculum import ScanConfig, fit_one_material
from physreal_core.fitting.descent import DescentConfig
from physreal_core.fitting.grip import springs
from physreal_core.fitting.losses import LossConfig
from physreal_core.fitting.model import Model
from physreal_core.fitting.objective import Objective
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.thin import bind_to_body
from physreal_core.fitting.variables import Variable

PARTS = 4
"""Into which each side of an element is cut to know where it lies."""


def held_at(
    problem: Problem,
    nodes: Float[Array, "nodes 3"],
    elements: Int[Array, "elements corners"],
    held: Int[Array, " held"],
) -> Problem:
    """The problem where the hand holds the vertices that lie nearer than half a spacing to what the rig holds.

    Args:
        problem: of one motion.
        nodes: of the rig's middle in frame 0 [m].
        elements: of it.
        held: nodes that the rig's hand holds; elements between them are held.
    """
    between, parts = elements[np.isin(elements, held).all(axis=1)], range(PARTS + 1)
    shares = [share for share in itertools.product(parts, repeat=elements.shape[1]) if sum(share) == PARTS]
    points = np.einsum("sc,ecd->sed", np.array(shares) / PARTS, nodes[between]).reshape(-1, 3)
    return with_held(problem, cKDTree(points).query(problem.body.x0)[0] < 0.5 * problem.body.spacing)


def with_held(problem: Problem, held: Bool[Array, " particles"]) -> Problem:
    """The problem where the hand holds these particles, by bonds to the nearest of its points in frame 0."""
    body, points = problem.body, problem.controllers[0].double().numpy()
    return dataclasses.replace(problem, grip=springs(body.x0, np.flatnonzero(held), points, body.spacing, 8))


def refitted(
    problem: Problem, model: Model, variables: list[Variable], scan: ScanConfig, descent: DescentConfig, device: str
) -> tuple[Model, float]:
    """Stage 1 on tracks alone from `model`'s values, and the objective."""
    objective = Objective(problem, model, LossConfig(mask=0.0), device=device)
    model, result = fit_one_material(objective, model, variables, scan, descent)
    return model, result.total


def errors_of(
    problem: Problem, model: Model, true: Float[Array, "frames nodes 3"], device: str = "cpu"
) -> Float[Array, "frames nodes"]:
    """Distances of the rig's nodes from where the model has them [m]; each starts where frame 0 has it."""
    with torch.no_grad():
        states = Objective(problem, model, LossConfig(), device=device).rollout(model.fields, problem.frame_count)
    x, bound = states.x.double().cpu().numpy(), bind_to_body(true[0], problem.body, 8)
    carried = (x[: len(true), bound.neighbours.numpy()] * bound.weights.double().numpy()[..., None]).sum(2)
    return np.linalg.norm(carried + (true[0] - carried[0]) - true, axis=2)


def track_errors(
    lift: Float[Array, "frames nodes"], swing: Float[Array, "frames nodes"], observed: int
) -> dict[str, float]:
    """Means [m], as of thin.json."""
    return {
        "observed": float(lift[:observed].mean()),
        "future": float(lift[observed:].mean()),
        "other_motion": float(swing.mean()),
        "other_motion_observed": float(swing[:observed].mean()),
        "other_motion_future": float(swing[observed:].mean()),
    }


def stiffness_errors(model: Model, truth: dict[str, float | str]) -> dict[str, float]:
    """Found over true stiffness, less one: of bending E I or D, of stretching E A or E t.

    Args:
        model: fitted.
        truth: geometry, thickness [m], bending_stiffness, and stretching_stiffness of a rope or membrane_stiffness of a cloth.
    """
    E, ratio = (float(model.fields[name].mean()) for name in ("youngs_modulus", "bending_ratio"))
    thickness = float(truth["thickness"])
    if truth["geometry"] == "linear":
        bending, stretching = E * ratio * math.pi * thickness**4 / 64, E * math.pi * thickness**2 / 4
        true = float(truth["stretching_stiffness"])
    else:
        nu = float(model.fields["poissons_ratio"].mean())
        bending, stretching = E * ratio * thickness**3 / 12 / (1 - nu**2), E * thickness
        true = float(truth["membrane_stiffness"])
    return {"bending": bending / float(truth["bending_stiffness"]) - 1, "stretching": stretching / true - 1}
