"""A rope that is filmed in colour alone, from capture to evaluation.

The truth comes from our own simulator. What is tested is that the stages place the rope by the table, fit its pixels, and say what cannot be asked.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import yaml

from physreal_core.fitting.grip import bind_grip
from physreal_core.simulation import Parameters, SimulationConfig, Simulator, rod_body
from pipeline.frames import frame_file
from pipeline.products.controllers import Controllers
from pipeline.products.fit import Fit
from pipeline.products.gap import load_added, load_gap
from pipeline.products.given_tracks import GivenTracks2d
from pipeline.products.masks import mask_folder
from pipeline.products.particles import Particles
from pipeline.products.scores import Scores
from pipeline.project import Project
from pipeline.stage import run_stage
from tests.pipeline.test_thin_sequences import RUNS
from tests.test_resting import SIZE, K, camera

FPS, FRAMES, OBSERVED = 30.0, 24, 16
RADIUS, LENGTH, DENSITY = 0.008, 0.3, 600.0
TRUTH = {"youngs_modulus": 2e6, "poissons_ratio": 0.3, "bending_ratio": 0.3, "friction_coefficient": 0.4}
HOLD = {"grip_stiffness": 300.0, "grip_damping": 0.05}
GRIP = {"radius": 0.012, "per_particle": 8}
T = camera(tilt=45.0, far=0.7)


def moved() -> tuple[np.ndarray, np.ndarray]:
    """The rope's line [T, N, 3] m and the hand's points, which lift an end that lay on the table."""
    along = np.linspace(-LENGTH / 2, LENGTH / 2, 61)[:, None]
    body = rod_body(along * [0.0, 1.0, 0.0] + [0.0, 0.0, RADIUS], RADIUS, DENSITY)
    around = np.stack(np.meshgrid([-0.008, 0.008], [0.13, 0.14, 0.15], [0.0, 0.016], indexing="ij"), -1).reshape(-1, 3)
    share = np.clip(np.arange(FRAMES) / FPS / 0.6, 0.0, 1.0)[:, None, None]
    hand = around + share**2 * (3.0 - 2.0 * share) * np.array([0.0, -0.04, 0.1])
    config = SimulationConfig(fps=FPS, ground_height=0.0, courant=0.6, terms=("bending",))
    own = {name: torch.tensor(value) for name, value in {**TRUTH, **HOLD}.items()}
    with torch.no_grad():
        simulator = Simulator(body, config, bind_grip(body.x0, hand, spacing=body.spacing, **GRIP))
        states = simulator.rollout(Parameters(**own, initial_velocity=torch.zeros(3)), torch.from_numpy(hand))
    return states.x.double().numpy()[:FRAMES], hand


def pixels(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(u, v) [px] and depth [m] of world points."""
    local = (points - T[:3, 3]) @ T[:3, :3]
    return local[..., :2] / local[..., 2:] * K[0, 0] + K[:2, 2], local[..., 2]


def write_capture(folder: Path) -> None:
    """Grey frames, masks as drawn, tracks of the rope's middle by their pixels, the hand's points."""
    line, hand = moved()
    seen, far = pixels(line)
    for frame in range(FRAMES):
        colour = np.full((*SIZE, 3), 90, np.uint8)
        rope, held = np.zeros(SIZE, np.uint8), np.zeros(SIZE, np.uint8)
        for (u, v), z in zip(seen[frame], far[frame], strict=True):
            cv2.circle(rope, (round(16 * u), round(16 * v)), round(16 * K[0, 0] * RADIUS / z), 255, -1, shift=4)
        middle = pixels(hand[frame].mean(0))[0]
        cv2.circle(held, tuple(np.rint(middle + [-14, -10]).astype(int).tolist()), 16, 255, -1)
        rope[held > 0] = 0
        colour[rope > 0] = (200, 150, 60)
        for where, picture in (
            (folder / "color", colour),
            (mask_folder(folder, "object"), rope),
            (mask_folder(folder, "controller"), held),
        ):
            where.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(frame_file(where, frame)), picture)
    marked = slice(2, 54, 2)
    GivenTracks2d(seen[:, marked].astype(np.float32)).save(folder)
    Controllers(hand.astype(np.float32)).save(folder)
    record = {
        "fps": FPS, "width": SIZE[1], "height": SIZE[0], "K": K.tolist(), "T_world_camera": T.tolist(), "density": DENSITY,
        "geometry": "linear", "split": {"train": [0, OBSERVED], "test": [OBSERVED, FRAMES]},
    }  # fmt: skip
    (folder / "capture.json").write_text(json.dumps(record))


@pytest.fixture(scope="module")
def rope(tmp_path_factory) -> Project:
    root = tmp_path_factory.mktemp("colour")
    hold = {"grip_stiffness": {"initial": HOLD["grip_stiffness"], "rate": 0.0}, "grip_reaches": ()}
    start = {"youngs_modulus": {"initial": 2e6, "rate": 0.0}, "bending_ratio": {"initial": 1.0}, **hold}
    values = {
        "seed": 0,
        "sequences": {"rope": {"geometry": "linear", "sample_particles": {"grip": GRIP, "patches": 3, "spacing": 0.01}}},
        "fits": {"rope": {}},
        "segment_and_track": {"segmenter": "none"},
        "build_object": {"gaussians": 3000},
        "fit_global": {"linear": start, "friction_coefficient": {"rate": 0.0}, "grip_damping": {"initial": HOLD["grip_damping"]}, "descent": {"iterations": 12}},
        "fit_patches": {"descent": {"iterations": 2}},
        "fit_residual": {"descent": {"iterations": 1}},
        "evaluate": {"surface_points": 2000},
    }  # fmt: skip
    (root / "params.yaml").write_text(yaml.safe_dump(values))
    project = Project(root)
    write_capture(project.capture("rope"))
    for stage, run in RUNS.items():
        run_stage(stage, "rope", run, project)
    return project


def test_the_rope_lies_where_it_lay(rope):
    found = Particles.load(rope.artifact("sample_particles", "rope"))
    assert found.radius == pytest.approx(RADIUS, rel=0.15)
    assert np.ptp(found.x0[:, 1]) == pytest.approx(LENGTH, rel=0.08)  # the hand hides an end
    assert np.abs(found.x0[:, 2] - RADIUS).max() < 0.002 and np.abs(found.x0[:, 0]).max() < 0.003


def test_its_bending_shows_in_pixels_alone(rope):
    fit = Fit.load(rope.artifact("fit_global", "rope"))
    assert fit.values["bending_ratio"]["mean"] == pytest.approx(TRUTH["bending_ratio"], rel=0.5)
    assert "interval" not in fit.values["bending_ratio"], "no point is known in 3D"


def test_the_twin_covers_what_was_seen_and_what_was_not(rope):
    scores = Scores.load(rope.artifact("evaluate", "rope")).metrics["fit_patches"]
    assert scores["observed"]["iou"] > 0.8 and scores["future"]["iou"] > 0.75
    assert "track_error" not in scores["observed"]


def test_what_is_missing_cannot_be_asked(rope):
    gap, added = load_gap(rope.artifact("find_gap", "rope")), load_added(rope.artifact("add_effect", "rope"))
    assert gap.verdict.kind == "not_searched" and "3D" in gap.verdict.sentence
    assert not added.adopted
