"""The body as a plan holds it: by the recorded hand, by hands at places that are chosen, and with fewer particles for the search."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import torch

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.coarsening import coarsened, held_share
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.rollouts import Fields
from physreal_core.planning.path import Grasps
from physreal_core.playing import Handle
from physreal_core.simulation import Grip
from physreal_core.simulation.pieces import require_thickness

GRAVITY = 9.81


def grasps_of(problem: Problem) -> Grasps:
    """The recorded hand as one grasp.

    Raises:
        InputError: no hand holds the body, or not from frame 0 to the end.
    """
    grip = problem.grip
    if grip is None or not len(grip.particles) or not grip.steady:
        raise InputError(
            "a hand that comes or lets go" if grip is not None and len(grip.particles) else "no hand holds the body",
            where="planning",
            expected="one that holds it from frame 0 to the end",
            remedy="name grasps of your own (`grasps_at`, `physreal plan --grasp`)",
        )
    return Grasps(problem.controllers[0].double(), torch.zeros(problem.controllers.shape[1], dtype=torch.long))


def grasps_at(
    problem: Problem, model: Model, places: Sequence[Float[Array, " 3"]], keep: bool = True
) -> tuple[Problem, Grasps]:
    """The body taken at places, each by the particles nearest to it as a handle of `physreal play` takes them, and the grasps.

    Args:
        problem: the body.
        model: fitted; its grip's stiffness is what the bonds' weights multiply, and the recorded hand holds as far as it reaches in it.
        places: in frame 0 [m].
        keep: whether the recorded hand holds on; it is then the first grasp.

    Raises:
        InputError: as of `grasps_of` where it does, or without any grasp.
    """
    if not keep and not places:
        raise InputError("no grasp", where="planning", expected="the recorded hand, or a place to take the body at")
    x0, weight = problem.body.x0, float(problem.body.mass.sum()) * GRAVITY
    points, group, parts = [], [], []
    if keep:
        own, grip = grasps_of(problem), problem.held_within(model.grip_reach).grip
        points.append(own.points0.numpy())
        group.append(own.group.numpy())
        parts.append((grip.particles, grip.controllers, grip.weights, grip.rest_lengths))
    for place in places:
        handle = Handle.taken(problem.body, x0, np.asarray(place, float), weight, float(model.fields["grip_stiffness"]))
        first = sum(map(len, points))
        parts.append((handle.particles, first + np.arange(len(handle.particles)), handle.weights, handle.lengths))
        group.append(np.full(len(handle.particles), len(points)))
        points.append(handle.points)
    bonds = [np.concatenate(part) for part in zip(*parts, strict=True)]
    grip = Grip(*bonds, reach=np.full(len(bonds[0]), -np.inf))  # held, however far the recorded hand reaches
    grasps = Grasps(torch.from_numpy(np.concatenate(points)), torch.from_numpy(np.concatenate(group)))
    resting = grasps.points0.expand(problem.frame_count, -1, -1)
    return dataclasses.replace(problem, grip=grip, controllers=resting, hand_modes=None), grasps


def quick_form(problem: Problem, model: Model, factor: float) -> tuple[Problem, float] | None:
    """The problem with particles `factor` times as far apart, and what stiffness and damping of its grip have to be multiplied with.

    None where there is no such form: of a thin body, of one that would be a particle thick, and of one that is fastened, pushed, or taken later
    than in frame 0.
    """
    fastened = problem.clamps or problem.loads or problem.tool is not None
    if problem.body.elements is not None or fastened or not (problem.grip and problem.grip.steady):
        return None
    held = problem.held_within(model.grip_reach)
    try:
        coarse = coarsened(held, factor)
        require_thickness(coarse.body.x0, coarse.body.volume, coarse.body.spacing, where="quick_form")
    except InputError:
        return None
    return coarse, held_share(held, coarse)


def with_grip(fields: Fields, share: float) -> Fields:
    """Fields with the grip's stiffness and damping so many times as large."""
    return {**fields, **{name: share * fields[name] for name in ("grip_stiffness", "grip_damping") if name in fields}}
