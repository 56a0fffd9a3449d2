"""A capture of the rig, small: its layout, its noise, and that truth.npz says what the pictures show."""

import json
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("mujoco")
cv2 = pytest.importorskip("cv2")
trimesh = pytest.importorskip("trimesh")

from data.rig.__main__ import main
from data.rig.capture import make_capture, random_similarity
from data.rig.parameters import Rig, build_scene
from data.rig.render import HAND, OBJECT, Picture
from data.rig.rig_scene import Motion, Noise, plush_lift
from data.rig.sensor import read_colour, read_depth
from data.rig.truth import load_truth
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.products.truth import CaptureTruth


@pytest.fixture(scope="module")
def scene():
    small = build_scene("plush_lift", Rig(width=160, height=120, frames=3, observed=2, mesh_spacing=0.016))
    return replace(small, motion=Motion(((0.0, 0.066, (0.0, 0.0, 0.01)),)))


@pytest.fixture(scope="module")
def capture(scene, tmp_path_factory):
    folder = tmp_path_factory.mktemp("captures") / "plush"
    make_capture(scene, folder, seed=3, timestep=0.002)
    return folder


def test_layout(capture, scene):
    described = read_capture(capture)
    assert (described.width, described.height, described.fps) == (160, 120, 30)
    assert described.density == scene.material.density
    for frame in range(3):
        colour = cv2.imread(str(capture / "color" / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED)
        depth = cv2.imread(str(capture / "depth" / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED)
        assert colour.shape == (120, 160, 3) and colour.dtype == np.uint8
        assert depth.shape == (120, 160) and depth.dtype == np.uint16
    assert not (capture.parent / "plush.partial").exists()


def test_same_seed_same_files(capture, scene, tmp_path):
    make_capture(scene, tmp_path / "again", seed=3, timestep=0.002)
    for name in ("color/000001.png", "depth/000001.png", "shape_prior.glb", "capture.json"):
        assert (capture / name).read_bytes() == (tmp_path / "again" / name).read_bytes()
    prior, other = (random_similarity(np.random.default_rng(seed)) for seed in (3, 4))
    assert not np.allclose(prior, other)


def test_where_the_shape_is_seen_and_not_given_nothing_says_it_nor_points_at_anything(capture, scene, tmp_path):
    make_capture(scene, tmp_path / "seen", seed=3, timestep=0.002, shape="seen")
    assert not (tmp_path / "seen/shape_prior.glb").exists()
    assert set(read_capture(capture).hints) == {"object", "controller"}
    assert not read_capture(tmp_path / "seen").hints
    for name in ("color/000001.png", "depth/000001.png"):
        assert (capture / name).read_bytes() == (tmp_path / "seen" / name).read_bytes()


def test_prior_comes_home(capture):
    truth = load_truth(capture)
    prior = trimesh.load(capture / "shape_prior.glb", force="mesh")
    assert prior.is_watertight
    home = prior.vertices @ truth.T_world_prior[:3, :3].T + truth.T_world_prior[:3, 3]
    surface = truth.rest_vertices[np.unique(truth.faces)]
    np.testing.assert_allclose(home.min(axis=0), surface.min(axis=0), atol=1e-5)
    np.testing.assert_allclose(home.max(axis=0), surface.max(axis=0), atol=1e-5)


def test_truth_explains_the_pictures(capture):
    truth, described = load_truth(capture), read_capture(capture)
    camera = (described.K, described.T_world_camera)
    for frame in range(3):
        body, hand = truth.masks(*camera, 160, 120, frame)
        assert body.sum() > 500 and hand.sum() > 500 and not (body & hand).any()
        if frame == 0:
            for role, mask in (("object", body), ("controller", hand)):
                u, v = described.hints[role].point.astype(int)
                assert mask[v, u]
        depth = cv2.imread(str(capture / "depth" / f"{frame:06d}.png"), cv2.IMREAD_UNCHANGED) / 1000
        points = lift(depth, body & (depth > 0), *camera)
        attached = truth.attach(points, frame)
        gap = np.linalg.norm(truth.follow(attached)[frame] - points, axis=1)
        # sigma = 0.5 mm + 1.5 mm * z^2, at 0.77 m; the nearest surface point is nearer than the one along the ray
        assert np.median(gap) < 0.0015
        assert truth.visible(attached, camera[1], frame).mean() > 0.95


def lift(depth, mask, K, T_world_camera):
    v, u = np.nonzero(mask)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(len(u))], axis=1)
    return (rays * depth[v, u][:, None]) @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]


