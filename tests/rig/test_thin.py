"""The rig's rope and cloth against closed forms, and their captures: what the files hold and that they agree with each other."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")
pytest.importorskip("cv2")
trimesh = pytest.importorskip("trimesh")
plyfile = pytest.importorskip("plyfile")

from data.rig import thin_convergence as measured
from data.rig.capture import make_capture
from data.rig.mesh import tet_volumes
from data.rig.parameters import Rig, build_scene
from data.rig.raycast import Raycaster
from data.rig.rig_scene import Motion
from data.rig.rope import Rope
from data.rig.thin import Cloth, mesh_cloth
from data.rig.thin_scenes import CLOTH, MEASURED, ROPE, THIN_SCENES
from data.rig.thin_simulate import run
from data.rig.truth import load_truth
from pipeline.capture import capture_of, read_capture
from tests.rig.test_capture import lift

COARSE = {"rope": 0.01, "cloth": 0.02}  # [m]


@pytest.mark.parametrize("name", measured.OF_ROPE)
def test_rope_bends_stretches_and_twists_as_closed_forms_say(name):
    """With ten segments of 10 mm, or thirty; the error falls with the square of their length (next test)."""
    assert measured.OF_ROPE[name](COARSE["rope"]) == pytest.approx(1, abs=0.013)


def test_error_of_a_rope_falls_with_the_square_of_the_spacing():
    sag = measured.OF_ROPE["sag under a small load (beam)"]
    errors = [sag(spacing) - 1 for spacing in (0.02, 0.01)]
    assert 3 < errors[0] / errors[1] < 5


def test_a_rope_without_damping_keeps_its_swing():
    """Explicit steps are symplectic, and the hold takes nothing. Other modes disturb the measure by 0.02 %."""
    assert abs(measured.damping_ratio(measured.rope(0.01))) < 3e-4


def test_a_strip_of_cloth_sags_and_stretches_as_plate_and_membrane():
    """In elements of 20 mm, of which the strip is five long. A cloth whose hinges are those of the square grid is 20 % softer."""
    sag, _, stretch, _ = measured.OF_CLOTH.values()
    assert sag(COARSE["cloth"]) == pytest.approx(1, abs=0.025)
    assert stretch(COARSE["cloth"]) == pytest.approx(1, abs=0.005)


@pytest.mark.slow
@pytest.mark.parametrize("name", measured.OF_CLOTH)
def test_cloth_of_the_captures_against_closed_forms(name):
    assert measured.OF_CLOTH[name](CLOTH.spacing) == pytest.approx(1, abs=0.015)


@pytest.mark.slow
def test_stated_stiffnesses_of_the_cloth_are_those_measured():
    sag, _, stretch, _ = measured.OF_CLOTH.values()
    assert MEASURED[Cloth]["bending_stiffness"] * sag(CLOTH.spacing) == pytest.approx(1, abs=0.005)
    assert MEASURED[Cloth]["membrane_stiffness"] * stretch(CLOTH.spacing) == pytest.approx(1, abs=0.005)


def test_stated_stiffnesses_of_the_rope_are_those_measured():
    """The factors between what MuJoCo is given and what its elements have, to half a per cent."""
    for name, factor in (("bending", 0), ("stretching", 2), ("twisting", 4)):
        found = list(measured.OF_ROPE.values())[factor](ROPE.spacing)
        assert MEASURED[Rope][f"{name}_stiffness"] * found == pytest.approx(1, abs=0.005)


def test_heavy_elastica_is_a_beam_under_a_small_load():
    """Sag q L^4 / 8 E I. Under a great one it hangs down at sqrt(2 E I / q L) from where it is held, to a tenth at this one: the first
    integral theta'^2 / 2 = load (1 - sin theta) near the hold, where s is small."""
    assert -measured.heavy_elastica(1e-3)[1] == pytest.approx(1e-3 / 8, rel=1e-5)
    x, z = measured.heavy_elastica(300.0)
    assert x == pytest.approx(np.sqrt(2 / 300), rel=0.1) and -1 < z < -0.9


def test_plate_without_poissons_ratio_is_a_beam():
    """Of any width; the ratio makes a narrow plate softer by 1 / (1 - ratio^2) far from its hold."""
    for width in (0.05, 0.2):
        sag, frequency = measured.plate(width, ratio=0.0)
        assert sag == pytest.approx(1, abs=1e-3) and frequency == pytest.approx(1, abs=1e-3)
    assert 1.05 < measured.plate(0.02)[0] < 1 / (1 - 1 / 9)


def test_equilateral_mesh_fills_its_rectangle_with_positive_triangles():
    cloth = replace(CLOTH, size=(0.1, 0.06), spacing=0.01, turn=0.3)
    sheet = mesh_cloth(cloth)
    a, b, c = (sheet.vertices[sheet.triangles[:, k]] for k in range(3))
    area = np.cross(b - a, c - a)[:, 2] / 2
    assert area.min() > 0 and area.sum() == pytest.approx(0.1 * 0.06, rel=1e-9)
    sides = np.linalg.norm([b - a, c - b, a - c], axis=-1)
    inner = sides.min(axis=0) > 0.009  # but the half triangles along two edges
    assert inner.mean() > 0.8 and np.ptp(sides[:, inner]) < 0.0006


