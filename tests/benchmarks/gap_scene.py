"""Two small captures of one object as the hidden-effect benchmark has them, made by our own simulator: quick, and without the rig."""

import json
from pathlib import Path

import numpy as np
import torch

from benchmarks.fit_case import rounded_block
from benchmarks.gap.problems import GUESS
from data.rig.rig_scene import View
from physreal_core.array_types import Array
from physreal_core.fitting.grip import bind_within
from physreal_core.geometry import fill_mesh, sample_surface, save_mesh
from physreal_core.rendering import bind, carry_points
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks3d

FRAMES, OBSERVED, FPS, DENSITY = 10, 7, 30.0, 500.0
YOUNGS_MODULUS, NOISE, TRACKS = 1.5e5, 0.0005, 40  # Pa, m
VIEW = View()
STROKES = {"lift_swing": (0.0, 0.01, 0.06), "press_drag": (0.04, 0.0, -0.003)}  # of the hand [m]


def write_captures(folder: Path, seed: int = 0, pull: float = 9.81) -> dict[str, Array]:
    """One folder per stroke in `folder`; true tracks [T, J, 3] m of each, under a gravity of `pull` m/s2."""
    return {name: _write(folder / name, np.array(stroke), seed, pull) for name, stroke in STROKES.items()}


def _write(capture: Path, stroke: Array, seed: int, pull: float) -> Array:
    capture.mkdir(parents=True)
    mesh = rounded_block(400)
    save_mesh(capture / "shape_prior.glb", mesh)
    controllers = _hand(stroke)
    truth = _simulated(mesh, controllers, pull)
    random = np.random.default_rng(seed)
    valid = random.random(truth.shape[:2]) > 0.2
    valid[0] = True
    points = np.where(valid[..., None], truth + random.normal(0, NOISE, truth.shape), np.nan)
    sigma = np.full(valid.shape, NOISE, np.float32)
    GivenTracks3d(points, valid, sigma).save(capture)
    Controllers(controllers).save(capture)
    facts = {
        "kind": "tracks",
        "fps": FPS,
        "frame_count": FRAMES,
        "density": DENSITY,
        "K": VIEW.intrinsics().tolist(),
        "width": VIEW.width,
        "height": VIEW.height,
        "T_world_camera": VIEW.pose().tolist(),
        "split": {"train": [0, OBSERVED], "test": [OBSERVED, FRAMES]},
    }
    (capture / "capture.json").write_text(json.dumps(facts))
    return truth


def _hand(stroke: Array) -> Array:
    """Controller points [T, C, 3] m over the block's end, moved along the stroke and back to rest."""
    points = np.random.default_rng(1).uniform([-0.115, -0.03, 0.02], [-0.09, 0.03, 0.06], (12, 3))
    share = np.clip(np.arange(FRAMES) / 6, 0, 1)
    return points + (share**2 * (3 - 2 * share))[:, None, None] * stroke


def _simulated(mesh, controllers: Array, pull: float) -> Array:
    spacing = (mesh.volume / 500) ** (1 / 3)
    x0, volume = fill_mesh(mesh, spacing)
    grip = bind_within(x0, controllers[0], spacing=spacing)
    config = SimulationConfig(fps=FPS, gravity=(0.0, 0.0, -pull))
    simulator = Simulator(Body(x0, volume, np.full(len(x0), DENSITY), spacing), config, grip)
    values = GUESS | {"youngs_modulus": YOUNGS_MODULUS}  # a hand that holds as the search supposes
    parameters = Parameters(**{name: torch.tensor(value) for name, value in values.items()})
    points0 = sample_surface(mesh, TRACKS, oversampling=1).points
    with torch.no_grad():
        states = simulator.rollout(parameters, torch.from_numpy(controllers))
        start = torch.from_numpy(x0).to(states.x)
        moved = carry_points(bind(points0, x0, 8), torch.from_numpy(points0).to(states.x), start, states.x, states.F)
    return moved.double().numpy()