def flat_picture(depth, height=60, width=80):
    shape = (height, width)
    return Picture(np.full((*shape, 3), 0.5), np.full(shape, depth), np.zeros(shape, int), np.zeros(shape))


def test_depth_noise_grows_with_distance_squared():
    noise, random = Noise(depth_base=0.0005, depth_slope=0.0015, depth_hole=0.0), np.random.default_rng(0)
    for distance in (0.5, 1.0, 2.0):
        read = read_depth(flat_picture(distance), noise, random) / 1000
        expected = np.hypot(0.0005 + 0.0015 * distance**2, 0.001 / np.sqrt(12))  # and rounding to millimetres
        assert (read - distance).std() == pytest.approx(expected, rel=0.1)


def test_depth_is_missing_at_edges_grazing_angles_and_in_holes():
    random = np.random.default_rng(0)
    step = flat_picture(1.0)
    step.depth[:, 40:] = 1.2
    missing = read_depth(step, Noise(depth_hole=0.0), random) == 0
    assert missing[:, 39:41].mean() > 0.5 and not missing[:, :38].any() and not missing[:, 42:].any()
    grazed = flat_picture(1.0)
    grazed.slope[:10] = 85.0
    missing = read_depth(grazed, Noise(depth_hole=0.0), random) == 0
    assert missing[:10].all() and not missing[10:].any()
    holes = (read_depth(flat_picture(1.0), Noise(depth_hole=0.05), random) == 0).mean()
    assert 0.03 < holes < 0.07


def test_colour_noise_has_the_stated_size():
    read = read_colour(flat_picture(1.0), Noise(colour=3.0), np.random.default_rng(0))
    assert read.std() == pytest.approx(3.0, rel=0.05)
    assert read.dtype == np.uint8 and OBJECT != HAND


def test_scene_follows_the_parameters():
    scene = build_scene("plush_lift", Rig(youngs_modulus=1e5, width=640, height=480))
    assert scene.material.youngs_modulus == 1e5
    assert scene.view.focal == 2 * plush_lift().view.focal
    with pytest.raises(InputError, match="no scene named 'sofa'"):
        build_scene("sofa", Rig())


def test_motion_starts_and_stops_gently():
    motion = Motion(((0.1, 0.6, (0.0, 0.0, 0.2)), (0.6, 0.8, (0.1, 0.0, 0.0))))
    np.testing.assert_allclose(motion.displacement(0.35), [0, 0, 0.1], atol=1e-12)
    np.testing.assert_allclose(motion.displacement(2.0), [0.1, 0, 0.2])
    assert np.linalg.norm(motion.displacement(0.11)) < 0.001


def test_truth_missing_is_an_input_error(tmp_path):
    with pytest.raises(InputError, match=r"no truth\.npz"):
        load_truth(tmp_path)
    CaptureTruth(youngs_modulus=1.0).save(tmp_path)
    with pytest.raises(InputError, match="no field 'nu'"):
        load_truth(tmp_path)


def test_capture_json_is_plain_json(capture):
    assert json.loads((capture / "capture.json").read_text())["split"] == {"train": [0, 2], "test": [2, 3]}


def test_the_command_says_what_its_options_are(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["data.rig", "--help"])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 0 and "3 % of critical" in " ".join(capsys.readouterr().out.split())
