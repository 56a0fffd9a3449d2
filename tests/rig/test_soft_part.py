"""A body with a soft part in the rig: its elements' stiffness, what becomes of it under its weight, and the truth that is told."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")

from data.rig.capture import simulated_truth
from data.rig.hidden.elements import Elements
from data.rig.hidden.material import soften
from data.rig.rig_scene import SCENES, SOFT_LEGS
from data.rig.simulate import simulate
from data.rig.thin_files import material_truth
from data.rig.world import World

SPACING = 0.016


@pytest.fixture(scope="module")
def scene():
    return replace(SCENES["toy_lift"](), mesh_spacing=SPACING, frames=24, observed=16)


def test_the_share_is_left_of_the_elements_behind_the_border(scene):
    world, uniform = (World(s, 0.001) for s in (scene, replace(scene, soft_part=None)))
    soften(world, scene.soft_part.left)
    soft, whole = (Elements(own).stiffness for own in (world, uniform))
    behind = Elements(world).centres[:, 0] < SOFT_LEGS.border
    assert 0.3 < behind.mean() < 0.7
    assert np.array_equal(soft[behind], SOFT_LEGS.share * whole[behind]) and np.array_equal(
        soft[~behind], whole[~behind]
    )


def test_the_soft_legs_hang_deeper_and_the_rest_as_before(scene):
    soft, uniform = (simulate(s) for s in (scene, replace(scene, soft_part=None)))
    rest = soft.mesh.vertices[:, 0]
    drop = uniform.vertices[-1, :, 2] - soft.vertices[-1, :, 2]
    assert drop[rest < -0.08].mean() > 0.005
    assert np.abs(drop[(rest > 0.02) & (rest < 0.06)]).max() < 0.004


def test_the_truth_has_moduli_of_elements_in_place_of_one(scene):
    trajectory = simulate(replace(scene, frames=2, observed=2))
    truth = simulated_truth(scene, trajectory, trajectory.mesh, np.eye(4))
    assert "youngs_modulus" not in material_truth(scene) and truth.youngs_modulus is None
    assert truth.moduli.shape == (len(truth.tets),)
    assert set(np.unique(truth.moduli)) == {0.25 * scene.material.youngs_modulus, scene.material.youngs_modulus}
