"""Errors of tracks against the rig's truth are told along the camera's line of sight."""

import dataclasses

import numpy as np
import pytest
import torch

from benchmarks.gap.track_noise import strayed
from tests.fitting import scene


def test_errors_along_and_across_the_line_of_sight_are_told_apart(tmp_path):
    problem = scene.problem(scene.model(), frames=4, observed=4)
    pose = problem.camera.T_world_camera.double().numpy()
    points0 = problem.tracks.points0.double().numpy()
    corners = points0[:, None] + 1e-3 * np.eye(3)
    corners -= corners.mean(1, keepdims=True) - points0[:, None]
    moving = np.linspace(0.0, 0.02, 4)[:, None, None] * [1.0, 0.0, 0.0]
    vertices = corners.reshape(1, -1, 3) + moving
    np.savez(tmp_path / "truth.npz", vertices=vertices, faces=np.arange(3 * len(points0)).reshape(-1, 3))
    true = points0 + moving
    along = true - pose[:3, 3]
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    off = np.array([0.0, 1e-3, 2e-3, 3e-3])[:, None]
    measured = torch.from_numpy(true + off[..., None] * along)
    seen = dataclasses.replace(problem, tracks=dataclasses.replace(problem.tracks, points3d=measured))
    found = strayed(seen, tmp_path / "truth.npz")
    np.testing.assert_allclose(found[..., 2], np.broadcast_to(off, found.shape[:2]) / np.sqrt(2.0), atol=2e-6)
    assert np.abs(found[..., :2]).max() == pytest.approx(0.0, abs=1e-5)