def test_a_tube_follows_its_rope():
    rope = replace(ROPE, spacing=0.02)
    line = rope.mesh()
    skin = line.skin()
    assert skin.volumes().min() > 0
    assert skin.volumes().sum() == pytest.approx(np.pi / 4 * rope.thickness**2 * 0.4, rel=1e-9)
    assert trimesh.Trimesh(skin.vertices, skin.faces, process=False).is_watertight
    assert line.lumped_mass(0.0).sum() == pytest.approx(0.064 * 0.4, rel=1e-9)
    turned = np.cross(line.directors(), [1.0, 0.0, 0.0])  # a quarter turn about the rope
    quarter = line.thickened(line.vertices, turned).reshape(len(line.vertices), -1, 3)
    before = skin.vertices.reshape(quarter.shape)
    np.testing.assert_allclose(quarter[:, 1:], np.roll(before[:, 1:], 3, axis=1), atol=1e-12)
    bent = line.vertices.copy()
    bent[:, 2] += 0.5 * bent[:, 0] ** 2
    assert tet_volumes(line.thickened(bent, line.directors()), skin.tets).min() > 0


SMALL = Rig(width=160, height=120, frames=4, observed=3)
COARSER = {Rope: {"spacing": 0.02}, Cloth: {"spacing": 0.025}}


@pytest.fixture(scope="module", params=["rope_lift", "cloth_lift"])
def capture(request, tmp_path_factory):
    scene = build_scene(request.param, SMALL)
    body = replace(scene.body, **COARSER[type(scene.body)])
    scene = replace(scene, body=body, motion=Motion(((0.0, 0.1, (0.0, 0.0, 0.03)),)))
    folder = tmp_path_factory.mktemp("captures") / request.param
    make_capture(scene, folder, seed=2)
    return folder, scene


def test_capture_says_what_kind_of_body_it_shows(capture):
    folder, scene = capture
    described, body = read_capture(folder), scene.body
    assert described.geometry == body.geometry and described.thickness == body.thickness
    mass = described.density * described.thickness
    if isinstance(body, Rope):
        assert mass * np.pi / 4 * described.thickness == pytest.approx(body.mass_per_length)
    else:
        assert mass == pytest.approx(body.areal_density)
    raw = json.loads((folder / "capture.json").read_text())
    del raw["thickness"]
    assert capture_of(raw).thickness is None  # then it is measured


def test_middle_lies_in_the_prior_and_comes_home(capture):
    folder, scene = capture
    truth = load_truth(folder)
    rope = isinstance(scene.body, Rope)
    ply = plyfile.PlyData.read(folder / ("centre_line.ply" if rope else "middle_surface.ply"))
    points = np.stack([ply["vertex"][axis] for axis in "xyz"], axis=1)
    if rope:
        elements = np.stack([ply["edge"]["vertex1"], ply["edge"]["vertex2"]], axis=1)
    else:
        elements = np.stack(ply["face"]["vertex_indices"])
    np.testing.assert_array_equal(elements, truth.middle_elements)
    home = points @ truth.T_world_prior[:3, :3].T + truth.T_world_prior[:3, 3]
    np.testing.assert_allclose(home, truth.middle_rest, atol=1e-6)
    prior = trimesh.load(folder / "shape_prior.glb", force="mesh")
    assert prior.is_watertight
    scale = np.cbrt(np.linalg.det(truth.T_world_prior[:3, :3]))
    depth = Raycaster(prior.vertices, prior.faces).closest(points).distance
    expected = scene.body.thickness / 2 / scale
    inner = slice(1, -1) if rope else np.abs(home - home.mean(axis=0))[:, :2].max(axis=1) < 0.09
    # a tube of twelve sides is 3 % thinner in the middle of a side
    np.testing.assert_allclose(depth[inner], expected, rtol=0.04)


def test_truth_of_a_thin_body(capture):
    folder, scene = capture
    truth, body = load_truth(folder), scene.body
    assert truth.geometry == body.geometry and truth.youngs_modulus is None and truth.damping == body.damping
    names = [name for name in vars(body) if name.endswith("_stiffness")]
    assert len(names) == (3 if isinstance(body, Rope) else 2)
    for name in names:
        assert getattr(truth, f"nominal_{name}") == getattr(body, name)
        assert getattr(truth, name) == pytest.approx(getattr(body, name), rel=0.02)
    count = len(truth.middle_rest)
    assert truth.middle_vertices.shape == (4, count, 3)
    moved = truth.middle_vertices[:, truth.middle_gripped] - truth.middle_rest[truth.middle_gripped]
    # the hold gives way by micrometres
    np.testing.assert_allclose(moved, np.broadcast_to(truth.hand[:, None], moved.shape), atol=1e-4)
    np.testing.assert_array_less(0.005, truth.hand[-1, 2])
    held = truth.vertices[:, truth.gripped] - truth.rest_vertices[truth.gripped]
    assert np.abs(held[:, :, 2] - truth.hand[:, None, 2]).max() < (0.004 if isinstance(body, Rope) else 0.002)


