"""The benchmark of real cloths: distances, strays, and on the recordings the axes, the gradient and a short fit."""

import numpy as np
import pytest
import torch

from benchmarks.thin import cloth
from benchmarks.thin.cloth_data import FITTED_FRAMES, Surface, load, recordings_at, without_strays
from benchmarks.thin.cloth_fit import DEFAULT, Objective, descend, start_of_pose, with_pose
from benchmarks.thin.cloth_scene import Scene, placed
from benchmarks.thin.meshes import rectangle
from physreal_core.errors import InputError


@pytest.fixture
def files(real_data):
    try:
        return recordings_at(real_data)
    except InputError as error:
        pytest.skip(str(error))


def test_distances_are_those_to_the_nearest_place_of_a_sheet():
    vertices, triangles = rectangle((5, 4), (0.1, 0.08))
    cloud = np.random.default_rng(0).uniform([-0.03, -0.03, -0.05], [0.13, 0.11, 0.05], (200, 3))
    found = Surface(triangles).distance(cloud, torch.tensor(vertices)).numpy()
    inside = np.clip(cloud, [0.0, 0.0, 0.0], [0.1, 0.08, 0.0])
    assert found == pytest.approx(np.linalg.norm(cloud - inside, axis=1), abs=1e-9)


def test_strays_are_left_out():
    rng = np.random.default_rng(0)
    sheet, stray = rng.uniform(0.0, 0.1, (1000, 3)), rng.uniform(0.3, 0.31, (20, 3))
    assert len(without_strays(np.concatenate([sheet, stray]))) == 1000


def test_nothing_is_done_without_the_recordings(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("sys.argv", ["cloth", "--data", str(tmp_path), "--out", str(tmp_path)])
    cloth.main()
    assert "skipped" in capsys.readouterr().out
    assert not list(tmp_path.iterdir())


def test_the_highest_points_move_as_the_gripper_does(files):
    for file in files:
        recording = load(file)
        tops = np.stack([cloud[np.argsort(cloud[:, 2])[-15:]].mean(0) for cloud in recording.clouds])
        moved = np.median(tops[14:17], axis=0) - np.median(tops[10:13], axis=0)
        told = recording.path[15] - recording.path[11]
        assert np.abs(moved - told).max() < 0.03, recording.name  # the gripper's mask hides more or less of the corner


def test_a_short_descent_comes_nearer_and_differentiates_the_turn(files):
    recording = load(files[0])
    scene = Scene(recording, -1.0, cells=8)
    objective = Objective(scene)
    begun = with_pose(scene, objective, DEFAULT)
    after = descend(scene, objective, begun, lambda _: None, 4)
    assert after.objective < begun.objective
    turn = start_of_pose(recording)[3].clone().requires_grad_()
    placed(scene.motion(DEFAULT, turn, FITTED_FRAMES)[-1], torch.cat([torch.zeros(3), turn[None]]))[
        :, 0
    ].square().sum().backward()
    assert float(turn.grad) != 0.0
