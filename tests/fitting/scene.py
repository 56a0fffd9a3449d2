"""A tiny made-up sequence: a soft bar held at one end, the hand raised, its far end over the ground; truth by our simulator.

That the truth comes from the simulator that is fitted (an inverse crime) is the point: what is tested is the fitting.
"""

import dataclasses

import numpy as np
import torch

from physreal_core.fitting.model import Model, uniform_model
from physreal_core.fitting.problem import MaskObservations, Problem, TrackObservations
from physreal_core.fitting.rollouts import Rollouts
from physreal_core.geometry import farthest_points, patch_weights
from physreal_core.rendering import Camera, Gaussians, bind, carry_points, render_carried
from physreal_core.simulation import Body, Grip, Tool

SPACING = 0.02
DENSITY = 300.0
FPS = 30.0
MATERIAL = {
    "youngs_modulus": 3e4,
    "poissons_ratio": 0.3,
    "friction_coefficient": 0.5,
    "grip_stiffness": 4.0,
    "grip_damping": 0.02,
}


PUSH = {"tool_stiffness": 1e5, "tool_friction": 0.4}
"""What a model has beside `MATERIAL` where the bar is pushed."""


def body() -> Body:
    """A bar of 7 x 3 x 2 particles on the ground."""
    counts = (7, 3, 2)
    x0 = SPACING * (np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), -1).reshape(-1, 3) + 0.5)
    return Body(x0, np.full(len(x0), SPACING**3), np.full(len(x0), DENSITY), SPACING)


def grip(bar: Body) -> tuple[Grip, np.ndarray]:
    """Bonds of the first columns to a point over that end; the point [1,3]."""
    hand = np.array([[0.01, 0.03, 0.06]])
    held = np.flatnonzero(bar.x0[:, 0] < 2 * SPACING)
    lengths = np.linalg.norm(bar.x0[held] - hand, axis=1)
    return Grip(held, np.zeros_like(held), np.ones(len(held)), lengths), hand


def tool() -> tuple[Tool, np.ndarray]:
    """A stick that leans, its lower end beside the first columns; its two ends [2,3]."""
    return Tool(np.array([[0, 1]]), np.array([0.015])), np.array([[0.02, -0.018, 0.02], [0.01, -0.06, 0.12]])


def model(patch_count: int = 4, *, dtype: str = "float32", **values: float) -> Model:
    """The true material, but for `values`."""
    bar = body()
    patches = torch.from_numpy(bar.x0[farthest_points(bar.x0, patch_count)])
    setting = {"ground_height": 0.0, "courant": 0.4, "dtype": dtype}
    return uniform_model(patches, MATERIAL | values, elastic_law="fixed_corotated", simulation=setting)


def problem(
    truth: Model,
    *,
    frames: int = 12,
    observed: int = 12,
    with_masks: bool = True,
    device: str = "cpu",
    pushed: bool = False,
) -> Problem:
    """What a camera and a tracker would have seen of `truth`: the hand goes up and along, the far end drags.

    Simulated and rendered on `device`; what is returned is on the CPU. Of a bar that is `pushed`, a stick goes against its end and along it.
    """
    bar = body()
    bonds, hand = grip(bar)
    pusher, way = None, np.array([-0.05, 0.0, 0.06])
    if pushed:
        bonds, (pusher, hand), way = None, tool(), np.array([0.03, 0.05, 0.005])
    times = np.linspace(0.0, 1.0, frames)[:, None, None]
    controllers = torch.from_numpy(hand + times**2 * (3.0 - 2.0 * times) * way)
    neighbours, weights = patch_weights(bar.x0, farthest_points(bar.x0, truth.patch_count), 3)
    empty = Problem(
        body=bar,
        fps=FPS,
        controllers=controllers,
        observed=observed,
        patch_neighbours=torch.from_numpy(neighbours),
        patch_weights=torch.from_numpy(weights),
        grip=bonds,
        tool=pusher,
        tracks=_tracks(bar, np.zeros((frames, len(bar.x0), 3)), None),
    )
    states = simulate(empty, truth, device)
    camera = _camera()
    return dataclasses.replace(
        empty,
        tracks=_tracks(bar, states, camera),
        masks=_masks(bar, states, camera, observed) if with_masks else None,
        camera=camera,
    )


def simulate(given: Problem, truth: Model, device: str = "cpu"):
    """States over all frames."""
    rollouts = Rollouts(given, truth, device=device)
    with torch.no_grad():
        return rollouts.simulate(rollouts.inputs(truth.fields))


def _camera() -> Camera:
    """From the side (+y looking back at -y), 0.4 m away, 64 x 48 px."""
    T = np.eye(4)
    T[:3, :3] = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, -1.0, 0.0]])
    T[:3, 3] = [0.06, 0.43, 0.05]
    return Camera(np.array([[100.0, 0.0, 31.5], [0.0, 100.0, 23.5], [0.0, 0.0, 1.0]]), T, 64, 48)


def _points0(bar: Body) -> torch.Tensor:
    """Tracked points: on the top, between the particles."""
    top = bar.x0[bar.x0[:, 2] > SPACING]
    return torch.from_numpy(top[::2] + np.array([0.004, 0.003, 0.01]))


def _tracks(bar: Body, states, camera: Camera | None) -> TrackObservations:
    points0 = _points0(bar)
    binding = bind(points0, bar.x0, 8)
    if camera is None:
        frames = len(states)
        known = torch.zeros(frames, len(points0), dtype=torch.bool)
        return TrackObservations(
            points0, binding, torch.zeros(frames, len(points0), 3), known, torch.zeros(frames, len(points0))
        )
    x0 = torch.from_numpy(bar.x0).to(states.x)
    points = carry_points(binding, points0, x0, states.x, states.F).cpu()
    known = torch.ones(points.shape[:2], dtype=torch.bool)
    known[3, 1] = known[5:8, 4] = False
    measured = torch.where(known[..., None], points, torch.full_like(points, float("nan")))
    return TrackObservations(
        points0, binding, measured, known, torch.full(points.shape[:2], 1e-3), camera.project(points)[0], known
    )


def _masks(bar: Body, states, camera: Camera, observed: int) -> MaskObservations:
    centres = torch.from_numpy(bar.x0)
    gaussians = Gaussians.from_points(centres, 0.5 * SPACING, torch.full((len(centres), 3), 0.5))
    binding = bind(centres, bar.x0, 1)
    frames = torch.tensor([observed // 2, observed - 1])
    x0 = torch.from_numpy(bar.x0).to(states.x)
    there = gaussians.to(x0.device)
    shots = [render_carried(there, binding, x0, states.x[t], states.F[t], camera).alpha for t in frames]
    coverage = torch.stack(shots).float().cpu()
    known = torch.ones(coverage.shape, dtype=torch.bool)
    known[:, :12, 40:] = False
    return MaskObservations(frames, coverage, known, camera, gaussians, binding)
