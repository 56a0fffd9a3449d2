"""Points and Gaussians on sheets and ropes that bend and turn, against where the surface is in closed form."""

import numpy as np
import pytest
import torch

from physreal_core.rendering import Gaussians, bind, bind_to_cells, carry_gaussians, carry_points
from physreal_core.simulation import rod_body, shell_body
from tests.geometry.skins import rolled
from tests.simulation.thin.scenes import sheet

SIZE, CELLS, RADIUS = (0.16, 0.1), (16, 10), 0.03


def scattered(count: int = 300, seed: int = 0) -> np.ndarray:
    """Points within a flat sheet [m]."""
    return np.random.default_rng(seed).uniform([0, 0, 0], [*SIZE, 0], (count, 3))


def on_roll(flat: np.ndarray) -> np.ndarray:
    """Where material points of the flat sheet lie on the roll; z goes towards its axis."""
    angle, own = flat[:, 0] / RADIUS, RADIUS - flat[:, 2]
    return np.stack([own * np.sin(angle), flat[:, 1], RADIUS - own * np.cos(angle)], 1)


def carried(body, x: np.ndarray, points: np.ndarray, binding) -> np.ndarray:
    x0, x = torch.from_numpy(body.x0), torch.from_numpy(x)
    return carry_points(binding, torch.from_numpy(points), x0, x, body.elements.deformation(x)).numpy()


def test_the_nearest_place_in_a_triangle():
    x0 = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], float)
    points = np.array([[0.2, 0.3, 0.5], [-1, -1, 0], [0.5, -1, 0], [1, 1, 0], [3, -0.1, 0]], float)
    binding = bind_to_cells(points, x0, np.array([[0, 1, 2]]))
    assert binding.weights.numpy() == pytest.approx(
        np.array([[0.5, 0.2, 0.3], [1, 0, 0], [0.5, 0.5, 0], [0, 0.5, 0.5], [0, 1, 0]]), abs=1e-6
    )


def test_points_of_a_bent_sheet_stay_on_it():
    """Within c edge^2 / 6 of edges of 10 to 14 mm at a curvature of 1 / 30 mm: 1.1 mm at most, and nearer than by the nearest vertices."""
    body = shell_body(*sheet(CELLS, SIZE), 0.001, 300.0)
    bent, _ = rolled(RADIUS, SIZE, CELLS)
    points = scattered()
    errors = []
    for binding in (bind_to_cells(points, body.x0, body.elements.triangles), bind(points, body.x0, 8)):
        found = carried(body, bent, points, binding)
        errors.append(np.linalg.norm(found - on_roll(points), axis=1))
    assert errors[0].max() < 1.1e-3 and errors[0].mean() < 0.7 * errors[1].mean()


def test_points_beside_a_bent_sheet_keep_their_distance_from_it():
    """Seen from the vertices, whose normals are the mean of the triangles around."""
    body = shell_body(*sheet(CELLS, SIZE), 0.001, 300.0)
    bent, _ = rolled(RADIUS, SIZE, CELLS)
    points, height = scattered(), 0.002
    binding = bind_to_cells(points, body.x0, body.elements.triangles)
    below, above = (carried(body, bent, points + [0, 0, h], binding) for h in (0.0, height))
    inside = (points[:, 0] > 0.01) & (points[:, 0] < SIZE[0] - 0.01)
    towards = np.stack([-np.sin(points[:, 0] / RADIUS), 0 * points[:, 0], np.cos(points[:, 0] / RADIUS)], 1)
    along = ((above - below) * towards).sum(1)[inside]
    assert along == pytest.approx(np.full(len(along), height), rel=0.03)


def test_covariances_turn_with_a_bent_sheet():
    """A flat Gaussian's shortest axis is the normal; within the angle of a triangle, 10 mm on 30 mm."""
    body = shell_body(*sheet(CELLS, SIZE), 0.001, 300.0)
    bent, _ = rolled(RADIUS, SIZE, CELLS)
    points = scattered()
    scales = torch.tensor([0.002, 0.002, 0.0003], dtype=torch.float64).expand(len(points), 3)
    gaussians = Gaussians.from_points(torch.from_numpy(points), scales, torch.full((len(points), 3), 0.5))
    x0, x = torch.from_numpy(body.x0), torch.from_numpy(bent)
    binding = bind_to_cells(points, body.x0, body.elements.triangles)
    _, covariances = carry_gaussians(binding, gaussians, x0, x, body.elements.deformation(x))
    values, vectors = np.linalg.eigh(covariances.double().numpy())
    angle = points[:, 0] / RADIUS
    normal = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], 1)
    cosine = np.abs((vectors[:, :, 0] * normal).sum(1))
    assert np.degrees(np.arccos(np.clip(cosine, -1, 1))).max() < np.degrees(0.01 / RADIUS)
    assert np.sqrt(values[:, 0]) == pytest.approx(np.full(len(points), 0.0003), rel=0.15)
    assert np.sqrt(values[:, 2]) == pytest.approx(np.full(len(points), 0.002), rel=0.1)


def test_points_of_a_turned_rope_stay_on_it():
    """Turned about an axis across it as a whole: exactly; bent to a circle: within c length^2 / 8."""
    along = np.linspace(0.0, 0.2, 26)
    body = rod_body(along[:, None] * [1.0, 0.0, 0.0], 0.005, 800.0)
    rng = np.random.default_rng(0)
    s, angle = rng.uniform(0.0, 0.2, 200), rng.uniform(0, 2 * np.pi, 200)
    points = np.stack([s, 0.005 * np.cos(angle), 0.005 * np.sin(angle)], 1)
    binding = bind_to_cells(points, body.x0, body.elements.segments)
    turn = np.array([[np.cos(2.0), 0, -np.sin(2.0)], [0, 1, 0], [np.sin(2.0), 0, np.cos(2.0)]])
    assert carried(body, body.x0 @ turn.T, points, binding) == pytest.approx(points @ turn.T, abs=1e-8)
    own = lambda p: np.stack(
        [
            (RADIUS - p[:, 2]) * np.sin(p[:, 0] / RADIUS),
            p[:, 1],
            RADIUS - (RADIUS - p[:, 2]) * np.cos(p[:, 0] / RADIUS),
        ],
        1,
    )
    inside = (s > 0.008) & (s < 0.192)
    off = np.linalg.norm(carried(body, own(body.x0), points, binding) - own(points), axis=1)[inside]
    assert (
        off.max() < 1.6 * 0.008**2 / 8 / RADIUS
    )  # the circle as seen from the segments is larger, with the rope's own radius


def test_a_layer_that_lies_on_another_carries_its_own_points():
    """A sheet folded over: nearest vertices by the straight way would be those of both halves."""
    flat, triangles = sheet((20, 4), (0.2, 0.04))
    folded = flat.copy()
    upper = flat[:, 0] > 0.1
    folded[upper] = np.stack([0.2 - flat[upper, 0], flat[upper, 1], np.full(upper.sum(), 0.002)], 1)
    points = np.stack([np.linspace(0.02, 0.08, 30), np.full(30, 0.021), np.full(30, 0.002)], 1)
    binding = bind_to_cells(points, folded, triangles)
    assert upper[binding.neighbours.numpy()].all()
