"""Captures that cannot be, or are odd: `physreal check` names each fault, and what it passes parse_video takes."""

import hashlib
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from data.importers import images as images_importer
from data.importers import silicone_beam
from physreal_core.errors import InputError
from pipeline.check import Purpose, check_capture, examine
from pipeline.cli import main
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.truth import CaptureTruth
from pipeline.project import Project
from pipeline.stage import run_stage
from stages.parse_video import run as parse_video
from tests.hard_use import recordings
from tests.hard_use.recordings import FRAMES, Edit, all_of, arrays, image, images, keys, put, without
from tests.pipeline.captures import HEIGHT, WIDTH, K, camera_pose, write_project

POSE = camera_pose()
FULL = np.full((HEIGHT, WIDTH), 255, np.uint8)


def scaled(matrix: np.ndarray, factor: float) -> list:
    """K of an image `factor` times as large."""
    matrix = matrix.copy()
    matrix[:2] *= factor
    return matrix.tolist()


def pose(**changes: object) -> list:
    """T_world_camera with another rotation part R, or translation t."""
    T = POSE.copy()
    T[:3, :3] = changes.get("R", T[:3, :3])
    T[:3, 3] = changes.get("t", T[:3, 3])
    return T.tolist()


def click(**changes: object) -> dict:
    """An entry of corrections that is right, but for the changes."""
    return {"frame": 2, "thing": "object", "points": [[9, 9]], **changes}


def with_cell(matrix: np.ndarray, row: int, column: int, value: float) -> list:
    matrix = matrix.copy()
    matrix[row, column] = value
    return matrix.tolist()


