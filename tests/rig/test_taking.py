"""A hand that comes late and lets go: in the rig, in what is measured of it, and in our simulator with the holds that were found."""

import json
from dataclasses import replace

import numpy as np
import pytest
import torch

pytest.importorskip("mujoco")

from data.rig import recording
from data.rig.rig_scene import SCENES, Material
from data.rig.simulate import simulate
from physreal_core.errors import InputError
from physreal_core.fitting.grip import bind_grip, bind_holds
from physreal_core.geometry import Mesh, carried, fill_mesh, holds_of
from physreal_core.simulation import Body, Parameters, SimulationConfig, Simulator
from pipeline.capture import capture_of
from pipeline.config.sample_particles import GripParameters
from stages import sample_particles

FPS, RADIUS, SPACING = 30.0, 0.02, 0.009


@pytest.fixture(scope="module")
def filmed():
    """The scene, its true motion, and a recording of points with noise and gaps."""
    scene = replace(SCENES["plush_take"](), material=Material(), mesh_spacing=0.014, frames=50)
    trajectory, random = simulate(scene, timestep=0.001), np.random.default_rng(0)
    ideal = recording.ideal(scene, trajectory, random)
    valid = recording.seen(ideal.tracks.shape[:2], random)
    points = ideal.tracks + random.normal(0, 0.001, ideal.tracks.shape)
    return scene, trajectory, ideal, np.where(valid[..., None], points, np.nan), valid


def test_the_rigs_hand_takes_and_lets_go(filmed):
    scene, trajectory, *_ = filmed
    held = trajectory.vertices[:, trajectory.gripped].mean(1)
    frame = lambda time: round(time * FPS)
    way = held - trajectory.hand
    assert np.abs(held[: frame(scene.holds[0])] - held[0]).max() < 1e-3  # nobody touches it yet
    during = way[frame(scene.holds[0]) + 1 : frame(scene.holds[1]) + 1]
    assert np.abs(during - during[0]).max() < 1e-3  # firm, not rigid
    assert held[-1, 2] < held[frame(1.0), 2] - 0.05 and trajectory.hand[-1, 2] > trajectory.hand[frame(1.0), 2] + 0.05


def test_the_holds_are_found(filmed):
    scene, _, ideal, points, valid = filmed
    (hold,) = holds_of(ideal.controllers, np.nan_to_num(points), valid, reach=2 * RADIUS, fps=FPS)
    assert 0.3 * FPS - 1.5 <= hold.taken <= 0.4 * FPS + 1  # it has come at 0.3 s, and moves on at 0.4 s
    assert abs(hold.released - scene.holds[1] * FPS) <= 1


def test_our_simulator_takes_and_lets_go_as_the_rig_does(filmed):
    scene, trajectory, ideal, points, valid = filmed
    mesh = Mesh(trajectory.vertices[0], trajectory.mesh.faces)
    x0, volume = fill_mesh(mesh, SPACING)
    clean = np.nan_to_num(points)
    holds = holds_of(ideal.controllers, clean, valid, reach=2 * RADIUS, fps=FPS)
    where = lambda frame: carried(x0, clean, valid, frame)
    grip = bind_holds(x0, ideal.controllers, holds, where, radius=RADIUS, spacing=SPACING)
    stuff = scene.material
    numbers = (stuff.youngs_modulus, stuff.poissons_ratio, stuff.friction_coefficient, 100.0, 0.01)
    body = Body(x0, volume, np.full(len(x0), stuff.density), SPACING)
    with torch.no_grad():
        states = Simulator(body, SimulationConfig(fps=FPS), grip).rollout(
            Parameters(*map(torch.tensor, numbers)), torch.from_numpy(ideal.controllers).float()
        )
    weights = trajectory.mesh.lumped_mass(stuff.density)
    truth, here = np.average(trajectory.vertices, axis=1, weights=weights), states.x.numpy().mean(1)
    apart, lifted = (here - here[0]) - (truth - truth[0]), truth[:, 2] - truth[0, 2]
    assert lifted[30] > 0.05 and abs(lifted[-1]) < 0.002
    assert np.abs(apart[:34]).max() < 0.009  # until it is let go
    assert np.abs(apart[-1, 2]) < 0.004  # then it lies; how far it slips when it strikes the table differs


def test_the_stage_takes_stated_or_measured_holds_and_names_the_key_otherwise(filmed, capsys):
    _, trajectory, ideal, points, valid = filmed
    x0, volume = fill_mesh(Mesh(trajectory.vertices[0], trajectory.mesh.faces), SPACING)
    body = Body(x0, volume, np.full(len(x0), 300.0), SPACING)
    facts = {"kind": "tracks", "fps": FPS, "split": {"train": [0, 45], "test": [45, 50]}}
    given = lambda **keys: capture_of(json.loads(json.dumps(facts | keys)))
    bound = lambda capture, **how: sample_particles._grip(
        body, ideal.controllers, points, valid, capture, GripParameters(radius=RADIUS, **how)
    )
    measured = bound(given(), holds="measured")
    assert abs(int(measured.released[0]) - 33) <= 1 and "from frame" in capsys.readouterr().out
    stated = bound(given(holds=[[11, 32]]))
    assert set(stated.taken) == {11} and set(stated.released) == {32}
    with pytest.raises(InputError, match=r"grips nothing in frame 0.*that near in frame \d+.*holds: measured"):
        bound(given())
    with pytest.raises(InputError, match="holds"):
        given(holds=[[11, None], [40, 45]])
    with pytest.raises(InputError, match="takes in frame 70 of 50"):
        bound(given(holds=[[70, None]]))
    with pytest.raises(InputError, match="grips nothing"):
        bind_grip(x0, ideal.controllers, radius=RADIUS, spacing=SPACING)
