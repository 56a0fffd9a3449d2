"""Meshes built from one exact view, or from a shell of Gaussians, against the bodies they were made from."""

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.geometry import (
    Mesh,
    Observation,
    mesh_from_gaussians,
    mesh_from_view,
    sample_surface,
    surface_gaussians,
)
from tests.geometry.scenes import camera, ellipsoid, look_at

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("skimage")


def box(x, y, z) -> Mesh:
    body = trimesh.creation.box([x, y, z])
    return Mesh(np.array(body.vertices) + [0, 0, z / 2], np.array(body.faces))


@pytest.mark.parametrize("voxel", [0.0035, 0.004, 0.0043])  # what is found is the body's, not the grid's
@pytest.mark.parametrize(
    ("mesh", "underside", "tolerance"),
    [
        (box(0.16, 0.10, 0.05), "round", 0.08),
        (box(0.16, 0.10, 0.05), "flat", 0.08),
        (box(0.06, 0.06, 0.06), "round", 0.08),
        (ellipsoid(0.10, 0.035, 0.035), "round", 0.08),  # the far lower eighth is hidden: balls guess it
        (ellipsoid(0.04, 0.04, 0.04), "round", 0.08),
        (ellipsoid(0.06, 0.06, 0.03), "round", 0.08),  # flatter than its rule supposes
    ],
)
def test_volume_and_place_of_a_body_seen_once(mesh, underside, tolerance, voxel):
    built = mesh_from_view(look_at(mesh), voxel=voxel, underside=underside)
    assert built.open_edges() == 0
    assert built.volume == pytest.approx(mesh.volume, rel=tolerance)
    np.testing.assert_allclose(built.centroid, mesh.centroid, atol=0.006)
    assert built.bounds[0][2] == pytest.approx(0, abs=0.004)


def _with_a_hand(body: Mesh, x: float) -> Observation:
    """The body with a ball of 8 cm around it, its middle at x."""
    ball = ellipsoid(0.04, 0.04, 0.04)
    hand, seen = look_at(Mesh(ball.vertices + [x, -0.015, -0.01], ball.faces)), look_at(body)
    hidden = hand.mask & ~(seen.mask & (seen.depth < hand.depth))
    return Observation(seen.rgb, np.where(hidden, hand.depth, seen.depth), seen.mask & ~hidden, hidden, camera())


def test_an_end_that_goes_into_a_hand_goes_on_in_it():
    bar = box(0.16, 0.05, 0.04)
    seen = _with_a_hand(bar, 0.07)
    assert seen.points()[:, 0].max() < 0.045  # the bar ends at 0.08, and the hand at 0.11
    built = mesh_from_view(seen)
    assert 0.06 < built.bounds[1][0] < 0.09
    before = trimesh.creation.box(bounds=[[-0.08, -0.025, 0.0], [0.06, 0.025, 0.04]])
    missed = trimesh.boolean.difference([before, trimesh.Trimesh(built.vertices, built.faces)], engine="manifold")
    assert missed.volume < 0.1 * before.volume


def test_a_hand_beside_the_body_adds_nothing():
    bar = box(0.12, 0.05, 0.04)
    beside, alone = mesh_from_view(_with_a_hand(bar, 0.13)), mesh_from_view(look_at(bar))
    assert beside.volume == pytest.approx(alone.volume, rel=1e-6)


def test_view_without_depth_is_an_error():
    seen = look_at(ellipsoid())
    blind = Observation(seen.rgb, np.zeros_like(seen.depth), seen.mask, seen.hidden, camera())
    with pytest.raises(InputError, match="no depth"):
        mesh_from_view(blind)


def test_depth_that_contradicts_the_plane_is_an_error():
    seen = look_at(box(0.16, 0.10, 0.05))
    farther = Observation(seen.rgb, np.where(seen.depth > 0, seen.depth + 0.08, 0), seen.mask, seen.hidden, camera())
    with pytest.raises(InputError, match="below the support plane"):
        mesh_from_view(farther)


def test_shell_of_gaussians_becomes_its_body():
    mesh = ellipsoid()
    built = mesh_from_gaussians(surface_gaussians(sample_surface(mesh, 3000)), 40)
    assert built.open_edges() == 0
    assert built.volume == pytest.approx(mesh.volume, rel=0.05)
    np.testing.assert_allclose(built.centroid, mesh.centroid, atol=0.002)


def test_sheet_of_gaussians_is_an_error():
    sheet = surface_gaussians(sample_surface(ellipsoid(0.08, 0.05, 0.0001), 3000))
    with pytest.raises(InputError, match="do not enclose"):
        mesh_from_gaussians(sheet, 40)


def test_few_gaussians_are_an_error():
    g = surface_gaussians(sample_surface(ellipsoid(), 200))
    g.opacity_logits = torch.full_like(g.opacity_logits, -5)
    with pytest.raises(InputError, match="opaque"):
        mesh_from_gaussians(g)
