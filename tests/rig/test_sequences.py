"""Cloths, ropes, further hands, shadows and blur: that they are what they are called, and that the truth shows them."""

from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("cv2")
pytest.importorskip("trimesh")

from data.rig import sequences
from data.rig.capture import film
from data.rig.mesh import tet_volumes
from data.rig.render import FURTHER_HAND, HAND, OBJECT, Stage
from data.rig.rig_scene import Look, Motion
from data.rig.simulate import simulate
from data.rig.thin import Cloth, mesh_cloth
from data.rig.truth import load_truth


def short(scene, frames=3, **changes):
    """A few frames at a quarter of the size."""
    view = replace(scene.view, width=80, height=60, focal=scene.view.focal / 4)
    return replace(scene, frames=frames, observed=2, view=view, **changes)


def test_cloth_skin_is_closed_and_has_the_sheets_volume():
    cloth = Cloth(turn=0.3)
    sheet = mesh_cloth(cloth)
    skin = sheet.skin()
    volume = cloth.size[0] * cloth.size[1] * cloth.thickness
    assert skin.volumes().min() > 0
    assert skin.volumes().sum() == pytest.approx(volume, rel=1e-9)
    edges = np.sort(np.concatenate([skin.faces[:, [0, 1]], skin.faces[:, [1, 2]], skin.faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()  # every edge between two triangles
    assert sheet.lumped_mass(0).sum() == pytest.approx(cloth.areal_density * cloth.size[0] * cloth.size[1], rel=1e-9)
    moved = sheet.thickened(np.stack([sheet.vertices, sheet.vertices + [0, 0, 0.1]]))
    np.testing.assert_allclose(moved[1] - moved[0], np.broadcast_to([0, 0, 0.1], moved[0].shape), atol=1e-12)
    assert tet_volumes(moved[1], skin.tets).min() > 0


def test_cloth_hangs_from_the_hand_and_keeps_its_size():
    scene = sequences.cloth_lifted(0)
    coarse = replace(
        scene, body=replace(scene.body, spacing=0.04), frames=12, motion=Motion(((0.0, 0.3, (0, 0, 0.08)),))
    )
    path = simulate(replace(coarse, grip_reach=0.02), timestep=0.002, settle=0.05)
    middle, gripped = path.middle.vertices, path.middle.gripped
    count = len(middle[0])
    np.testing.assert_allclose((path.vertices[:, :count] + path.vertices[:, count:]) / 2, middle, atol=1e-12)
    assert len(gripped) >= 1 and (np.unique(path.gripped % count) == gripped).all()
    risen = middle[-1, gripped, 2] - middle[0, gripped, 2]
    np.testing.assert_allclose(risen, 0.08, atol=0.002)
    assert middle[-1, :, 2].min() < 0.01  # the far end still lies on the table
    edges = mesh_cloth(coarse.body).triangles[:, [0, 1]]
    length = [np.linalg.norm(m[edges[:, 0]] - m[edges[:, 1]], axis=1) for m in (middle[0], middle[-1])]
    assert np.median(length[1] / length[0]) == pytest.approx(1, abs=0.01)


def test_a_passing_hand_hides_and_a_second_hand_holds(tmp_path):
    scene = short(sequences.plush_hand_in_front(0), frames=24, mesh_spacing=0.02)
    path = simulate(replace(scene, motion=Motion(((0.0, 0.1, (0, 0, 0.0)),))), timestep=0.004, settle=0.02)
    stage = Stage(scene, path)
    before, during = (stage.picture(path.vertices[t], path.hand[t], 1, others=path.others_at(t)).label for t in (0, 18))
    assert not (before == FURTHER_HAND).any() and (during == FURTHER_HAND).sum() > 200
    assert (during == OBJECT).sum() < 0.8 * (before == OBJECT).sum()

    both = short(sequences.plush_two_hands(0), mesh_spacing=0.016)
    held = simulate(both, timestep=0.004, settle=0.02)
    film(both, held, tmp_path / "two", hint=None)
    truth = load_truth(tmp_path / "two")
    assert truth.further_hands.shape[0] == 3 and truth.further_hand_faces.max() < truth.further_hands.shape[1]
    label = Stage(both, held).picture(held.vertices[0], held.hand[0], 1, others=held.others_at(0)).label
    body, hands = truth.masks(both.view.intrinsics(), both.view.pose(), 80, 60, 0)
    assert (label == FURTHER_HAND).any() and ((label == HAND) | (label == FURTHER_HAND)).sum() > 50
    np.testing.assert_array_equal(body, label == OBJECT)
    np.testing.assert_array_equal(hands, (label == HAND) | (label == FURTHER_HAND))


def test_an_open_shutter_smears_what_moves_alone(tmp_path):
    import cv2

    motion = Motion(((0.0, 0.1, (0.06, 0.0, 0.03)),))
    sharp = short(sequences.plush_lifted(0), mesh_spacing=0.02, motion=motion)
    sharp = replace(sharp, noise=replace(sharp.noise, colour=0.0), look=Look(table="plain"))
    path = simulate(sharp, timestep=0.004, settle=0.02)
    pictures = []
    for shutter in (0.0, 0.8):
        film(replace(sharp, look=replace(sharp.look, shutter=shutter)), path, tmp_path / "film", hint=None)
        pictures.append(cv2.imread(str(tmp_path / "film" / "color" / "000001.png")).astype(float))
    change = np.abs(pictures[0] - pictures[1]).max(-1)
    things = np.any(load_truth(tmp_path / "film").masks(sharp.view.intrinsics(), sharp.view.pose(), 80, 60, 1), axis=0)
    assert change[things].mean() > 5 and np.median(change[~things]) < 1.5


def test_sequences_differ_between_seeds_and_are_themselves_again():
    assert len(sequences.SEQUENCES) >= 12
    for name, make in sequences.SEQUENCES.items():
        assert make(0).name == name and make(0) == make(0) and make(0) != make(1)