@pytest.fixture(scope="session")
def made(tmp_path_factory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("recordings")
    return {"video": recordings.write_video(root / "video"), "mocap": recordings.write_mocap(root / "mocap")}


@pytest.fixture
def video(made, tmp_path) -> Path:
    return Path(shutil.copytree(made["video"], tmp_path / "data/captures/clip"))


@pytest.fixture
def mocap(made, tmp_path) -> Path:
    return Path(shutil.copytree(made["mocap"], tmp_path / "data/captures/clip"))


def digest(root: Path) -> dict[str, str]:
    return {str(p.relative_to(root)): hashlib.md5(p.read_bytes()).hexdigest() for p in root.rglob("*") if p.is_file()}


def the_fault(capture: Path, edit: Edit) -> InputError:
    """The one fault after an edit; nothing was written."""
    edit(capture)
    before = digest(capture.parents[2])
    _, found = examine(capture)
    assert digest(capture.parents[2]) == before
    assert len(found.faults) == 1, list(map(str, found.faults))
    (fault,) = found.faults
    assert str(capture) in fault.where and fault.expected and fault.remedy, str(fault)
    with pytest.raises(InputError) as raised:
        check_capture(capture)
    assert str(raised.value) == str(fault)
    return fault


@pytest.mark.parametrize("kind", ["video", "mocap"])
def test_a_good_capture_passes_without_a_word(made, kind, capsys):
    summary, found = examine(made[kind])
    assert (found.faults, found.warnings) == ([], []), [*map(str, found.faults), *map(str, found.warnings)]
    assert summary.startswith(f"{FRAMES} frames")
    check_capture(made[kind], Purpose(clip=False))
    assert capsys.readouterr().err == ""


KEYS = [
    ("density", float("inf"), "density = inf", "finite number"),
    ("density", float("nan"), "density = nan", "finite number"),
    ("density", -300.0, "density = -300", "greater than 0"),
    ("density", 1e-9, "density = 1e-09 kg/m3 is impossible", "aerogel"),
    ("density", 1e6, "density = 1e+06 kg/m3 is impossible", "1 to 25000 kg/m3"),
    ("fps", 1e9, "fps = 1e+09 frames/s is impossible", "0.1 to 100000 frames/s"),
    ("fps", 1e-3, "fps = 0.001 frames/s is impossible", "0.1 to 100000 frames/s"),
    ("fps", float("inf"), "fps = inf", "finite number"),
    ("fps", -30, "fps = -30", "greater than 0"),
    ("fps", "fast", "fps = 'fast'", "valid number"),
    ("frame_count", 9, "frame_count = 9, but there are 6 frames", "6"),
    ("frame_count", 0, "frame_count = 0", "greater than 0"),
    ("split", {"train": [0, 4], "test": [4, 9]}, "reaches past the last of", "at most 6"),
    ("split", {"train": [2, 4], "test": [4, 6]}, "split", "train [0, n]"),
    ("split", {"train": [0, 4], "test": [5, 6]}, "split", "test [n, T]"),
    ("K", K.T.tolist(), "K is transposed", "[[fx, 0, cx]"),
    ("K", with_cell(K, 0, 0, -40.0), "K has the focal lengths -40 and 40", "positive fx and fy"),
    ("K", with_cell(K, 1, 1, 0.0), "K has the focal lengths 40 and 0", "positive fx and fy"),
    ("K", np.zeros((3, 3)).tolist(), "K's last row is [0.0, 0.0, 0.0]", "[0, 0, 1]"),
    ("K", with_cell(K, 0, 1, 5.0), "K has a skew of 5", "no skew"),
    ("K", with_cell(K, 2, 2, 2.0), "K's last row is", "[0, 0, 1]"),
    ("K", with_cell(K, 0, 2, float("nan")), "K = ", "finite numbers in the shape 3x3"),
    ("K", with_cell(K, 0, 0, 0.5), "fx over width = 0.0104167 image widths is impossible", "157 degrees"),
    ("K", with_cell(K, 1, 1, 4000.0), "fy over fx = 100 is impossible", "0.25 to 4"),
    ("K", scaled(K, 2.0), "principal point at (47, 35) px of 48 x 36 px", "images of this size"),
    ("K", scaled(K, 13.3), "principal point at", "images of this size"),
    ("K", with_cell(K, 0, 2, -20.0), "principal point at (-20, 17.5)", "images of this size"),
    ("K", (K / 48).tolist(), "K's last row is", "[px]"),
    ("T_world_camera", pose(R=POSE[:3, :3] @ np.diag([1, 1, -1])), "mirrors", "right-handed"),
    ("T_world_camera", pose(R=np.zeros((3, 3))), "rotation part of zeros", "rotation and translation"),
    ("T_world_camera", np.zeros((4, 4)).tolist(), "last row [0.0, 0.0, 0.0, 0.0]", "last row 0 0 0 1"),
    ("T_world_camera", pose(R=2.0 * POSE[:3, :3]), "T_world_camera scales by 2", "rotation and translation [m]"),
    ("T_world_camera", pose(R=POSE[:3, :3] / 1000), "T_world_camera scales by 0.001", "rotation and translation [m]"),
    ("T_world_camera", pose(R=POSE[:3, :3] @ np.diag([1, 1.2, 1])), "stretches or shears", "right-handed"),
    ("T_world_camera", POSE.T.tolist(), "T_world_camera is transposed", "last row 0 0 0 1"),
    ("T_world_camera", pose(t=[0.0, 0.0, 600.0]), "translation = 600 m is impossible", "-50 to 50 m"),
    ("T_world_camera", pose(t=[0.0, float("inf"), 0.6]), "T_world_camera = ", "finite numbers"),
    ("T_world_camera", POSE[:3].tolist(), "T_world_camera = ", "4x4"),
    ("hints", {"object": {"point": [60, 10]}}, "hints.object.point = [60.0, 10.0] lies outside", "0..47, 0..35"),
    ("hints", {"object": {"point": [10, -1]}}, "lies outside the image", "0..47, 0..35"),
    ("hints", {"object": {"box": [10, 10, 10, 20]}}, "hints.object.box = [10.0, 10.0, 10.0, 20.0] has no area", "u0 < u1"),
    ("hints", {"object": {"box": [20, 20, 10, 10]}}, "has no area", "u0 < u1"),
    ("hints", {"controller": {"box": [100, 100, 120, 120]}}, "hints.controller.box", "within 0..47"),
    ("hints", {"object": {}}, "hints.object is empty", "a point, a box or a colour"),
    ("hints", {"object": {"colour": "tael"}}, "hints.object.colour = 'tael'", "teal"),
    ("hints", {"objekt": {"point": [3, 3]}}, "objekt", "'object' or 'controller'"),
    ("hints", {"object": {"point": [9, 9]}, "controller": {"point": [9, 9]}}, "are both [9.0, 9.0]", "two places"),
    ("corrections", [click(frame=6)], "corrections[0].frame = 6, but there are 6 frames", "0..5"),
    ("corrections", [click(frame=-1)], "corrections.0.frame = -1", "greater than or equal to 0"),
    ("corrections", [click(frame=1.5)], "corrections.0.frame = 1.5", "integer"),
    ("corrections", [click(thing="hand")], "corrections.0.thing = 'hand'", "'object' or 'controller'"),
    ("corrections", [click(points=[[9, 9], [60, 9]])], "corrections[0].points[1] = [60.0, 9.0] lies outside", "0..47, 0..35"),
    ("corrections", [click(points=[[9, 9, 9]])], "corrections.0.points = ", "a list of pixels (u, v)"),
    ("corrections", [click(points=[[9, float("nan")]])], "corrections.0.points = ", "all finite"),
    ("corrections", [click(labels=[1, 0])], "corrections.0", "as many labels as points, not 2 for 1"),
    ("corrections", [click(labels=[2])], "corrections.0.labels.0 = 2", "0 or 1"),
    ("corrections", [click(points=[])], "corrections.0", "has points or a box"),
    ("corrections", [click(box=[9, 9, 9, 20])], "corrections[0].box = [9.0, 9.0, 9.0, 20.0] has no area", "u0 < u1"),
    ("corrections", [click(), click(points=[[8, 8]])], "corrections[0] and corrections[1] are both about the object in frame 2", "one entry"),
    ("corrections", [click(), click(thing="controller")], "(9, 9) of frame 2 both on the controller and on the object", "one thing"),
    ("corrections", [click(points=[[9, 9], [9, 9]], labels=[1, 0])], "(9, 9) of frame 2 both on the object and off it", "one thing"),
    ("clamps", [{"lower": [0, 0, 1], "upper": [1, 1, 0]}], "clamps[0] has lower", "lower below upper"),
    ("clamps", [{"lower": [0, 0, 0], "upper": [1, 0, 1]}], "clamps[0] has lower", "lower below upper"),
    ("clamps", [{"lower": [0, 0, 0], "upper": [900, 900, 900]}], "clamps[0].upper = 900 m", "-50 to 50 m"),
    ("payloads", [{"point": [0, 0, 500], "radius": 0.02, "mass": 1}], "payloads[0].point = 500 m", "-50 to 50"),
    ("payloads", [{"point": [0, 0, 0], "radius": 20, "mass": 1}], "payloads[0].radius = 20 m", "1e-05 to 10 m"),
    ("payloads", [{"point": [0, 0, 0], "radius": 0.02, "mass": 52e3}], "payloads[0].mass = 52000 kg", "0 to 1000 kg"),
    ("payloads", [{"point": [0, 0, 0], "radius": 0.02, "force": [0, 0, 1e9]}], "payloads[0].force = 1e+09 N", "N"),
    ("payloads", [{"point": [0, 0, 0], "radius": 0.02}], "payloads", "a mass or a force"),
    ("payloads", [{"point": [0, 0, 0], "radius": float("inf"), "mass": 1}], "radius = inf", "finite"),
    ("T_world_object", np.diag([1.0, 1, -1, 1]).tolist(), "T_world_object mirrors", "translation and scale"),
    ("T_world_object", np.diag([0.0, 0, 0, 1]).tolist(), "T_world_object has a rotation part of zeros", "scale"),
    ("T_world_object", np.diag([1e6, 1e6, 1e6, 1]).tolist(), "T_world_object's scale = 1e+06", "0.0001 to 10000"),
    ("T_world_object", np.diag([1000.0, 1000, 1000, 1]).tolist(), "vertex", "metres"),
]  # fmt: skip


@pytest.mark.parametrize(("key", "value", "what", "expected"), KEYS, ids=[f"{k}-{i}" for i, (k, *_) in enumerate(KEYS)])
def test_a_key_of_capture_json_that_cannot_be(video, key, value, what, expected):
    fault = the_fault(video, keys(**{key: value}))
    assert what in fault.what and expected in fault.expected, str(fault)
    assert key.partition(".")[0] in fault.remedy or "T_world_object" in fault.where


def points(value: object, *index: object) -> dict:
    return {"points3d": put(index, value)}


FILES = {
    "tracks in millimetres": (
        arrays("tracks3d.npz", points3d=lambda p: 1000 * p + 40), "track 4 is at", "tracks3d.npz, frame 0", "metres"),
    "tracks of a wide scene in centimetres": (
        arrays("tracks3d.npz", points3d=lambda p: 100 * p), "tracks lie 15.3 m apart", "tracks3d.npz, frame 0", "10 m"),
    "a track jumps by 100 m": (
        arrays("tracks3d.npz", **points(100.0, 3, 2, 0)), "track 2 is at (100, 0.04, 0.03) m", "frame 3", "50 m"),
    "a track jumps by 5 m": (
        arrays("tracks3d.npz", **points(5.0, 3, 2, 0)), "track 2 jumps by 5 m to the next frame, which is 150 m/s",
        "frame 2", "100 m/s"),
    "NaN where valid": (
        arrays("tracks3d.npz", **points(np.nan, 2, 1, 0)), "track 1 is marked in valid3d, but its position is [nan",
        "tracks3d.npz, frame 2", "numbers"),
    "inf where valid": (
        arrays("tracks3d.npz", **points(np.inf, 2, 1, 0)), "track 1 is marked in valid3d", "frame 2", "numbers"),
    "sigma zero": (
        arrays("tracks3d.npz", sigma3d=put((2, 3), 0.0)), "sigma3d of track 3 is 0 m", "frame 2", "positive"),
    "sigma negative": (
        arrays("tracks3d.npz", sigma3d=lambda s: -s), "sigma3d of track 0 is -0.001 m", "frame 0", "positive"),
    "sigma in millimetres": (
        arrays("tracks3d.npz", sigma3d=lambda s: 3000 * s), "sigma3d of track 0 is 3 m", "frame 0", "at most 1 m"),
    "sigma not a number": (
        arrays("tracks3d.npz", sigma3d=put((0, 0), np.nan)), "sigma3d of track 0 is nan m", "frame 0", "positive"),
    "sigma of another shape": (
        arrays("tracks3d.npz", sigma3d=lambda s: s[:, 1:]), "sigma3d has the shape (6, 7)", "tracks3d.npz", "(6, 8)"),
    "valid of another shape": (
        arrays("tracks3d.npz", valid3d=lambda v: v[1:]), "valid3d has the shape (5, 8)", "tracks3d.npz", "(6, 8)"),
    "no valid track": (
        arrays("tracks3d.npz", valid3d=np.zeros_like), "0 3D tracks on the object", "tracks known in frame 0", "3"),
    "no track valid in frame 0": (
        arrays("tracks3d.npz", valid3d=put((0,), False)), "0 3D tracks on the object", "known in frame 0", "3 or more"),
    "two tracks": (
        arrays("tracks3d.npz", points3d=lambda p: p[:, :2], valid3d=lambda v: v[:, :2], sigma3d=lambda s: s[:, :2]),
        "2 3D tracks on the object", "tracks3d.npz", "3 or more"),
    "tracks valid in frame 0 alone": (
        arrays("tracks3d.npz", valid3d=put((slice(1, None),), False)),
        "known in 0 of the 3 observed frames after the first", "tracks3d.npz", "2 frames"),
    "fewer frames of tracks": (
        arrays("tracks3d.npz", points3d=lambda p: p[:-2], valid3d=lambda v: v[:-2], sigma3d=lambda s: s[:-2]),
        "points over 4 frames", "tracks3d.npz", "6 frames"),
    "tracks as texts": (
        arrays("tracks3d.npz", points3d=lambda p: p.astype(str)), "points3d holds <U", "tracks3d.npz", "real numbers"),
    "complex tracks": (
        arrays("tracks3d.npz", points3d=lambda p: p + 1j), "points3d holds complex", "tracks3d.npz", "real numbers"),
    "tracks2d as (row, column) of larger images": (
        arrays("tracks2d.npz", points2d=lambda p: p + 40), "100% of the visible points lie outside", "tracks2d.npz", "48 x 36"),
    "tracks2d NaN where visible": (
        arrays("tracks2d.npz", points2d=put((1, 4), np.nan)), "track 4 is marked in visible", "frame 1", "numbers"),
    "tracks2d never visible": (
        arrays("tracks2d.npz", visible=np.zeros_like), "no track is visible in any frame", "tracks2d.npz", "a track"),
    "tracks2d of fewer frames": (
        arrays("tracks2d.npz", points2d=lambda p: p[1:], visible=lambda v: v[1:]), "points over 5 frames", "tracks2d.npz", "6"),
    "controllers in millimetres": (
        arrays("controllers.npz", points=lambda p: 1000 * p), "controller point 1 is at", "controllers.npz", "metres"),
    "controllers with a gap": (
        arrays("controllers.npz", points=put((3, 1, 0), np.nan)), "controller point 1 is not finite",
        "controllers.npz, frame 3", "no gaps"),
    "a controller jumps": (
        arrays("controllers.npz", points=put((4, 1, 0), 9.0)), "controller point 1 jumps by", "frame 3", "100 m/s"),
    "a controller jumps by 100 m": (
        arrays("controllers.npz", points=put((4, 1, 0), 100.0)), "controller point 1 is at (100", "frame 4", "50 m"),
    "controllers of fewer frames": (
        arrays("controllers.npz", points=lambda p: p[:3]), "points over 3 frames", "controllers.npz", "6 frames"),
    "an object mask all true": (
        image("masks/object/000003.png", FULL), "the mask covers 100% of the image", "object/000003.png", "255 where"),
    "a hand mask all true": (
        image("masks/controller/000001.png", FULL), "the mask covers 100%", "controller/000001.png", "255 where"),
    "masks of 0 and 1": (
        images("masks/controller/000002.png", lambda m: m // 255), "a mask whose brightest pixel is 1",
        "controller/000002.png", "0 and 255"),
    "no object in frame 0": (
        image("masks/object/000000.png", 0 * FULL), "the object's mask has 0 pixels", "object/000000.png", "at least 20"),
    "no hand in frame 0": (
        image("masks/controller/000000.png", 0 * FULL), "the controller's mask has 0 pixels", "controller/000000.png", "at least 1"),
    "a few pixels in frame 0": (
        image("masks/object/000000.png", np.where(np.arange(WIDTH) < 10, FULL, 0)[:1].repeat(36, 0) * (np.arange(36)[:, None] < 1).astype(np.uint8)),
        "the object's mask has 10 pixels", "object/000000.png", "at least 20"),
    "controller mask is the object's": (
        lambda folder: [shutil.copy(p, folder / "masks/controller") for p in (folder / "masks/object").iterdir()],
        "object and controller are 100% the same", "masks, frame", "two things"),
    "masks of other proportions": (
        images("masks/object/000002.png", lambda m: m[:30]), "a mask of 48x30 pixels", "object/000002.png", "48x36"),
    "a mask is missing": (
        without("masks/object/000004.png"), "the image is missing", "object/000004.png", "6 images, one for each frame"),
    "no candidate in frame 0": (
        without("candidates/000000/000000.png"), "no candidate in frame 0", "candidates/000000", "one image per"),
    "a candidate of other proportions": (
        images("candidates/000003/*.png", lambda m: m[:20]), "a mask of 48x20", "candidates/000003/000000.png", "48x36"),
    "an open prior": (
        lambda folder: _open_box(folder / "shape_prior.glb"), "mesh is not closed: 3 open edges", "shape_prior.glb", "0"),
    "truth of fewer frames": (
        arrays("truth.npz", vertices=lambda v: v[:-1], hand=lambda h: h[:-1]), "vertices, hand over 5 frames", "truth.npz", "6 frames"),
    "truth that is not finite": (
        arrays("truth.npz", vertices=put((0, 0, 0), np.nan)), "vertices is an array of float64 of the shape (6, 8, 3)", "truth.npz", "finite"),
    "truth with a vertex that is not there": (
        arrays("truth.npz", gripped=np.array([99])), "gripped names a vertex", "truth.npz", "from 0 to 7"),
}  # fmt: skip


def _open_box(path: Path) -> None:
    import trimesh

    box = trimesh.load_mesh(path)
    box = box.to_mesh() if isinstance(box, trimesh.Scene) else box
    trimesh.Trimesh(box.vertices, box.faces[1:]).export(path)


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_cannot_be(video, name):
    edit, what, where, expected = FILES[name]
    fault = the_fault(video, edit)
    assert what in fault.what and where in fault.where and expected in fault.expected, str(fault)


OPTIONAL = (GivenTracks3d.FILE, GivenTracks2d.FILE, Controllers.FILE, CaptureTruth.FILE)


@pytest.mark.parametrize("file", OPTIONAL)
def test_a_pipe_in_place_of_a_file_is_told_and_not_waited_for(video, file):
    def pipe(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        os.mkfifo(folder / file)

    fault = the_fault(video, pipe)
    assert fault.what == "it is a named pipe" and file in fault.where


@pytest.mark.parametrize("file", OPTIONAL)
def test_a_link_to_nothing_is_told(video, file):
    def link(folder: Path) -> None:
        (folder / file).unlink(missing_ok=True)
        (folder / file).symlink_to(folder / "gone.npz")

    assert the_fault(video, link).what == f"{file} is a link to nothing"


MOCAP = {
    "no shape": (without("shape_prior.glb"), "a capture without images needs a shape", "shape_prior.glb"),
    "a payload in the air": (
        keys(payloads=[{"point": [0.12, 0.0, 0.5], "radius": 0.02, "mass": 0.05}]), "payloads[0] lies 0.43 m outside", "on the object"),
    "a clamp around all of it": (
        keys(clamps=[{"lower": [-1, -1, -1], "upper": [1, 1, 1]}]), "clamps[0] holds all of the object", "a part of it"),
    "a shape in millimetres": (
        lambda folder: recordings.write_box(folder / "shape_prior.glb", 1000.0), "vertex", "metres"),
    "tracks elsewhere": (
        arrays("tracks3d.npz", points3d=lambda p: p + np.float32(2.0)), "the nearest track is", "tracks on the object"),
    "a jump at a hundred frames a second": (
        arrays("tracks3d.npz", **points(1.5, 3, 2, 0)), "track 2 jumps by 1.5 m to the next frame, which is 150 m/s", "100 m/s"),
}  # fmt: skip


@pytest.mark.parametrize("name", MOCAP)
def test_a_set_up_of_motion_capture_that_cannot_be(mocap, name):
    edit, what, expected = MOCAP[name]
    fault = the_fault(mocap, edit)
    assert what in fault.what and expected in fault.expected, str(fault)


ODD = {
    "slow": (keys(fps=2.0), "fps = 2 frames/s is unusual"),
    "fast": (keys(fps=5000.0), "fps = 5000 frames/s is unusual"),
    "dense": (keys(density=7800.0), "density = 7800 kg/m3 is unusual"),
    "light": (keys(density=2.0), "density = 2 kg/m3 is unusual"),
    "a wide view": (keys(K=with_cell(np.diag([1, 1, 1]) @ (K * [[0.2], [0.2], [1]] + K * [[0], [0], [0]]), 0, 2, 23.5)), "image widths is unusual"),
    "half the resolution": (keys(K=scaled(K, 0.5)), "K may belong to images 0.5"),
    "cropped on one side": (keys(K=with_cell(K, 0, 2, 40.0)), "principal point at (40, 17.5)"),
    "pixels that are not square": (keys(K=with_cell(K, 1, 1, 60.0)), "fy over fx = 1.5 is unusual"),
    "a camera under the table": (keys(T_world_camera=pose(t=[0.0, 0.0, -0.6])), "0.6 m below the table"),
    "a camera far away": (keys(T_world_camera=pose(t=[20.0, 0.0, 0.6])), "translation = 20 m is unusual"),
    "two hints": (keys(hints={"object": {"point": [9, 9], "colour": "teal"}}), "has point and colour; point alone is used"),
    "a box around everything": (keys(hints={"object": {"box": [0, 0, 47, 35]}}), "is all of the image"),
    "corrections beside masks": (keys(corrections=[click()]), "corrections of the object are not used, since masks/object is given"),
    "a heavy load": (keys(payloads=[{"point": [0, 0, 0], "radius": 0.02, "mass": 50.0}]), "payloads[0].mass = 50 kg is unusual"),
    "one observed frame": (
        all_of(without("tracks3d.npz"), keys(split={"train": [0, 1], "test": [1, 6]})), "1 frame of 6 is observed"),
    "more tracks than frames": (
        arrays("controllers.npz", points=lambda p: np.concatenate([p, p[-1:]])), "points over 7 frames; the last 1 are left out"),
    "a fast track": (arrays("tracks3d.npz", **points(1.2, 3, 2, 0)), "track 2 jumps by 1.2 m"),
    "nothing moves": (arrays("tracks3d.npz", points3d=lambda p: np.repeat(p[:1], FRAMES, 0)), "no track moves by more than 0 mm"),
    "large sigma": (arrays("tracks3d.npz", sigma3d=lambda s: 100 * s), "sigma3d is 0.1 m in the median"),
    "tracks of a grain": (arrays("tracks3d.npz", points3d=lambda p: p / 50), "tracks span 0.00"),
    "some pixels outside": (arrays("tracks2d.npz", points2d=put((0, 0), 900.0)), "2% of the visible points lie outside"),
    "a large mask": (images("masks/object/000003.png", lambda m: np.where(np.arange(36)[:, None] < 30, FULL, 0).astype(np.uint8)), "covers 83% of the image"),
    "masks that overlap": (
        images("masks/controller/*.png", lambda m: np.roll(m, (0, -14), (0, 1))), "are 33% the same"),
    "an empty hand": (images("masks/controller/00000[2-5].png", lambda m: 0 * m), "4 of 6 masks are empty"),
    "a misspelt file": (lambda folder: (folder / "controllers.npz").rename(folder / "controller.npz"), "did you mean controllers.npz?"),
    "a misspelt folder of masks": (lambda folder: (folder / "masks/controller").rename(folder / "masks/hand"), "nothing reads masks/hand"),
    "no depth": (without("depth", "tracks3d.npz"), "without depth a shape that is given cannot be placed"),
}  # fmt: skip


@pytest.mark.parametrize("name", ODD)
def test_what_is_odd_is_told_in_a_line_and_passes(video, name, capsys):
    edit, words = ODD[name]
    edit(video)
    _, found = examine(video)
    assert not found.faults, list(map(str, found.faults))
    said = [str(warning) for warning in found.warnings]
    assert sum(words in line for line in said) == 1, said
    assert not any("\n" in line for line in said)
    check_capture(video)
    assert f"warning: {next(line for line in said if words in line)}\n" in capsys.readouterr().err


def parse(root: Path) -> Path:
    return run_stage("parse_video", "clip", parse_video, Project(write_project(root)))


REFUSED_WHILE_PARSING = (
    "tracks in millimetres",
    "NaN where valid",
    "sigma negative",
    "sigma of another shape",
    "fewer frames of tracks",
    "tracks2d never visible",
    "controllers with a gap",
    "a controller jumps by 100 m",
    "a hand mask all true",
    "masks of 0 and 1",
    "controller mask is the object's",
    "a mask is missing",
    "no candidate in frame 0",
)


@pytest.mark.parametrize("name", REFUSED_WHILE_PARSING)
def test_parse_video_refuses_the_same(video, tmp_path, name):
    edit, what, where, _ = FILES[name]
    edit(video)
    with pytest.raises(InputError) as raised:
        parse(tmp_path)
    assert what in raised.value.what and where in raised.value.where
    assert not (tmp_path / "data/artifacts/parse_video/clip").exists()
    assert not [path for path in (tmp_path / "data/artifacts").rglob("*") if path.is_file()]


@pytest.mark.parametrize("kind", ["video", "mocap"])
def test_parse_video_takes_what_passes_and_records_what_is_odd(made, tmp_path, kind):
    capture = Path(shutil.copytree(made[kind], tmp_path / "data/captures/clip"))
    keys(density=7800.0)(capture)
    output = parse(tmp_path)
    said = json.loads((output / "quality.json").read_text())["warnings"]
    assert sum("density = 7800 kg/m3 is unusual" in line for line in said) == 1


def test_all_faults_are_listed_a_line_each_and_the_exit_code_is_two(video, tmp_path, capsys, monkeypatch):
    write_project(tmp_path)
    keys(K=K.T.tolist(), fps=1e9)(video)
    arrays("controllers.npz", points=lambda p: 1000 * p)(video)
    image("masks/object/000003.png", FULL)(video)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as ended:
        main(["check"])
    assert ended.value.code == 2
    said = capsys.readouterr()
    lines = said.err.splitlines()
    assert len(lines) == 4 and all(line.startswith("physreal: ") for line in lines), said.err
    assert "clip: 4 faults; 6 frames" in said.out


def test_many_faults_alike_are_counted(video):
    images("color/*.png", lambda c: c[:20])(video)
    _, found = examine(video)
    assert len(found.faults) == 6 and "1 more of 6 images have faults" in found.faults[-1].what


def test_the_first_fault_says_how_many_follow(video):
    keys(K=K.T.tolist(), fps=1e9, density=1e9)(video)
    with pytest.raises(InputError, match="lists 2 more faults"):
        check_capture(video)


@pytest.mark.parametrize("posed", [True, False])
@pytest.mark.parametrize("clip", [True, False])
def test_without_depth_a_clip_passes_and_a_fit_does_not(video, clip, posed):
    pose = POSE.tolist() if posed else None
    all_of(without("depth", "tracks3d.npz", "controllers.npz"), keys(T_world_camera=pose))(video)
    _, found = examine(video, Purpose(clip=clip))
    placeless = [
        "neither depth nor T_world_camera is there, so the world cannot be set",
        "there is neither depth nor tracks3d.npz, so nothing can be fitted",
    ]
    shaped = ["without depth a shape that is given cannot be placed"]
    assert [fault.what for fault in found.faults] == ([] if clip else shaped if posed else placeless)


def test_without_depth_an_object_on_the_table_of_a_known_camera_can_be_fitted(video):
    all_of(without("depth", "tracks3d.npz", "controllers.npz", "shape_prior.glb"))(video)
    _, found = examine(video, Purpose(clip=False))
    assert not found.faults


def test_a_clip_with_points_of_the_world_needs_one(video):
    all_of(without("depth", "tracks3d.npz"), keys(T_world_camera=None))(video)
    _, found = examine(video, Purpose(clip=True))
    assert [fault.what for fault in found.faults] == [
        "neither depth nor T_world_camera is there, so the world cannot be set"
    ]


@pytest.mark.parametrize(("frames", "faults"), [(FRAMES, 0), (FRAMES - 2, 1), (FRAMES + 1, 1), (0, 1)])
def test_a_video_file_has_as_many_frames_as_there_is_depth(video, frames, faults):
    import imageio_ffmpeg

    without("color")(video)
    (video / "color.mp4").write_bytes(b"no video")
    if frames:
        writer = imageio_ffmpeg.write_frames(str(video / "color.mp4"), (WIDTH, HEIGHT), fps=30, macro_block_size=2)
        writer.send(None)
        for frame in range(frames):
            writer.send(np.full((HEIGHT, WIDTH, 3), 20 * frame, np.uint8))
        writer.close()
    keys(frame_count=None)(video)
    _, found = examine(video)
    told = [str(fault) for fault in found.faults]
    assert (len(told) > 0) == (faults > 0) and all(str(video) in line for line in told), told


def test_one_frame_is_no_recording(video):
    for folder in ("color", "depth", "masks/object", "masks/controller"):
        for path in sorted((video / folder).iterdir())[1:]:
            path.unlink()
    without("tracks2d.npz", "tracks3d.npz", "controllers.npz", "truth.npz", "candidates")(video)
    fault = the_fault(video, keys(frame_count=None))
    assert fault.what == "there is one frame" and fault.expected == "two or more"


def test_a_world_that_no_table_shows_is_refused_before_it_is_needed(video, tmp_path):
    scattered = np.random.default_rng(0).integers(300, 3000, (HEIGHT, WIDTH)).astype(np.uint16)
    image("depth/000000.png", scattered)(video)
    fault = the_fault(video, keys(T_world_camera=None))
    assert "of the points lie on one plane" in fault.what and "depth/000000.png" in fault.where
    assert "T_world_camera" in fault.remedy
    with pytest.raises(InputError, match="of the points lie on one plane"):
        parse(tmp_path)


def test_a_world_that_the_table_shows_passes(video, tmp_path):
    without("tracks3d.npz", "controllers.npz")(video)
    keys(T_world_camera=None)(video)
    assert not examine(video)[1].faults
    parse(tmp_path)


BEAMS = ("gravity_V2_a", "gravity_V2_b", "load52_V2_a", "load52_V2_b")


@pytest.mark.parametrize("name", BEAMS)
def test_a_real_beam_passes_without_a_word(real_data, tmp_path, name):
    silicone_beam.import_capture(real_data / "silicone_beam" / f"{name}.npz", tmp_path / "beam")
    _, found = examine(tmp_path / "beam", Purpose(clip=False))
    assert (found.faults, found.warnings) == ([], [])


def test_a_real_clip_passes_without_a_word(real_data, tmp_path):
    images_importer.import_capture(real_data / "phystwin_single_lift_rope", tmp_path / "rope")
    _, found = examine(tmp_path / "rope", Purpose(clip=True))
    assert (found.faults, found.warnings) == ([], [])


def test_closed_holes_pass_where_they_are_asked_for(video):
    _open_box(video / "shape_prior.glb")
    assert not examine(video, Purpose(close_holes=True))[1].faults


def test_masks_of_half_the_size_pass(video):
    images("masks/*/*.png", lambda m: np.asarray(Image.fromarray(m).resize((WIDTH // 2, HEIGHT // 2), 0)))(video)
    assert not examine(video)[1].faults
