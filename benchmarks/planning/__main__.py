"""Plans for fitted bodies, executed in the rig's MuJoCo, which is another simulator than the one that plans:

    python -m benchmarks.planning --work FOLDER --project FOLDER plush:held_up:points rope:laid_along_a_curve:points

A case is a body, a goal (`scenes.SETTINGS`) and what the planner is told of it: `points` to places, a `shape`, or a `mask` in the rig's camera.
PROJECT has `plush_lift` fitted up to `--model` (after `scripts/run_example.sh`, this one). WORK keeps goals, models and rows, so that cases may
run one after another; the page is made of all rows in it.

Writes `results/planning.json` and `results/planning.md`.
"""

import argparse
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.planning import twins
from benchmarks.planning.report import write_page
from benchmarks.planning.scenes import FRAMES, REST, SETTINGS, SETTLED, SPEED, Reached, Setting, reached, small_view
from data.rig.driven import Driven
from data.rig.raycast import Raycaster, pixel_rays
from data.rig.rig_scene import RigScene
from physreal_core.array_types import Array, Bool, Float, Tensor
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
from pipeline.project import Project

FOLLOWED, NOISE = 100, 0.001
"""Points on the body that the planner sees while a plan is executed, and their noise along each axis [m]."""

MODELS, COARSER, EVERY = 3, 2.0, 12
"""Models of the ensemble, the search's spacing of particles over that of the twin, and frames between plans."""


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


def main() -> None:
    """Run the cases that have no rows yet, then write the page."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.planning", description=__doc__)
    parser.add_argument("cases", nargs="*", help="body:goal:kind, a goal's spaces as underscores")
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--project", type=Path, default=Path())
    parser.add_argument("--model", default="fit_patches", help="stage whose model of plush_lift is used")
    arguments = parser.parse_args()
    rows = arguments.work / "rows"
    rows.mkdir(parents=True, exist_ok=True)
    for case in arguments.cases:
        file = rows / f"{case.replace(':', '-')}.json"
        if file.is_file():
            continue
        found = []
        for row in measured(case, arguments):
            found.append(row)
            file.write_text(json.dumps(found, indent=1) + "\n")
            print(json.dumps(row, indent=1), flush=True)
    write_page([row for file in sorted(rows.glob("*.json")) for row in json.loads(file.read_text())])


def measured(case: str, arguments: argparse.Namespace) -> Iterator[dict[str, Any]]:
    """A row for the plan that is followed to its end, then one for plans that are made anew."""
    body, goal, kind = case.split(":")
    setting, goal = SETTINGS[body], goal.replace("_", " ")
    scene = setting.scene()
    if body == "plush":
        problem, model = twins.plush(Project(arguments.project.resolve()), arguments.model)
    else:
        problem, model = twins.thin(scene, arguments.work)
    driven = Driven(scene)
    kept = arguments.work / "goals" / f"{body}_{goal.replace(' ', '_')}.npz"
    there = reached(setting, goal, driven, kept)
    followed = there.surface[farthest_points(there.start[there.surface], min(FOLLOWED, len(there.surface)))]
    planner = planner_of(setting, problem, model, there, followed, told(kind, small_view(scene), there, followed))
    first = planner.plan()
    for every in (None, EVERY):
        begun, rig = time.perf_counter(), InTheRig(driven, followed)
        done = execute(planner, rig, every, first)
        seconds = time.perf_counter() - begun
        yield row_of(case, done, np.concatenate(rig.nodes), there, planner, seconds) | {"every": every}


def planner_of(
    setting: Setting, problem: Problem, model: Model, there: Reached, followed: Array, goal: Goal
) -> Planner:
    """A planner with several models of what the fit leaves open; a volume is searched on with larger particles."""
    points0, several = there.start[followed], members(model.fields, spread_of(problem, model), MODELS)
    forecast, coarse = Forecast(problem, model, points0, several), quick_form(problem, model, COARSER)
    quick = None
    if coarse is not None:
        quick = Forecast(coarse[0], model, points0, [with_grip(fields, coarse[1]) for fields in several])
    grasps = grasps_of(problem)
    lower, upper = (tuple(map(float, grasps.centres[0] + way)) for way in (setting.lower, setting.upper))
    config = PlanConfig(FRAMES, REST, search=SearchConfig(samples=24, elites=5, rounds=6))
    return Planner(forecast, Cost(goal, SETTLED), grasps, Bounds(lower, upper, SPEED), config, quick)


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
    case: str, done: Execution, nodes: Float[Array, "frames nodes 3"], there: Reached, planner: Planner, seconds: float
) -> dict[str, Any]:
    """What came of one execution; lengths in m, without the noise of what the planner saw."""
    end = nodes[-SETTLED:].mean(0)
    shown, wanted = end[there.surface], there.end[there.surface]
    begins = np.linalg.norm(there.start - there.end, axis=1).mean()
    return {
        "case": case,
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
        "threads": int(os.environ.get("OMP_NUM_THREADS", os.cpu_count() or 1)),
    }


if __name__ == "__main__":
    main()
