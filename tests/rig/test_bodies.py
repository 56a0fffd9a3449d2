"""Bodies of the hidden-effect captures: where they lie, what a hand holds of them, and the meshes of boxes that touch."""

import numpy as np
import pytest

from data.rig.bodies import BODIES
from data.rig.hidden.strengths import scaled
from data.rig.mesh import mesh_shape
from data.rig.motions import MOTIONS
from data.rig.shapes import Block, Blocks
from data.rig.specimen import SPACING, explicit_step, specimen
from data.rig.world import TOUCHING
from physreal_core.errors import InputError

PARTICLES = 1000  # that the benchmark cuts a body into


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_body_lies_on_the_table_about_the_origin_and_is_thick_enough(name, seed):
    body = specimen(name, seed).body
    mesh = mesh_shape(body.shape, SPACING)
    middle = np.average(mesh.vertices[mesh.tets].mean(axis=1), axis=0, weights=mesh.volumes())
    np.testing.assert_allclose(middle, [0, 0, body.shape.middle()[2]], atol=0.001)
    assert mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=0.002)
    assert mesh.volumes().sum() == pytest.approx(
        body.volume, rel=0.08
    )  # a rounded one loses what lies between its nodes
    assert mesh.volumes().min() > 0
    assert body.thickness / (body.volume / PARTICLES) ** (1 / 3) > 4.5  # particles through its thinnest part
    held = body.grasp(-1.0).distance(mesh.vertices) <= 0
    assert 20 < held.sum() < 0.5 * len(held)


@pytest.mark.parametrize("name", [name for name in BODIES if name != "plush"])
@pytest.mark.parametrize("spacing", [0.006, 0.011])
@pytest.mark.parametrize("above", [-1.0, 0.02])
def test_elements_end_where_the_hold_ends(name, spacing, above):
    """The free length and height would else depend on the spacing by up to an element."""
    body = specimen(name, 3).body
    hold = body.grasp(above)
    mesh = mesh_shape(body.shape, spacing, hold)
    assert mesh.volumes().min() > 0 and mesh.volumes().sum() == pytest.approx(body.volume)
    held = mesh.vertices[hold.distance(mesh.vertices) < TOUCHING]
    assert held[:, 0].min() == pytest.approx(hold.lower[0], abs=TOUCHING)
    assert held[:, 2].min() == pytest.approx(max(above, 0.0), abs=TOUCHING)


def test_the_bar_has_one_size_and_other_bodies_have_that_of_their_seed():
    sizes = {name: {specimen(name, seed).body.length for seed in range(4)} for name in BODIES}
    assert [name for name, found in sizes.items() if len(found) == 1] == ["bar"]
    assert specimen("slab", 3) == specimen("slab", 3)
    with pytest.raises(InputError, match="no body named 'blob'"):
        specimen("blob", 1)


@pytest.mark.parametrize("name", BODIES)
def test_places_lie_in_the_free_part(name):
    body, random = specimen(name, 7).body, np.random.default_rng(0)
    places = np.array([body.place(random, (0.1, 0.6), 0.008) for _ in range(50)])
    assert body.shape.distance(places).max() < -0.008
    share = (places[:, 0] - body.lower[0]) / body.length
    assert 0.1 <= share.min() and share.max() <= 0.6


def test_boxes_that_touch_are_one_closed_body_with_their_volume():
    trimesh = pytest.importorskip("trimesh")
    shape = Blocks((Block((0, 0, 0), (0.1, 0.04, 0.04)), Block((0, 0.04, 0), (0.04, 0.09, 0.04))))
    mesh = mesh_shape(shape, 0.011)
    assert mesh.volumes().sum() == pytest.approx(0.04 * (0.1 * 0.04 + 0.04 * 0.05))
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight
    np.testing.assert_allclose(
        shape.middle(), [(40 * 0.05 + 20 * 0.02) / 60, (40 * 0.02 + 20 * 0.065) / 60, 0.02], rtol=1e-9
    )


def test_a_fork_is_not_convex():
    body = specimen("fork", 1).body
    between = np.array([body.lower[0] + 0.02, 0.0, 0.02])
    assert body.shape.distance(between) > 0 and body.shape.distance(between + [0, 0.04, 0]) < 0


def test_amplitudes_scale_with_the_body_and_leave_the_bar_alone():
    bar, slab = specimen("bar", 1).body, specimen("slab", 1).body
    for effect in ("density_gradient", "plastic_yield", "rest_shape", "grip_compliance", "wind"):
        assert scaled(effect, 0.37, bar) == 0.37
    assert scaled("wind", 2.0, slab) == 2.0
    assert scaled("density_gradient", 5.0, slab) == pytest.approx(5.0 * 0.195 / slab.length)
    assert scaled("grip_compliance", 1e-4, slab) == pytest.approx(1e-4 * bar.volume / slab.volume)


@pytest.mark.parametrize("name", BODIES)
def test_steps_are_such_as_contacts_bear(name):
    for motion in MOTIONS:
        assert 5e-5 < explicit_step(specimen(name, 3).scene(motion)) <= 5e-4
