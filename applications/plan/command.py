"""`physreal plan`: plans with a fitted twin, prints what is to be expected, and writes the plan as a folder."""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from applications.options import require
from applications.plan.goals import read_goal
from applications.plan.written import states_of, table, write_plan
from applications.play.film import film
from applications.twin import Twin
from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.fitting.spread import spread_of
from physreal_core.planning import (
    Bounds,
    Cost,
    Forecast,
    PlanConfig,
    Planner,
    SearchConfig,
    grasps_at,
    grasps_of,
    members,
    quick_form,
    with_grip,
)
from pipeline.graph import FIT_STAGES
from pipeline.project import Project
from pipeline.whole_folder import as_a_whole, require_new

COARSER = 2.0
"""Spacing of the particles in the search over that of the twin."""

REST = 0.33
"""Time at the end in which the hand rests [s]."""

REACH = 0.25
"""How far the hand may go from where it begins along each axis, where no bounds are given [m]."""


def plan(parsed: argparse.Namespace) -> None:
    """Does what the command line asks for.

    Raises:
        InputError: as of `Twin.load` and `read_goal`; the folder is there already, or bounds and grasps do not fit.
    """
    require(parsed.models >= 1, f"{parsed.models} models", "physreal plan --models", "one at least")
    require(parsed.seconds > 2 * REST, f"{parsed.seconds:g} s", "physreal plan --seconds", f"more than {2 * REST:g} s")
    require(
        parsed.rounds is None or parsed.rounds >= 1, f"{parsed.rounds} rounds", "physreal plan --rounds", "one at least"
    )
    project = Project.find()
    folder = parsed.to or project.root / "data" / "planned" / parsed.sequence / parsed.goal.stem
    require_new(folder, "physreal plan")
    twin = Twin.load(project, parsed.sequence, parsed.model or FIT_STAGES[-1], parsed.scene)
    goal, points0 = read_goal(parsed.goal, twin)
    planner = planner_of(parsed, twin, Cost(goal, quantile=parsed.quantile), points0)
    print(
        f"planning for {len(points0)} points by {len(planner.forecast.members)} models; this takes minutes", flush=True
    )
    found = planner.plan()
    with as_a_whole(folder) as draft:
        write_plan(draft, twin, planner, found, parsed.goal)
        if parsed.record:
            film(twin, iter(states_of(planner, found)), draft / "plan.mp4", planner.forecast.fps)
    print(table(planner, found))
    print(f"wrote {folder}")


def planner_of(parsed: argparse.Namespace, twin: Twin, cost: Cost, points0: Float[Array, "points 3"]) -> Planner:
    """The planner that the command line describes."""
    problem, model = twin.problem, twin.model
    spread = spread_of(problem, model, parsed.device) if parsed.models > 1 else None
    several = (model.fields,) if spread is None else members(model.fields, spread, parsed.models, parsed.seed)
    if parsed.grasp or parsed.open:
        problem, grasps = grasps_at(problem, model, [np.array(place) for place in parsed.grasp], keep=not parsed.open)
    else:
        grasps = grasps_of(problem)
    forecast, coarse = Forecast(problem, model, points0, several, parsed.device), None
    if not parsed.grasp:  # a handle holds the particles nearest to a place, which a coarser body has fewer of
        coarse = quick_form(problem, model, COARSER)
    quick = None
    if coarse is not None:
        own = [with_grip(fields, coarse[1]) for fields in several]
        quick = Forecast(coarse[0], model, points0, own, parsed.device)
    rest = round(REST * forecast.fps)
    config = PlanConfig(round(parsed.seconds * forecast.fps), rest, search=SearchConfig(seed=parsed.seed))
    if parsed.rounds is not None:
        config = replace(config, search=replace(config.search, rounds=parsed.rounds))
    return Planner(forecast, cost, grasps, _bounds(parsed, grasps.centres), config, quick)


def _bounds(parsed: argparse.Namespace, centres: Float[Array, "grasps 3"]) -> Bounds:
    """As given, or around where the hands begin, and not below."""
    if parsed.bounds is not None:
        lower, upper = parsed.bounds[:3], parsed.bounds[3:]
        outside = ((centres < lower) | (centres > upper)).any(1)
        if outside.any():
            raise InputError(
                f"the hand begins at {np.round(centres[outside][0], 3).tolist()}",
                where="physreal plan --bounds",
                expected="a box around where it begins",
                remedy="widen the box",
            )
    else:
        lower, upper = centres.min(0) - [REACH, REACH, 0.0], centres.max(0) + REACH
    return Bounds(tuple(map(float, lower)), tuple(map(float, upper)), parsed.speed)
