"""parse_video: the world it sets, the frames it scales, what it says of their quality."""

import json

import numpy as np
import pytest
from PIL import Image

from pipeline.capture import capture_of, read_capture
from pipeline.frames import backproject
from pipeline.products.given_tracks import GivenTracks3d
from pipeline.products.images import FrameImages
from pipeline.products.quality import Quality
from pipeline.project import Project
from pipeline.stage import run_stage
from stages.parse_video import run, scale_capture
from tests.pipeline.captures import HEIGHT, WIDTH, K, camera_pose, plane_depth, write_capture, write_project


def parse(root, **blocks):
    return run_stage("parse_video", "clip", run, Project(write_project(root, **blocks)))


def test_without_a_pose_the_support_plane_becomes_z_zero(tmp_path):
    folder = write_capture(tmp_path / "data/captures/clip", known_pose=False)
    depth = np.asarray(Image.open(folder / "depth/000000.png")).copy()
    depth[12:18, 20:26] -= 40  # a box on the table
    Image.fromarray(depth).save(folder / "depth/000000.png")
    T = read_capture(parse(tmp_path)).T_world_camera
    np.testing.assert_allclose(T[:3, :3].T @ T[:3, :3], np.eye(3), atol=1e-9)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1)
    points = backproject(plane_depth(camera_pose()), K) @ T[:3, :3].T + T[:3, 3]
    assert np.abs(points[:, 2]).max() < 1.5e-3  # depth is rounded to 1 mm
    assert T[2, 3] == pytest.approx(0.6, abs=1e-3)  # the camera is above, not below


def test_a_given_pose_stays_and_is_compared_with_the_plane(tmp_path):
    off = camera_pose(height=0.7)
    write_capture(tmp_path / "data/captures/clip", T_world_camera=off.tolist())
    output = parse(tmp_path)
    np.testing.assert_array_equal(read_capture(output).T_world_camera, off)
    quality = Quality.load(output)
    assert quality.support_plane["height_m"] == pytest.approx(0.1, abs=2e-3)
    assert "off z = 0" in quality.warnings[0]


def test_scaling_keeps_rays():
    capture = capture_of(
        {"fps": 30, "width": 64, "height": 48, "K": [[50, 0, 30], [0, 52, 20], [0, 0, 1]]}
    ).model_copy()
    half = scale_capture(capture, 0.5)
    assert (half.width, half.height) == (32, 24)
    # The centre of the upper left 2x2 block of pixels is the centre of the half-size image's first pixel.
    ray = np.linalg.inv(capture.K) @ [0.5, 0.5, 1]
    np.testing.assert_allclose(half.K @ ray, [0, 0, 1], atol=1e-12)


def test_frames_are_scaled_and_depth_is_picked_not_mixed(tmp_path):
    folder = write_capture(tmp_path / "data/captures/clip")
    stripes = np.where(np.arange(WIDTH) % 2, 500, 900).astype(np.uint16)[None].repeat(HEIGHT, 0)
    Image.fromarray(stripes).save(folder / "depth/000001.png")
    output = parse(tmp_path, parse_video={"max_width": 32})
    depth = FrameImages(output).depth(1)
    assert depth.shape == (24, 32) and set(np.unique(depth)) <= {500, 900}


def test_repeated_frames_are_named_and_the_default_split_is_seventy_percent(tmp_path):
    folder = write_capture(tmp_path / "data/captures/clip", frames=10)
    (folder / "color/000005.png").write_bytes((folder / "color/000004.png").read_bytes())
    output = parse(tmp_path)
    assert "first: 5" in Quality.load(output).warnings[0]
    split = read_capture(output).split
    assert (split.train, split.test) == ((0, 7), (7, 10))


def test_tracks_without_images(tmp_path):
    folder = tmp_path / "data/captures/clip"
    folder.mkdir(parents=True)
    (folder / "capture.json").write_text(json.dumps({"kind": "tracks", "fps": 100.0}))
    GivenTracks3d(np.zeros((20, 6, 3))).save(folder)
    output = parse(tmp_path)
    assert read_capture(output).frame_count == 20
    assert not (output / "color").exists()
