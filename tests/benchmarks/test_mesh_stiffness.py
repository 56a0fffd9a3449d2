"""The stiffness of a mesh against beam theory."""

import itertools

import numpy as np
import pytest

from benchmarks.mesh_stiffness import _cut_in_eight, _deflection, stiffness_over_continuum

LENGTH, SIDE = 1.0, 0.1


def bar(along: int, across: int):
    """Boxes cut into six tetrahedra each; clamped at x = 0."""
    axes = [np.linspace(0, LENGTH, along + 1), *[np.linspace(0, SIDE, across + 1)] * 2]
    vertices = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    shape = (along + 1, across + 1, across + 1)
    tets = []
    for corner in itertools.product(range(along), range(across), range(across)):
        for order in itertools.permutations(range(3)):
            path, here = [corner], list(corner)
            for axis in order:
                here[axis] += 1
                path.append(tuple(here))
            tets.append([np.ravel_multi_index(p, shape) for p in path])
    return vertices, np.array(tets), np.flatnonzero(vertices[:, 0] == 0)


def test_cutting_keeps_the_volume_and_what_is_held():
    vertices, tets, held = bar(3, 1)
    fixed = np.isin(np.arange(len(vertices)), held)
    fine, cut, also = _cut_in_eight(vertices, tets, fixed)
    assert len(cut) == 8 * len(tets) and len(np.unique(fine.round(9), axis=0)) == len(fine)
    edges = fine[cut][:, 1:] - fine[cut][:, :1]
    assert np.abs(np.linalg.det(edges)).sum() / 6 == pytest.approx(LENGTH * SIDE**2)
    np.testing.assert_array_equal(also, fine[:, 0] == 0)


def test_the_continuum_s_deflection_is_that_of_a_beam():
    """Mean deflection of a cantilever under its own weight: w L^4 / (20 E I) by bending, w L^2 / (3 k G A) by shear (Timoshenko)."""
    mesh = bar(40, 4)
    fixed = np.isin(np.arange(len(mesh[0])), mesh[2])
    weight, inertia, area = SIDE**2, SIDE**4 / 12, SIDE**2
    beam = weight * LENGTH**4 / (20 * inertia) + weight * LENGTH**2 / (3 * 5 / 6 * 0.5 / 1.3 * area)
    factor = stiffness_over_continuum(*mesh, poissons_ratio=0.3)
    assert factor > 1.05
    assert factor * _deflection(*mesh[:2], fixed, 0.3) == pytest.approx(beam, rel=0.03)
