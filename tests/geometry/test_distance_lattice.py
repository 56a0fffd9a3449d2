"""Distances from meshes against closed forms, and what is refused."""

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.geometry.distance_lattice import distance_lattice
from physreal_core.geometry.mesh import Mesh
from physreal_core.simulation import Solids

CELL = 0.004


def solids_of(*given, **named) -> Solids:
    found = distance_lattice(*given, **named)
    return Solids(found.distance, found.origin, found.cell)


def ball(radius: float = 0.04) -> Mesh:
    import trimesh

    sphere = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    return Mesh(np.array(sphere.vertices) + [5.0, 0.0, 1.0], np.array(sphere.faces))


def box(lower, upper) -> Mesh:
    import trimesh

    made = trimesh.creation.box(bounds=[lower, upper])
    return Mesh(np.array(made.vertices), np.array(made.faces))


def test_distances_from_a_ball():
    solids, rng = solids_of([ball()], CELL, reach=0.01), np.random.default_rng(0)
    outwards = rng.normal(size=(300, 3))
    outwards /= np.linalg.norm(outwards, axis=1, keepdims=True)
    depths = rng.uniform(-0.02, 0.015, 300)
    found = solids.at(torch.from_numpy([5.0, 0.0, 1.0] + (0.04 + depths)[:, None] * outwards)).numpy()
    assert np.abs(found - depths).max() < 3e-4  # the splines' share is cell^2 / 4 over the radius, 0.1 mm


def test_boxes_that_overlap_and_touch_are_one():
    """An L of two boxes, and a third with a common face: the distance is that of the union, also at the seams' outside."""
    solids = solids_of(
        [box((0, 0, 0), (0.1, 0.05, 0.02)), box((0, 0, 0.0), (0.02, 0.05, 0.1)), box((0.1, 0, 0), (0.14, 0.05, 0.02))],
        CELL,
    )
    places = [(0.06, 0.025, 0.03), (0.1, 0.025, 0.028), (0.03, 0.025, 0.06), (0.12, 0.025, 0.024), (0.006, 0.025, 0.05)]
    found = solids.at(torch.tensor(places, dtype=torch.float64))
    assert found.tolist() == pytest.approx([0.01, 0.008, 0.01, 0.004, -0.006], abs=5e-4)


def test_what_is_no_solid_is_refused():
    whole = box((0, 0, 0), (0.1, 0.1, 0.1))
    with pytest.raises(InputError, match=r"cup, piece 1"):
        solids_of([whole, Mesh(whole.vertices, whole.faces[2:])], CELL, where="cup")
    with pytest.raises(InputError, match="at most .*in metres"):
        solids_of([box((0, 0, 0), (100.0, 100.0, 100.0))], CELL)
    with pytest.raises(InputError, match="no mesh"):
        solids_of([], CELL)
