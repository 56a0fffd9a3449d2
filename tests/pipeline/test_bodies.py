"""The body that a sequence becomes: by its geometry, from a skin, an open surface or a given middle, with the stated thickness."""

from pathlib import Path

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh
from physreal_core.rendering import Gaussians
from pipeline.capture import capture_of
from pipeline.config.sample_particles import SampleParticles
from pipeline.products.placed_object import PlacedObject
from stages._body import Material, make_body, require_geometry
from tests.geometry.skins import flat_skin, tube
from tests.simulation.thin.scenes import sheet

PARAMS = SampleParticles(spacing=0.02)
T = np.array([[0.0, -2.0, 0.0, 0.1], [2.0, 0.0, 0.0, 0.2], [0.0, 0.0, 2.0, 0.3], [0.0, 0.0, 0.0, 1.0]])
"""Turned about z by a right angle, twice as large, moved."""


def placed(mesh: Mesh) -> PlacedObject:
    gaussians = Gaussians.from_points(torch.zeros(1, 3), 0.01, torch.full((1, 3), 0.5))
    return PlacedObject(mesh, gaussians, np.eye(4), 1.0, T)


def made(geometry: str, mesh: Mesh, folder: Path, thickness: float | None = None):
    return make_body(geometry, placed(mesh), folder, Material(300.0, thickness), PARAMS, 0)


def test_a_stated_thickness_wins_over_that_of_the_skin(tmp_path):
    pytest.importorskip("open3d")
    skin = flat_skin((0.16, 0.1), 0.002)
    measured, stated = (made("planar", skin, tmp_path, thickness) for thickness in (None, 0.0007))
    assert measured.elements.thickness == pytest.approx(0.002) and stated.elements.thickness == 0.0007
    assert measured.mass.sum() == pytest.approx(0.16 * 0.1 * 0.002 * 300.0)
    assert stated.mass.sum() == pytest.approx(0.16 * 0.1 * 0.0007 * 300.0)
    path = np.linspace(0, 0.3, 40)[:, None] * [1.0, 0.0, 0.0]
    rope = made("linear", tube(path, 0.005), tmp_path, 0.008)
    assert rope.elements.radius == 0.004


def test_what_the_capture_says_comes_before_the_parameters():
    capture = capture_of({"kind": "tracks", "fps": 30, "geometry": "planar", "thickness": 0.001, "density": 200.0})
    params = SampleParticles(thickness=0.003, density=500.0)
    assert Material.of(capture, params) == Material(200.0, 0.001)
    assert Material.of(capture_of({"kind": "tracks", "fps": 30}), params) == Material(500.0, 0.003)


def test_an_open_surface_needs_a_thickness(tmp_path):
    surface = Mesh(*sheet((6, 4), (0.16, 0.1)))
    with pytest.raises(InputError, match="no thickness of its own.*capture.json, or sample_particles.thickness"):
        made("planar", surface, tmp_path)
    body = made("planar", surface, tmp_path, 0.001)
    assert body.volume.sum() == pytest.approx(0.16 * 0.1 * 0.001)


def test_a_given_middle_is_taken_where_the_prior_lies(tmp_path):
    pytest.importorskip("plyfile")
    vertices, triangles = sheet((4, 3), (0.08, 0.05))
    head = "ply\nformat ascii 1.0\nelement vertex {}\nproperty double x\nproperty double y\nproperty double z\n"
    rows = lambda array: "".join(" ".join(map(str, row)) + "\n" for row in array.tolist())
    faces = np.insert(triangles, 0, 3, axis=1)
    (tmp_path / "middle_surface.ply").write_text(
        head.format(len(vertices))
        + f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
        + rows(vertices) + rows(faces)
    )  # fmt: skip
    other = Mesh(*sheet((1, 1), (1.0, 1.0)))  # the aligned mesh itself does not matter
    body = made("planar", other, tmp_path, 0.001)
    assert np.ptp(body.x0, axis=0) == pytest.approx([0.1, 0.16, 0.0], abs=1e-9)
    assert body.x0.min(axis=0) == pytest.approx([0.0, 0.2, 0.3], abs=1e-9)
    points = np.linspace(0, 0.2, 9)[:, None] * [1.0, 0.0, 0.0]
    edges = np.stack([np.arange(8), np.arange(1, 9)], 1)
    (tmp_path / "centre_line.ply").write_text(
        head.format(9)
        + "element edge 8\nproperty int vertex1\nproperty int vertex2\nend_header\n"
        + rows(points)
        + rows(edges)
    )
    rope = made("linear", other, tmp_path, 0.01)
    assert len(rope.x0) == 21 and np.ptp(rope.x0[:, 1]) == pytest.approx(0.4)
    with pytest.raises(InputError, match="no thickness of its own"):
        made("linear", other, tmp_path)


def test_capture_and_parameters_agree_about_the_geometry():
    capture = capture_of({"kind": "tracks", "fps": 30, "geometry": "linear", "thickness": 0.01})
    require_geometry(capture, "linear", "rope")
    require_geometry(capture_of({"kind": "tracks", "fps": 30}), "planar", "cloth")
    with pytest.raises(InputError, match="sequences.rope.geometry = volumetric, but the capture is of a linear object"):
        require_geometry(capture, "volumetric", "rope")
    assert capture_of({"kind": "tracks", "fps": 30, "geometry": "linear"}).thickness is None
    with pytest.raises(InputError, match="the key thickness"):
        capture_of({"kind": "tracks", "fps": 30, "thickness": 0.01})
