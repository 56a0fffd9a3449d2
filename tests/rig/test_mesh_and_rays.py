"""The rig's meshes and rays against closed forms."""

import numpy as np
import pytest

from data.rig.mesh import mesh_shape
from data.rig.raycast import Raycaster, pixel_rays
from data.rig.rig_scene import View, plush_body
from data.rig.shapes import Capsule, RoundedShape

LENGTH, RADIUS = 0.10, 0.02
BAR = RoundedShape((Capsule((0, 0, 0), (LENGTH, 0, 0), RADIUS),))


def enclosed(vertices, faces):
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return np.einsum("ij,ij->", a, np.cross(b, c)) / 6


def test_mesh_fills_the_shape_with_positive_tetrahedra():
    mesh = mesh_shape(BAR, 0.006)
    volumes = mesh.volumes()
    exact = np.pi * RADIUS**2 * (LENGTH + 4 / 3 * RADIUS)
    assert volumes.min() > 0
    # Flat facets lose 2 %; where a cube's corner would flatten a tetrahedron, the surface stays inside, 4 % more.
    assert 0.92 * exact < volumes.sum() < exact
    assert mesh.lumped_mass(300.0).sum() == pytest.approx(300 * volumes.sum())


@pytest.mark.parametrize("shape", [BAR, plush_body()], ids=["bar", "plush"])
def test_surface_is_closed_outward_and_near_the_shape(shape):
    mesh = mesh_shape(shape, 0.010)
    edges = np.sort(mesh.faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    assert (uses % 2 == 0).all()
    assert enclosed(mesh.vertices, mesh.faces) == pytest.approx(mesh.volumes().sum(), rel=1e-9)
    off = np.abs(shape.distance(mesh.vertices[np.unique(mesh.faces)]))
    assert off.mean() < 0.0015


def test_distance_is_euclidean_outside_a_capsule():
    points = np.array([[0.05, 0.05, 0.0], [0.15, 0, 0], [0.05, 0, 0]])
    np.testing.assert_allclose(BAR.distance(points), [0.03, 0.03, -0.02], atol=1e-12)
    np.testing.assert_allclose(BAR.gradient(points[:2]), [[0, 1, 0], [1, 0, 0]], atol=1e-6)


def test_rays_hit_a_plane_at_its_depth():
    view = View(eye=(0, 0, 1.0), target=(0, 0.2, 0.0), focal=50, width=32, height=24)
    plane = Raycaster(np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0.0]]), np.array([[0, 1, 2], [0, 2, 3]]))
    eye, directions, length = pixel_rays(view.intrinsics(), view.pose(), view.width, view.height)
    hits = plane.cast(np.broadcast_to(eye, directions.shape), directions)
    exact = -eye[2] / directions[:, 2]
    np.testing.assert_allclose(hits.distance, exact, rtol=1e-5)
    # Depth along the camera's z, not along the ray: projecting the hit point gives back its pixel.
    points = eye + directions * hits.distance[:, None]
    local = (points - eye) @ view.pose()[:3, :3]
    np.testing.assert_allclose(local[:, 2], hits.distance / length, rtol=1e-5)
    pixels = local[:, :2] / local[:, 2:] * view.focal + view.intrinsics()[:2, 2]
    v, u = np.mgrid[: view.height, : view.width]
    np.testing.assert_allclose(pixels, np.stack([u.ravel(), v.ravel()], axis=1), atol=1e-3)


def test_closest_points_on_a_triangle():
    triangle = Raycaster(np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]]), np.array([[0, 1, 2]]))
    near = triangle.closest(np.array([[0.25, 0.25, 0.5], [-1.0, 0, 0]]))
    np.testing.assert_allclose(near.distance, [0.5, 1.0], atol=1e-6)
    np.testing.assert_allclose(near.weights, [[0.5, 0.25, 0.25], [1, 0, 0]], atol=1e-6)
    assert triangle.blocked(np.array([[0.2, 0.2, -1], [2, 2, -1.0]]), np.array([0, 0, 1.0])).tolist() == [True, False]
