"""Plans one case in every manner that is asked for, executes each plan in the rig, and says what came of it."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

from benchmarks.planning import twins
from benchmarks.planning.cases import HIDDEN, MANNERS, Case, Manner
from benchmarks.planning.scenes import FRAMES, REST, SETTLED, SPEED, Reached, reached, small_view
from data.rig.driven import Driven
from data.rig.raycast import Raycaster, pixel_rays
from data.rig.rig_scene import RigScene
from physreal_core.array_types import Array, Bool, Float, Tensor
from physreal_core.cores import available_cores
from physreal_core.evaluation import cd_l2_twoway
from physreal_core.fitting.model import Model
from physreal_core.fitting.problem import Problem
from physreal_core.fitting.spread import spread_of
from physreal_core.geometry import farthest_points
from physreal_core.planning import (
    Bounds,
    Cost,
    Execution,
    Forecast,
    PlanConfig,
    Planner,
    PointsToPlaces,
    SearchConfig,
    Silhouette,
    TargetShape,
    execute,
    grasps_of,
    members,
    quick_form,
    with_grip,
)
from physreal_core.planning.goal import Goal
from physreal_core.rendering import Camera

FOLLOWED, NOISE = 100, 0.001
"""Points on the body that the planner sees while a plan is executed, and their noise along each axis [m]."""

MODELS, COARSER = 3, 2.0
"""Models of the ensemble, and the search's spacing of particles over that of the twin."""

REFINED, DRAWN = 6, 8
"""Rounds of the search where the gradient refines what it has found, and where nothing does: the further rounds take more rollouts than the
refinement, if cost and gradient of one way count as three rollouts by each model."""


class InTheRig:
    """Follows a plan in MuJoCo; the hand is led as the mean of its controller points."""

    def __init__(self, driven: Driven, followed: Array, seed: int = 0) -> None:
        self._driven, self._followed, self._random = driven, followed, np.random.default_rng(seed)
        self._first: Array | None = None
        self.nodes: list[Array] = []
        driven.begin_anew()

    def advance(self, controllers: Float[Tensor, "frames controllers 3"]) -> Float[Array, "frames points 3"]:
        """As of `physreal_core.planning.Executor`."""
        hand = controllers.mean(1).double().numpy()
        self._first = hand[0] if self._first is None else self._first
        nodes = self._driven.advance(hand[1:] - self._first)
        self.nodes.append(nodes)
        seen = nodes[:, self._followed]
        return seen + NOISE * self._random.standard_normal(seen.shape)


def measured(
    case: Case, manners: Iterable[str], work: Path, model: twins.Fitted, device: str
) -> Iterator[dict[str, Any]]:
    """A row for each manner.

    Args:
        case: what is planned for.
        manners: of `MANNERS`.
        work: keeps goals.
        model: the twin that plans.
        device: of its simulator.
    """
    problem, fitted = model
    scene = case.setting.scene()
    driven = Driven(scene)
    there = reached(case.setting, case.setting.way(case.goal, case.seed), driven, kept(case, work))
    followed = there.surface[farthest_points(there.start[there.surface], min(FOLLOWED, len(there.surface)))]
    goal = told(case.kind, small_view(scene), there, followed)
    forecast, quick = forecasts(problem, fitted, there.start[followed], device)
    grasps = grasps_of(problem)
    lower, upper = (tuple(map(float, grasps.centres[0] + way)) for way in (case.setting.lower, case.setting.upper))
    bounds, plans = Bounds(lower, upper, SPEED), {}
    for name in manners:
        manner = MANNERS[name]
        planner = Planner(forecast, Cost(goal, SETTLED), grasps, bounds, config_of(case, manner), quick)
        if manner.refined not in plans:
            plans[manner.refined] = planner.plan()
        begun, rig = time.perf_counter(), InTheRig(driven, followed, case.seed)
        done = execute(planner, rig, manner.every, plans[manner.refined])
        seconds = time.perf_counter() - begun
        row = row_of(done, np.concatenate(rig.nodes), there, planner, seconds)
        yield {"case": case.task, "seed": case.seed, "manner": name, **row, **machine_of(device)}


def kept(case: Case, work: Path) -> Path:
    """File of a case's goal."""
    return work / "goals" / f"{case.body}-{case.goal.replace(' ', '_')}-{case.seed}.npz"


