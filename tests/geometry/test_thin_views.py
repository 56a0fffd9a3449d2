"""Cloths and ropes built from one view, against the bodies that were looked at."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial import cKDTree

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh, Observation, centre_line, remesh, rope_from_view, sheet_from_view
from physreal_core.geometry.remeshing import rims_of
from tests.geometry.scenes import camera, look_at
from tests.geometry.skins import tube

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("skimage")
VIEW = camera(320, 240, 400.0)  # a pixel is 1.25 mm


def cloth(thickness: float, turn: float = 0.3) -> Mesh:
    """20 by 16 cm, lying on z = 0, turned about z."""
    body = trimesh.creation.box([0.2, 0.16, thickness])
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array(body.vertices) @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    return Mesh(turned + [0.0, 0.0, thickness / 2], np.array(body.faces))


def noisy(seen: Observation, sigma: float = 0.0015) -> Observation:
    noise = sigma * np.random.default_rng(0).normal(size=seen.depth.shape)
    return dataclasses.replace(seen, depth=np.where(seen.depth > 0, seen.depth + noise, 0.0))


def with_hand(seen: Observation, u: slice, v: slice) -> Observation:
    """A hand before a part of the picture."""
    hidden = np.zeros_like(seen.mask)
    hidden[v, u] = True
    return dataclasses.replace(seen, hidden=hidden, mask=seen.mask & ~hidden, depth=np.where(hidden, 0.0, seen.depth))


@pytest.mark.parametrize("thickness", [0.001, 0.003])
def test_a_cloth_on_the_table_has_its_area_its_thickness_and_one_rim(thickness):
    """From noisy readings of 1.5 mm, and so regular that it can be cut anew."""
    mesh, found = sheet_from_view(noisy(look_at(cloth(thickness), VIEW)))
    assert found == pytest.approx(thickness, abs=1.5e-4)
    assert mesh.area == pytest.approx(0.2 * 0.16, rel=0.015)
    assert len(rims_of(mesh.faces)) == 1 and (mesh.area_vectors[:, 2] > 0).all()
    np.testing.assert_allclose(mesh.vertices[:, 2], thickness / 2, atol=1.5e-3)
    assert abs(mesh.vertices[:, 2].mean() - thickness / 2) < 2e-4
    vertices, triangles = remesh(mesh.vertices, mesh.faces, 0.008)
    assert Mesh(vertices, triangles).area == pytest.approx(0.2 * 0.16, rel=0.02)


def test_a_bent_cloth_lies_where_it_is_and_its_thickness_is_the_usual():
    """An arch that touches the table with its ends alone, between which it is 30 mm high."""
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 81), np.linspace(-0.08, 0.08, 33), indexing="ij")
    height = lambda x: 0.001 + 0.03 * np.cos(np.pi * x / 0.2)
    grid = np.stack([x, y, height(x)], -1).reshape(-1, 3)
    number = np.arange(len(grid)).reshape(x.shape)
    a, b, c, d = (n.ravel() for n in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    mesh, found = sheet_from_view(
        look_at(Mesh(grid, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])), VIEW), usual=0.002
    )
    assert found == 0.002
    x, y, z = mesh.vertices.T
    inside = np.abs(x) < 0.085
    assert np.abs(z - height(x))[inside].mean() < 0.0015  # of which a millimetre is half of the usual thickness


def test_what_a_hand_hides_of_a_cloth_is_there():
    seen = look_at(cloth(0.002, 0.0), VIEW)
    rows, columns = np.nonzero(seen.mask)
    edge = (
        slice(int(columns.max()) - 25, int(columns.max()) + 20),
        slice(int(np.median(rows)) - 12, int(np.median(rows)) + 12),
    )
    mesh, _ = sheet_from_view(with_hand(seen, *edge))
    assert mesh.area == pytest.approx(0.2 * 0.16, rel=0.02)


def curved(diameter: float, bend: float, points: int = 200) -> np.ndarray:
    share = np.linspace(0, 1, points)[:, None]
    return np.concatenate([0.3 * share - 0.15, bend * np.sin(2 * np.pi * share), 0 * share + diameter / 2], 1)


def length_of(line: np.ndarray) -> float:
    return float(np.linalg.norm(np.diff(line, axis=0), axis=1).sum())


@pytest.mark.parametrize("bend", [0.0, 0.04])
@pytest.mark.parametrize("diameter", [0.006, 0.012])
def test_a_rope_has_its_length_its_diameter_and_its_place(diameter, bend):
    """Two to ten pixels wide, straight and in a wave, from noisy readings of 1.5 mm."""
    true = curved(diameter, bend)
    mesh, found = rope_from_view(noisy(look_at(tube(true, diameter / 2), VIEW)))
    line, radius = centre_line(mesh)
    assert found == pytest.approx(diameter, rel=0.03) and 2 * radius == pytest.approx(diameter, rel=0.03)
    assert length_of(line) == pytest.approx(length_of(true), rel=0.012)
    distance = cKDTree(true).query(line)[0]
    assert distance.mean() < 0.001 and distance.max() < 0.003


def test_a_rope_goes_on_behind_a_hand():
    """30 pixels in its middle are hidden."""
    true = curved(0.01, 0.02)
    seen = look_at(tube(true, 0.005), VIEW)
    mesh, _ = rope_from_view(with_hand(seen, slice(150, 180), slice(0, 240)))
    line, _ = centre_line(mesh)
    assert length_of(line) == pytest.approx(length_of(true), rel=0.02)
    assert cKDTree(true).query(line)[0].max() < 0.004


def test_a_stated_thickness_counts():
    assert sheet_from_view(look_at(cloth(0.003), VIEW), thickness=0.001)[1] == 0.001
    assert rope_from_view(look_at(tube(curved(0.01, 0.0), 0.005), VIEW), diameter=0.008)[1] == 0.008


def test_a_rope_that_crosses_itself_is_refused():
    angle = np.linspace(0.0, 2.0 * np.pi, 150)
    loop = np.stack([0.1 * np.sin(angle), 0.06 * np.sin(2 * angle + 0.6), 0.005 + 0.0 * angle], 1)
    with pytest.raises(InputError, match="beside its longest line"):
        rope_from_view(look_at(tube(loop, 0.005), VIEW))


@pytest.mark.parametrize("build", [sheet_from_view, rope_from_view])
def test_a_view_without_depth_is_refused(build):
    seen = look_at(cloth(0.002), VIEW)
    with pytest.raises(InputError, match="no depth"):
        build(dataclasses.replace(seen, depth=np.zeros_like(seen.depth)))
