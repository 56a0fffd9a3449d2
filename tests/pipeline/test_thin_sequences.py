"""A cloth and a rope from capture to evaluation, as motion capture of points on a closed skin.

The truth comes from our own simulator, on a finer and regular mesh of its own. What is tested is that the stages pass thin bodies on and find back what
went in; how far the simulator holds for real ones is tested elsewhere.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import yaml

from physreal_core.errors import InputError
from physreal_core.fitting.model import load_model
from physreal_core.geometry import bind_grip, save_mesh
from physreal_core.simulation import Body, Grip, Parameters, SimulationConfig, Simulator, rod_body, shell_body
from pipeline.graph import FIT_STAGES
from pipeline.products.controllers import Controllers
from pipeline.products.fit import Fit
from pipeline.products.gap import load_gap
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.products.particles import Particles
from pipeline.products.rollout import Rollout
from pipeline.products.scores import Scores
from pipeline.project import Project
from pipeline.stage import run_stage
from stages import (
    add_effect,
    build_object,
    evaluate,
    find_gap,
    fit_global,
    fit_patches,
    fit_pose,
    fit_residual,
    parse_video,
    predict,
    sample_particles,
    segment_and_track,
)
from tests.geometry.skins import flat_skin, tube
from tests.simulation.thin.scenes import sheet

pytest.importorskip("open3d")

FPS, FRAMES, OBSERVED, NOISE = 40.0, 36, 24, 1e-4
GRIP = {"radius": 0.009, "per_particle": 8}
HOLD = {"grip_stiffness": 300.0, "grip_damping": 0.05}
HEIGHT = 0.25
CLOTH = {"size": (0.14, 0.10), "thickness": 0.002, "density": 150.0}
CLOTH_TRUTH = {"youngs_modulus": 4e4, "poissons_ratio": 0.3, "bending_ratio": 5.0}
ROPE = {"length": 0.24, "thickness": 0.010, "density": 800.0}
ROPE_TRUTH = {"youngs_modulus": 1e5, "poissons_ratio": 0.3, "bending_ratio": 4.5}
RUNS = {
    "parse_video": parse_video.run,
    "segment_and_track": segment_and_track.run,
    "build_object": build_object.run,
    "fit_pose": fit_pose.run,
    "sample_particles": sample_particles.run,
    "fit_global": fit_global.run,
    "fit_patches": fit_patches.run,
    "find_gap": find_gap.run,
    "add_effect": add_effect.run,
    "fit_residual": fit_residual.run,
    "evaluate": evaluate.run,
}


def hand(around: np.ndarray, lift: float) -> np.ndarray:
    """Controller points [T, C, 3] m: those around the held end, moved up and along and held still in the end."""
    time = np.clip(np.arange(FRAMES) / FPS / 0.35, 0.0, 1.0)[:, None, None]
    return around + time**2 * (3.0 - 2.0 * time) * np.array([-0.05, 0.03, lift])


def simulated(body: Body, truth: dict[str, float], controllers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x [T, N, 3] m and F of the truth."""
    pairs = bind_grip(body.x0, controllers, spacing=body.spacing, **GRIP)
    grip = Grip(pairs.particles, pairs.controllers, pairs.weights, pairs.rest_lengths)
    config = SimulationConfig(fps=FPS, ground_height=0.0, courant=0.6, terms=("bending",))
    own = {name: torch.tensor(value) for name, value in {**truth, **HOLD, "friction_coefficient": 0.4}.items()}
    with torch.no_grad():
        states = Simulator(body, config, grip).rollout(
            Parameters(**own, initial_velocity=torch.zeros(3)), torch.from_numpy(controllers)
        )
    return states.x.double().numpy(), states.F.double().numpy()


def write_capture(folder: Path, mesh, tracks: np.ndarray, controllers: np.ndarray, **facts) -> None:
    folder.mkdir(parents=True)
    noise = NOISE * np.random.default_rng(0).normal(size=tracks.shape)
    noise[0] = 0.0
    GivenTracks3d(tracks + noise, sigma3d=np.full(tracks.shape[:2], NOISE)).save(folder)
    Controllers(controllers).save(folder)
    save_mesh(folder / "shape_prior.glb", mesh)
    split = {"train": [0, OBSERVED], "test": [OBSERVED, FRAMES]}
    record = {"kind": "tracks", "fps": FPS, "T_world_object": np.eye(4).tolist(), "split": split, **facts}
    (folder / "capture.json").write_text(json.dumps(record))