def hidden(case: Case, work: Path, model: twins.Fitted) -> dict[str, Any]:
    """A row for the hidden way itself, as the fitted model has it: how far the model alone is from the goal [m], which no plan makes up for.

    The case must have been measured before, which finds its goal.
    """
    problem, fitted = model
    with np.load(kept(case, work)) as file:
        start, end = file["start"], file["end"]
    forecast, way = Forecast(problem, fitted, start), case.setting.way(case.goal, case.seed)
    moved = torch.from_numpy(way.displacement(np.arange(FRAMES + 1) / forecast.fps))[:, None]
    with torch.no_grad():
        seen = forecast(grasps_of(problem).controllers(moved)[None], SETTLED).points[0, 0].mean(0)
    error = np.linalg.norm(seen.double().numpy() - end, axis=1).mean()
    return {"case": case.task, "seed": case.seed, "manner": HIDDEN, "point_error": float(error)}


def forecasts(
    problem: Problem, model: Model, points0: Float[Array, "points 3"], device: str
) -> tuple[Forecast, Forecast | None]:
    """By several models of what the fit leaves open; and the same with larger particles, on which a volume is searched."""
    several, coarse = members(model.fields, spread_of(problem, model), MODELS), quick_form(problem, model, COARSER)
    forecast = Forecast(problem, model, points0, several, device)
    if coarse is None:
        return forecast, None
    return forecast, Forecast(coarse[0], model, points0, [with_grip(fields, coarse[1]) for fields in several], device)


def config_of(case: Case, manner: Manner) -> PlanConfig:
    """Of a plan in a manner."""
    drawing = SearchConfig(samples=24, elites=5, rounds=REFINED if manner.refined else DRAWN, seed=100 * case.seed)
    config = PlanConfig(FRAMES, REST, search=drawing)
    return config if manner.refined else replace(config, refinements=0)


def told(kind: str, scene: RigScene, there: Reached, followed: Array) -> Goal:
    """What the planner is told of a goal."""
    if kind == "points":
        return PointsToPlaces(np.arange(len(followed)), there.end[followed])
    if kind == "shape":
        return TargetShape(there.end[there.surface])
    view = scene.view
    camera = Camera(view.intrinsics(), view.pose(), view.width, view.height)
    return Silhouette(mask_of(there, camera), camera, there.start[followed])


def mask_of(there: Reached, camera: Camera) -> Bool[Array, "height width"]:
    """Where the camera sees the body at the goal, without the hand."""
    K, pose = camera.K.numpy(), camera.T_world_camera.numpy()
    eye, directions, _ = pixel_rays(K, pose, camera.width, camera.height)
    hits = Raycaster(there.end, there.faces).cast(np.broadcast_to(eye, directions.shape), directions)
    return hits.triangle.reshape(camera.height, camera.width) >= 0


def row_of(
    done: Execution, nodes: Float[Array, "frames nodes 3"], there: Reached, planner: Planner, seconds: float
) -> dict[str, Any]:
    """What came of one execution; lengths in m, without the noise of what the planner saw."""
    end = nodes[-SETTLED:].mean(0)
    shown, wanted = end[there.surface], there.end[there.surface]
    begins = np.linalg.norm(there.start - there.end, axis=1).mean()
    return {
        "particles": len(planner.forecast.rollouts.problem.body.x0),
        "models": len(planner.forecast.members),
        "start": float(begins),
        "point_error": float(np.linalg.norm(end - there.end, axis=1).mean()),
        "chamfer": cd_l2_twoway(wanted, shown),
        "start_chamfer": cd_l2_twoway(wanted, there.start[there.surface]),
        "apart_end": float(done.apart[-SETTLED:].mean()),
        "apart": float(done.apart[1:].mean()),
        "cost": done.plans[0].cost,
        "replans": done.replans,
        "seconds_first": done.plans[0].seconds,
        "seconds": done.seconds,
        "seconds_executed": seconds - (done.seconds - done.plans[0].seconds),
        "rollouts": sum(plan.rollouts for plan in done.plans),
        "weights": done.plans[-1].weights.tolist(),
    }


def machine_of(device: str) -> dict[str, Any]:
    """What the planner ran on."""
    if device == "cpu":
        return {"machine": "CPU", "threads": available_cores()}
    return {"machine": torch.cuda.get_device_name(), "threads": available_cores()}
