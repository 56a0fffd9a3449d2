"""A model on the same object in another place: patches and local effects carried over by rigid registration of the particles."""

import dataclasses
import itertools
from typing import Any

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float, Int
from physreal_core.effects import EFFECTS
from physreal_core.fitting.model import Model
from physreal_core.fitting.named_effects import effect_record
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.thin import ways_along
from physreal_core.geometry.patches import patch_weights, weights_at
from physreal_core.geometry.ways import distances_along
from physreal_core.simulation.laws import turned_weights

_TIE = (1.05, 1e-4)
"""A larger turn must beat a smaller one by this factor, and by this share of the target's variance: a symmetric object keeps the
orientation it is seen in."""


def transfer_model(
    model: Model,
    source: Float[Array, "n 3"],
    target: Float[Array, "m 3"],
    neighbours: int = 4,
    ways: Int[Array, "ways 2"] | None = None,
) -> tuple[Model, Int[Array, "m k"], Float[Array, "m k"]]:
    """`model` with patches and effects where they lie on the target's geometry and networks that turn with the body, and the target particles'
    interpolation weights.

    Args:
        model: fitted with particles `source`.
        source: [m], shape [n, 3], particles at frame 0 of the sequence it was fitted on, world frame.
        target: [m], shape [m, 3], particles at frame 0 of the other sequence.
        neighbours: patches each particle takes its material from.
        ways: of a thin target (`geometry.ways`): the patches lie at the vertices nearest to them, and distances are along the body.
    """
    rotation, translation = register(source, target)
    patches = model.fields["patch_positions"].numpy() @ rotation.T + translation
    if ways is None:
        points = np.concatenate([target, patches])
        indices, weights = patch_weights(points, np.arange(len(target), len(points)), neighbours)
    else:
        indices, weights = weights_at(distances_along(target, ways, cKDTree(target).query(patches)[1]), neighbours)
    fields = {**model.fields, **_turned_networks(model, rotation), "patch_positions": torch.from_numpy(patches)}
    effects = [_carried(record, rotation, translation) for record in model.effects]
    moved = dataclasses.replace(model, fields=fields, effects=effects)
    return moved, indices[: len(target)], weights[: len(target)]


def transferred(
    model: Model, source: Float[Array, "n 3"], problem: Problem, neighbours: int | None = None
) -> tuple[Model, Problem]:
    """`model` and `problem`, which shows the same object in another place, with the patches where they lie there.

    Args:
        model: fitted with particles `source`.
        source: [m], shape [n, 3], as for `transfer_model`.
        problem: the other sequence.
        neighbours: patches each particle takes its material from; by default as many as it does in `problem`.
    """
    near = problem.patch_neighbours.shape[1] if neighbours is None else neighbours
    moved, indices, weights = transfer_model(model, source, problem.body.x0, near, ways_along(problem.body))
    there = {"patch_neighbours": torch.from_numpy(indices), "patch_weights": torch.from_numpy(weights)}
    return moved, dataclasses.replace(problem, **there)


def _turned_networks(model: Model, rotation: Float[Array, "3 3"]) -> dict[str, torch.Tensor]:
    """Those that the model has."""
    names = [name for name in ("network_elastic", "network_plastic") if name in model.fields]
    R = torch.from_numpy(np.ascontiguousarray(rotation))
    return {name: turned_weights(model.residual, model.fields[name], R) for name in names}


def _carried(record: dict[str, Any], rotation: Float[Array, "3 3"], translation: Float[Array, "3"]) -> dict[str, Any]:
    """An effect's record in the new place; without intervals where its values have changed, since those hold for the old ones."""
    values = EFFECTS[record["name"]].carried(record["values"], rotation, translation)
    if values == record["values"]:
        return record
    return effect_record(record["name"], values, probability=record.get("probability"))


def register(
    source: Float[Array, "n 3"], target: Float[Array, "m 3"], iterations: int = 30
) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
    """Rigid motion (R, t) of `source` onto `target` [m]: closest points (Besl and McKay 1992) from five starts.

    The starts are no turn at all and the four proper ways of laying the principal axes on each other; the lowest mean squared
    distance, both ways, wins, and among near equals the smallest turn.
    """
    centres = source.mean(0), target.mean(0)
    axes = [_principal_axes(points - centre) for points, centre in zip((source, target), centres, strict=True)]
    signs = [np.diag(s) for s in itertools.product((1.0, -1.0), repeat=3)]
    turns = [axes[1] @ sign @ axes[0].T for sign in signs]
    starts = [np.eye(3), *(turn for turn in turns if np.linalg.det(turn) > 0.0)]
    tree = cKDTree(target)
    found = [_closest_points(source, target, tree, R, centres[1] - R @ centres[0], iterations) for R in starts]
    limit = _TIE[0] * min(cost for cost, _, _ in found) + _TIE[1] * target.var(0).sum()
    _, rotation, translation = max((f for f in found if f[0] <= limit), key=lambda f: np.trace(f[1]))
    return rotation, translation


def _principal_axes(centred: Float[Array, "n 3"]) -> Float[Array, "3 3"]:
    return np.linalg.eigh(centred.T @ centred)[1]


def _closest_points(source, target, tree, rotation, translation, iterations):
    for _ in range(iterations):
        nearest = target[tree.query(source @ rotation.T + translation)[1]]
        rotation, translation = _best_motion(source, nearest)
    moved = source @ rotation.T + translation
    cost = (tree.query(moved)[0] ** 2).mean() + (cKDTree(moved).query(target)[0] ** 2).mean()
    return cost, rotation, translation


def _best_motion(source, nearest):
    """Least-squares rotation and translation between paired points (Kabsch 1976)."""
    a, b = source.mean(0), nearest.mean(0)
    U, _, Vt = np.linalg.svd((nearest - b).T @ (source - a))
    rotation = U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt
    return rotation, b - rotation @ a