def capture_cloth(folder: Path, lift: float = 0.05) -> None:
    """Held at an edge."""
    size, thickness = CLOTH["size"], CLOTH["thickness"]
    vertices, triangles = sheet((20, 14), size, HEIGHT)
    body = shell_body(vertices, triangles, thickness, CLOTH["density"])
    u, v, w = np.meshgrid([0.0], np.linspace(0.0, 0.1, 11), [HEIGHT - 0.006, HEIGHT + 0.006], indexing="ij")
    controllers = hand(np.stack([u, v, w], -1).reshape(-1, 3), lift)
    x, F = simulated(body, CLOTH_TRUTH, controllers)
    marked = np.arange(len(vertices))[4::9]
    tracks = x[:, marked] + F[:, marked][..., 2] * thickness / 2
    mesh = flat_skin(size, thickness)
    mesh = mesh.transformed(np.block([[np.eye(3), np.array([[0.0], [0.0], [HEIGHT]])], [np.zeros((1, 3)), np.ones((1, 1))]]))
    write_capture(
        folder, mesh, tracks, controllers, density=CLOTH["density"], geometry="planar", thickness=thickness
    )


def capture_rope(folder: Path, lift: float = 0.05) -> None:
    """Held at an end."""
    radius = ROPE["thickness"] / 2
    along = np.linspace(0.0, ROPE["length"], 49)[:, None]
    path = along * [1.0, 0.0, 0.0] + [0.0, 0.0, HEIGHT]
    body = rod_body(path, radius, ROPE["density"])
    u, v, w = np.meshgrid([0.0, 0.01, 0.019], [-0.006, 0.006], [HEIGHT - 0.006, HEIGHT + 0.006], indexing="ij")
    controllers = hand(np.stack([u, v, w], -1).reshape(-1, 3), lift)
    x, F = simulated(body, ROPE_TRUTH, controllers)
    marked = np.arange(2, 49, 3)
    tracks = x[:, marked] + F[:, marked][..., 2] * radius
    write_capture(
        folder, tube(path, radius, 24), tracks, controllers, density=ROPE["density"], geometry="linear", thickness=2 * radius
    )


def parameters() -> dict:
    losses = {"track_scale": 5e-4, "mask": 0.0}
    held = {"grip_stiffness": {"initial": HOLD["grip_stiffness"], "rate": 0.0}, "grip_damping": {"initial": HOLD["grip_damping"]}}
    sampling = {"patches": 3, "grip": GRIP}
    rope_start = {"youngs_modulus": {"initial": 3e5, "lower": 1e4}, "bending_ratio": {"initial": 1.0, "upper": 30.0}}
    cloth_start = {"youngs_modulus": {"initial": 5e4}, "bending_ratio": {"initial": 1.0, "upper": 30.0}, "poissons_ratio": {"rate": 0.0}}
    return {
        "seed": 0,
        "sequences": {
            "cloth": {"geometry": "planar", "sample_particles": {**sampling, "spacing": 0.014}},
            "rope": {"geometry": "linear", "sample_particles": {**sampling, "spacing": 0.010}},
            "rope_again": {"geometry": "linear", "sample_particles": {**sampling, "spacing": 0.010}},
        },
        "fits": {"cloth": {}, "rope": {}},
        "predictions": {"rope_again": {"model_from": "rope"}},
        "build_object": {"gaussians": 200},
        "fit_global": {
            **held, "friction_coefficient": {"rate": 0.0}, "losses": losses, "planar": cloth_start, "linear": rope_start,
            "descent": {"iterations": 20, "warmup": 0},
        },
        "fit_patches": {"losses": losses, "descent": {"iterations": 3}},
        "find_gap": {"candidates": ["gravity", "kelvin_voigt"], "shortlist": 1, "seconds": 0, "iterations": 1, "grip_fitted": False},
        "evaluate": {"surface_points": 300},
    }  # fmt: skip


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    root = tmp_path_factory.mktemp("thin")
    (root / "params.yaml").write_text(yaml.safe_dump(parameters()))
    project = Project(root)
    capture_cloth(project.capture("cloth"))
    capture_rope(project.capture("rope"))
    capture_rope(project.capture("rope_again"), lift=-0.03)
    for sequence in ("cloth", "rope"):
        for stage, run in RUNS.items():
            run_stage(stage, sequence, run, project)
    for stage in [*list(RUNS)[:5], "predict", "evaluate"]:
        run_stage(stage, "rope_again", {**RUNS, "predict": predict.run}[stage], project)
    return project


if __name__ == "__main__":
    import sys, time, shutil
    root = Path(sys.argv[1]); shutil.rmtree(root, ignore_errors=True); root.mkdir()
    (root / "params.yaml").write_text(yaml.safe_dump(parameters()))
    project = Project(root)
    t0 = time.time()
    capture_cloth(project.capture("cloth")); capture_rope(project.capture("rope")); capture_rope(project.capture("rope_again"), lift=-0.03)
    print("captures", time.time() - t0)
    for s in sys.argv[2:]:
        for stage, run in RUNS.items():
            t0 = time.time(); run_stage(stage, s, run, project); print(s, stage, round(time.time() - t0, 2), flush=True)
            if stage.startswith("fit_") and stage != "fit_pose":
                print(Fit.load(project.artifact(stage, s)).values, Fit.load(project.artifact(stage, s)).scan)
    
