"""The stage on captures that bring their own masks, candidates, tracks or controllers: no network needed."""

import json

import cv2
import numpy as np
import pytest

from physreal_core.errors import InputError
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.quality import PerceptionQuality
from pipeline.products.tracks import MeasuredTracks
from pipeline.project import Project
from pipeline.stage import run_stage
from stages.parse_video import run as parse
from stages.segment_and_track import run
from tests.perception.scene import HEIGHT, T_WORLD_CAMERA, WIDTH, K, film

FRAMES = 4
SCENE = film(FRAMES)


def _write(folder, name, masks):
    (folder / name).mkdir(parents=True)
    for t, mask in enumerate(masks):
        cv2.imwrite(str(folder / name / f"{t:06d}.png"), mask.astype(np.uint8) * 255)


@pytest.fixture
def capture(tmp_path):
    """A capture of the film without anything given."""
    folder = tmp_path / "data" / "captures" / "clip"
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for t in range(FRAMES):
        cv2.imwrite(str(folder / "color" / f"{t:06d}.png"), SCENE.frames[t][..., ::-1])
        cv2.imwrite(str(folder / "depth" / f"{t:06d}.png"), np.round(SCENE.depth[t] * 1000).astype(np.uint16))
    description = {"fps": 30.0, "width": WIDTH, "height": HEIGHT, "K": K.tolist()}
    description |= {"T_world_camera": T_WORLD_CAMERA.tolist(), "description": "a disc", "controller": "hand"}
    (folder / "capture.json").write_text(json.dumps(description))
    return folder


def segment(capture, **params):
    root = capture.parents[2]
    block = {"track_count": 80, "hand_track_count": 60, "keyframe_stride": 2, "hand_finder": "none", **params}
    (root / "params.yaml").write_text(json.dumps({"seed": 0, "sequences": {"clip": {}}, "segment_and_track": block}))
    run_stage("parse_video", "clip", parse, Project(root))
    return run_stage("segment_and_track", "clip", run, Project(root))


def describe(capture, **values):
    path = capture / "capture.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def test_given_masks_replace_the_networks(capture):
    _write(capture, "masks/object", SCENE.objects)
    _write(capture, "masks/controller", SCENE.hands)
    output = segment(capture, segmenter="none")
    for t in range(FRAMES):
        mask = cv2.imread(str(output / "masks" / "object" / f"{t:06d}.png"), cv2.IMREAD_GRAYSCALE)
        assert np.array_equal(mask, SCENE.objects[t].astype(np.uint8) * 255)
    tracks = MeasuredTracks.load(output)
    shape = tracks.visible.shape
    assert shape[0] == FRAMES and shape[1] > 50
    assert tracks.points2d.shape == (*shape, 2) and tracks.points3d.shape == (*shape, 3)
    assert np.isnan(tracks.points3d[~tracks.valid3d]).all()
    assert (tracks.confidence[tracks.visible] > 0).all() and (tracks.starts >= 0).all()
    moved = (tracks.points2d - tracks.points2d[0] - SCENE.motion[:, None])[tracks.visible]
    # Flow is smooth across the disc's rim, where table and disc part: points there are off by up to a pixel.
    assert np.median(np.linalg.norm(moved, axis=1)) < 0.1 and np.quantile(np.linalg.norm(moved, axis=1), 0.9) < 1.0
    controllers = Controllers.load(output).points
    assert controllers.shape == (FRAMES, 3 * 30, 3) and np.isfinite(controllers).all()
    travelled = np.linalg.norm(controllers[-1] - controllers[0], axis=1)
    assert np.allclose(travelled, np.linalg.norm(SCENE.motion[-1]) * 0.52 / 140, atol=0.001)
    report = json.loads((output / "segmentation.json").read_text())
    assert report["frames_without_mask"] == {"object": [], "controller": []}
    video = cv2.VideoCapture(str(output / "overlay.mp4"))
    assert int(video.get(cv2.CAP_PROP_FRAME_COUNT)) == FRAMES and int(video.get(cv2.CAP_PROP_FRAME_WIDTH)) == 2 * WIDTH


def test_given_candidates_are_voted_on(capture, capsys):
    for t in range(FRAMES):
        half = SCENE.objects[t] & (np.arange(WIDTH) < 60)
        masks = (half, SCENE.objects[t], SCENE.hands[t], SCENE.objects[t] | SCENE.hands[t])
        (capture / "candidates" / f"{t:06d}").mkdir(parents=True)
        for i, mask in enumerate(masks):
            cv2.imwrite(str(capture / "candidates" / f"{t:06d}" / f"{i}.png"), mask.astype(np.uint8) * 255)
    describe(capture, hints={"object": {"colour": "teal"}, "controller": {"box": [80, 23, 104, 55]}})
    output = segment(capture, segmenter="none")
    mask = cv2.imread(str(output / "masks" / "object" / "000002.png"), cv2.IMREAD_GRAYSCALE) > 0
    said = capsys.readouterr().out
    assert "the object is hints.object: colour, certainty 1.00 (choice.png)" in said and "warning" not in said
    assert PerceptionQuality.load(output).warnings == [] and (output / "choice.png").stat().st_size > 1000
    assert (mask & SCENE.objects[2]).sum() > 0.97 * (mask | SCENE.objects[2]).sum()
    assert json.loads((output / "segmentation.json").read_text())["chosen_by"]["object"] == "hints.object: colour"