def test_a_rope_turns_with_its_twist():
    """A torque at the free end of a held rope turns its skin by the angle of the closed form."""
    import mujoco

    world = measured.held_world(measured.rope(0.02), (0.0, 0.0, 0.0))
    np.testing.assert_allclose(world.directors, world.mesh.directors(), atol=1e-12)
    angle, last = 0.7, len(world.mesh.elements) - 1
    for segment, share in zip(range(1, last + 1), np.linspace(0, 1, last + 1)[1:], strict=True):
        joint = world.model.joint(measured.twist_joint(world.mesh, segment))
        world.data.qpos[joint.qposadr[0]] = angle * share
    mujoco.mj_step(world.model, world.data)
    world.data.qvel[:] = 0
    start, end = world.mesh.directors()[last], world.directors[last]
    assert start @ end == pytest.approx(np.cos(angle), abs=0.01)
    assert np.cross(start, end)[0] == pytest.approx(np.sin(angle), abs=0.01)  # about the rope, towards its free end


def test_skin_follows_the_middle(capture):
    folder, scene = capture
    truth = load_truth(folder)
    if isinstance(scene.body, Cloth):
        count = len(truth.middle_rest)
        both = truth.vertices[:, :count], truth.vertices[:, count:]
        np.testing.assert_allclose((both[0] + both[1]) / 2, truth.middle_vertices, atol=1e-6)
        np.testing.assert_allclose(np.linalg.norm(both[1] - both[0], axis=-1), scene.body.thickness, rtol=1e-3)
    else:
        skin = truth.vertices.reshape(4, len(truth.middle_rest), -1, 3)
        np.testing.assert_allclose(skin[:, :, 1:].mean(axis=2), truth.middle_vertices, atol=1e-6)
        lengths = np.linalg.norm(truth.middle_directors, axis=-1)
        np.testing.assert_allclose(lengths, 1, atol=1e-5)


def test_pictures_show_the_thin_body(capture):
    import cv2

    folder, _ = capture
    truth, described = load_truth(folder), read_capture(folder)
    for frame in (0, 3):
        body, hand = truth.masks(described.K, described.T_world_camera, 160, 120, frame)
        assert body.sum() > 100 and hand.sum() > 300 and not (body & hand).any()
        depth = cv2.imread(str(folder / "depth" / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED) / 1000
        points = lift(depth, body & (depth > 0), described.K, described.T_world_camera)
        gap = np.linalg.norm(truth.follow(truth.attach(points, frame))[frame] - points, axis=1)
        assert len(points) > 50 and np.median(gap) < 0.002  # noise of 1.5 to 2.2 mm along the ray


@pytest.mark.slow
@pytest.mark.parametrize("name", ["cloth_lift", "cloth_swing"])
def test_cloth_does_not_fold_onto_itself(name):
    """MuJoCo lets its layers pass through one another, so they must not meet: nodes 6 cm apart at rest stay 4 cm apart."""
    scene = THIN_SCENES[name]()
    middle = run(replace(scene, body=replace(scene.body, spacing=0.02))).middle
    apart = np.linalg.norm(middle.rest[:, None] - middle.rest, axis=-1) > 0.06
    nearest = [np.linalg.norm(nodes[:, None] - nodes, axis=-1)[apart].min() for nodes in middle.vertices]
    assert min(nearest) > 0.04


def test_scenes_of_one_object_are_of_one_material():
    bodies = ("rope", "cloth", "corner")
    assert set(THIN_SCENES) == {f"{body}_{motion}" for body in bodies for motion in ("lift", "swing")}
    for kind in bodies:
        lift, swing = (THIN_SCENES[f"{kind}_{motion}"]() for motion in ("lift", "swing"))
        assert lift.body == swing.body and lift.grasp == swing.grasp and lift.motion != swing.motion
        assert lift.material.density == lift.body.density, "what a capture states"


@pytest.mark.parametrize("name", ["cloth_lift", "cloth_swing"])
def test_what_is_held_of_a_cloth_lies_under_the_thumb_or_behind_it(name):
    """A camera in front sees where the hold ends."""
    scene = THIN_SCENES[name]()
    nodes = scene.body.mesh().vertices
    held = nodes[scene.grasp.distance(nodes) < 1e-6]
    first = held[held[:, 1] < held[:, 1].min() + 1e-6]
    assert scene.hand.distance(first).max() < 0.003  # the thumb stands on the row where the hold begins, all along it
    beside = nodes[np.abs(nodes[:, 1] - first[0, 1]) < 1e-6]
    free = beside[np.abs(beside[:, 0]) > np.abs(first[:, 0]).max() + 0.012]
    assert scene.hand.distance(free).min() > 0.004
