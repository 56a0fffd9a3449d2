"""A plan in files: a capture of kind `tracks`, as `physreal play` writes one of a pull, and what the plan says of itself."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from applications.play.pulls import STATES
from applications.twin import Twin
from physreal_core.geometry.mesh import save_mesh
from physreal_core.planning import Plan, Planner, PointsToPlaces
from physreal_core.simulation.play import FrameState
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.whole_files import write_whole

PLAN = "plan.json"

_SIGMA = 1e-4
"""Standard deviation that is stated of simulated points [m]: a fit asks for one."""


def write_plan(folder: Path, twin: Twin, planner: Planner, plan: Plan, goal: Path) -> None:
    """capture.json, controllers.npz, tracks3d.npz, shape_prior.glb, states.npz and plan.json."""
    frames = len(plan.moved)
    tracks = plan.points.astype(np.float32)
    sigma = np.full(tracks.shape[:2], _SIGMA, np.float32)
    GivenTracks3d(tracks, np.ones(tracks.shape[:2], bool), sigma).save(folder)
    Controllers(plan.controllers.numpy().astype(np.float32)).save(folder)
    save_mesh(folder / "shape_prior.glb", twin.mesh)
    x = np.stack([state.x.numpy() for state in states_of(planner, plan)])
    np.savez_compressed(folder / STATES, frame=np.arange(frames), x=x)
    observed = max(2, round(0.7 * frames))
    described = {
        "kind": "tracks",
        "description": f"a plan for the twin of {twin.sequence}",
        "controller": "hand",
        "fps": planner.forecast.fps,
        "frame_count": frames,
        "density": twin.density,
        "T_world_object": np.eye(4).tolist(),
        "split": {"train": [0, observed], "test": [observed, frames]},
    }
    write_whole(folder / "capture.json", json.dumps(described, indent=1) + "\n")
    record = {"sequence": twin.sequence, "model": twin.stage, "goal": str(goal), **told(planner, plan)}
    record["hand"] = plan.moved.tolist()
    write_whole(folder / PLAN, json.dumps(record, indent=1) + "\n")


def states_of(planner: Planner, plan: Plan) -> list[FrameState]:
    """What the fitted model does under the plan, frame by frame."""
    rollouts = planner.forecast.rollouts
    with torch.no_grad():
        inputs = rollouts.inputs(planner.forecast.members[0])
        way = plan.controllers.to(rollouts.device, rollouts.dtype)
        moved = rollouts.simulate(replace(inputs, controllers=way), len(way))
    return [FrameState(x.cpu(), v.cpu(), F.cpu()) for x, v, F in zip(moved.x, moved.v, moved.F, strict=True)]


def told(planner: Planner, plan: Plan) -> dict[str, float | int | list[float]]:
    """What the models say of the plan: lengths in m; root mean square distances over points and last frames, one number a model."""
    cost = planner.cost
    own = planner.forecast(plan.controllers[None], cost.settled).points[0]
    reached = cost.goal(own).clamp_min(0.0).mean(-1).sqrt()
    before = cost.goal(own.new_tensor(planner.forecast.points0)).clamp_min(0.0).sqrt()
    found = {
        "distance_before": float(before),
        "distance": [float(distance) for distance in reached],
        "cost": plan.cost,
        "way": float(np.linalg.norm(np.diff(plan.moved, axis=0), axis=2).sum(0).max()),
        "rollouts": plan.rollouts,
        "seconds": plan.seconds,
    }
    if isinstance(cost.goal, PointsToPlaces):
        places = plan.points[-cost.settled :, cost.goal.points].mean(0)
        found["farthest_point"] = float(np.linalg.norm(places - cost.goal.places, axis=1).max())
    return found


def table(planner: Planner, plan: Plan) -> str:
    """The same for a reader."""
    found = told(planner, plan)
    distance = 1e3 * np.array(found["distance"])
    rows = [
        ("rms distance from the goal in frame 0 [mm]", f"{1e3 * found['distance_before']:.1f}"),
        ("at the end, by the fitted model [mm]", f"{distance[0]:.1f}"),
        ("at the end, by the least favourable model [mm]", f"{distance.max():.1f}"),
        *(
            [("farthest point from its place [mm]", f"{1e3 * found['farthest_point']:.1f}")]
            * ("farthest_point" in found)
        ),
        ("models", str(len(distance))),
        ("longest way of a hand [m]", f"{found['way']:.2f}"),
        ("frames", str(len(plan.moved))),
        ("rollouts", str(plan.rollouts)),
        ("seconds", f"{plan.seconds:.0f}"),
    ]
    width = max(len(words) for words, _ in rows)
    return "\n".join(f"{words:{width}}  {value:>8}" for words, value in rows)