def test_given_tracks_and_controllers_are_used(capture):
    _write(capture, "masks/object", SCENE.objects)
    _write(capture, "masks/controller", SCENE.hands)
    points = np.tile(0.01 * np.arange(FRAMES, dtype=np.float32)[:, None, None], (1, 5, 3))
    points[2, 3] = np.nan
    GivenTracks3d(points, np.isfinite(points).all(-1)).save(capture)
    Controllers(np.ones((FRAMES, 3, 3), np.float32), np.array([[0, 1], [2, 2]]), np.array([0.01, 0.02])).save(capture)
    output = segment(capture, segmenter="none")
    tracks = MeasuredTracks.load(output)
    assert np.array_equal(tracks.points3d, points, equal_nan=True) and not tracks.valid3d[2, 3]
    hand = Controllers.load(output)
    assert np.array_equal(hand.points, np.ones((FRAMES, 3, 3)))
    assert hand.ends.tolist() == [[0, 1], [2, 2]] and hand.radius == pytest.approx([0.01, 0.02])


def test_given_2d_tracks_replace_the_tracker(capture):
    _write(capture, "masks/object", SCENE.objects)
    _write(capture, "masks/controller", SCENE.hands)
    points = (np.array([[60.0, 45], [52, 40]])[None] + SCENE.motion[:, None]).astype(np.float32)
    visible = np.array([[1, 1], [1, 0], [1, 1], [1, 1]], bool)
    GivenTracks2d(points, visible).save(capture)
    tracks = MeasuredTracks.load(segment(capture, segmenter="none"))
    assert np.allclose(tracks.points2d, points, atol=1e-4)
    assert np.array_equal(tracks.valid3d, visible)


def test_a_capture_of_tracks_alone_passes_through(capture):
    for name in ("color", "depth"):
        for file in (capture / name).iterdir():
            file.unlink()
        (capture / name).rmdir()
    points = 0.1 * np.random.default_rng(0).random((6, 3, 3)).astype(np.float32)
    GivenTracks3d(points, np.ones((6, 3), bool), np.full((6, 3), 0.002)).save(capture)
    (capture / "capture.json").write_text(json.dumps({"kind": "tracks", "fps": 100.0}))
    output = segment(capture)
    tracks = MeasuredTracks.load(output)
    assert np.array_equal(tracks.points3d, points) and np.allclose(tracks.sigma3d, 0.002)
    assert Controllers.load(output).points.shape == (6, 0, 3)
    assert not (output / "masks").exists() and not (output / "overlay.mp4").exists()


def colour_alone(capture):
    for file in (capture / "depth").iterdir():
        file.unlink()
    (capture / "depth").rmdir()
    describe(capture, T_world_camera=None)
    _write(capture, "masks/object", SCENE.objects)
    _write(capture, "masks/controller", SCENE.hands)


def test_a_clip_of_colour_alone_needs_no_world(capture):
    colour_alone(capture)
    tracks = MeasuredTracks.load(segment(capture, segmenter="none"))
    assert tracks.visible.any() and not tracks.valid3d.any() and np.isnan(tracks.points3d).all()


def test_points_of_a_world_that_nothing_sets_are_refused(capture):
    colour_alone(capture)
    Controllers(np.ones((FRAMES, 3, 3), np.float32)).save(capture)
    with pytest.raises(InputError, match=r"controllers\.npz: neither depth nor T_world_camera is there"):
        segment(capture, segmenter="none")


@pytest.mark.parametrize(
    "role,message",
    [("object", "the object's mask has 0 pixels"), ("controller", "the controller's mask has 0 pixels")],
    ids=["object", "controller"],
)
def test_an_empty_given_mask_in_frame_0_is_named(capture, role, message):
    for name, masks in (("object", SCENE.objects), ("controller", SCENE.hands)):
        _write(capture, f"masks/{name}", masks * (name != role))
    with pytest.raises(InputError, match=rf"masks/{role}/000000\.png: {message}"):
        segment(capture, segmenter="none")


def test_without_masks_and_networks_the_parameter_is_named(capture):
    with pytest.raises(InputError, match="segment_and_track.segmenter"):
        segment(capture, segmenter="none")


def test_a_missing_network_names_the_command(capture, monkeypatch):
    (capture.parents[2] / "params.yaml").write_text("{}")
    monkeypatch.chdir(capture.parents[2])  # networks are looked for in the project around the working directory
    with pytest.raises(InputError, match=r"sam2_encoder\.ort.*physreal models"):
        segment(capture)


def test_a_missing_given_mask_is_named(capture):
    _write(capture, "masks/object", SCENE.objects[:-1])
    with pytest.raises(InputError, match=r"masks/object/000003\.png"):
        segment(capture, segmenter="none")


@pytest.mark.parametrize("name", ["masks/object/000001.png", "candidates/000001/000000.png"])
def test_a_truncated_given_mask_is_named(capture, name):
    _write(capture, "masks/object", SCENE.objects)
    for t in range(FRAMES):
        _write(capture, f"candidates/{t:06d}", SCENE.hands[t : t + 1])
    image = capture / name
    image.write_bytes(image.read_bytes()[: int(0.7 * image.stat().st_size)])
    with pytest.raises(
        InputError, match=rf"{image.parent.name}/{image.name}: the image cannot be read, is it truncated"
    ):
        segment(capture, segmenter="none")


def test_masks_that_go_astray_are_told_in_the_terminal_and_in_quality_json(capture, capsys):
    """The given mask shrinks to a fifth in frame 2 and is gone in frame 3."""
    objects = SCENE.objects.copy()
    objects[2] &= np.arange(WIDTH) < 48
    objects[3] = False
    _write(capture, "masks/object", objects)
    _write(capture, "masks/controller", SCENE.hands)
    quality = PerceptionQuality.load(segment(capture, segmenter="none"))
    doubts = {doubt["kind"]: doubt["frames"] for doubt in quality.doubts}
    assert doubts["empty"] == [3] and doubts["area"] == [2]
    said = capsys.readouterr().out
    assert all(f"warning: {warning}" in said for warning in quality.warnings) and "physreal label" in said
