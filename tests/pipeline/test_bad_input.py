"""Every fault of a capture or of params.yaml ends parse_video with a sentence that names file, frame or key."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from physreal_core.errors import InputError
from pipeline.products.camera import RecordedCamera
from pipeline.project import Project
from pipeline.stage import run_stage
from stages._camera import load_camera
from stages.parse_video import run
from tests.pipeline.captures import HEIGHT, WIDTH, K, write_capture, write_project


def parse(root: Path, **blocks: object) -> None:
    write_project(root, **blocks)
    run_stage("parse_video", "clip", run, Project(root))


@pytest.fixture
def capture(tmp_path: Path) -> Path:
    return write_capture(tmp_path / "data" / "captures" / "clip")


def fault(root: Path, **blocks: object) -> str:
    with pytest.raises(InputError) as raised:
        parse(root, **blocks)
    assert not (root / "data/artifacts/parse_video/clip").exists()
    return str(raised.value)


def rewrite(capture: Path, **changes: object) -> None:
    shutil.rmtree(capture)
    write_capture(capture, **changes)


def test_a_good_capture_passes(tmp_path, capture):
    parse(tmp_path)
    assert len(list((tmp_path / "data/artifacts/parse_video/clip/color").iterdir())) == 4


def test_no_capture(tmp_path):
    assert "data/captures/clip: the capture's folder is missing" in fault(tmp_path)


def test_no_frames(tmp_path, capture):
    for image in (capture / "color").iterdir():
        image.unlink()
    message = fault(tmp_path)
    assert "there are no frames" in message and str(capture) in message


@pytest.mark.parametrize("kind", ["color", "depth"])
@pytest.mark.parametrize("kept", [0.3, 0.9, 0.99])
def test_a_truncated_image(tmp_path, capture, kind, kept):
    image = capture / kind / "000002.png"
    image.write_bytes(image.read_bytes()[: int(kept * image.stat().st_size)])
    assert f"{kind}/000002.png: the image cannot be read, is it truncated?" in fault(tmp_path)


def test_depth_in_metres(tmp_path, capture):
    Image.fromarray(np.full((HEIGHT, WIDTH), 1, np.uint16)).save(capture / "depth" / "000001.png")
    message = fault(tmp_path)
    assert "depth/000001.png: median depth 1, read as millimetres 0.001 m" in message and "in millimetres" in message


def test_depth_in_tenths_of_millimetres(tmp_path, capture):
    Image.fromarray(np.full((HEIGHT, WIDTH), 12000, np.uint16)).save(capture / "depth" / "000000.png")
    assert "depth/000000.png: median depth 12000, read as millimetres 12 m" in fault(tmp_path)


def test_depth_in_metres_rounded_to_nothing(tmp_path, capture):
    for image in (capture / "depth").iterdir():
        Image.fromarray(np.zeros((HEIGHT, WIDTH), np.uint16)).save(image)
    message = fault(tmp_path)
    assert "depth/000000.png: no reading at all" in message and "in millimetres" in message


def test_depth_compressed_with_loss(tmp_path, capture):
    for image in (capture / "depth").iterdir():
        Image.fromarray(np.full((HEIGHT, WIDTH), 200, np.uint8)).save(image.with_suffix(".jpg"))
        image.unlink()
    assert ".jpg is no image that captures hold" in fault(tmp_path)


def test_depth_of_eight_bits(tmp_path, capture):
    Image.fromarray(np.full((HEIGHT, WIDTH), 200, np.uint8)).save(capture / "depth" / "000003.png")
    assert "depth/000003.png: a depth image of mode L; expected one 16-bit channel" in fault(tmp_path)


def test_depth_as_floats(tmp_path, capture):
    for image in (capture / "depth").iterdir():
        np.save(image.with_suffix(".npy"), np.ones((HEIGHT, WIDTH)))
        image.unlink()
    message = fault(tmp_path)
    assert ".npy is no image that captures hold" in message and str(capture / "depth") in message


def test_depth_of_another_size(tmp_path, capture):
    Image.fromarray(np.full((HEIGHT, WIDTH + 1), 600, np.uint16)).save(capture / "depth" / "000001.png")
    assert f"depth/000001.png: {WIDTH + 1}x{HEIGHT} pixels; expected {WIDTH}x{HEIGHT}" in fault(tmp_path)


def test_fewer_depth_than_colour_frames(tmp_path, capture):
    (capture / "depth" / "000003.png").unlink()
    assert "4 colour frames but 3 depth frames" in fault(tmp_path)


def test_a_frame_missing_in_between(tmp_path, capture):
    (capture / "color" / "000001.png").unlink()
    assert "color: frame 1 is missing" in fault(tmp_path)


def test_no_camera_matrix(tmp_path, capture):
    rewrite(capture, K=None)
    message = fault(tmp_path)
    assert "capture.json" in message and "the key K" in message


@pytest.mark.parametrize("matrix", [K[:2].tolist(), "no", [[1, 2], [3]], [[float("nan")] * 3] * 3])
def test_a_camera_matrix_that_is_none(tmp_path, capture, matrix):
    rewrite(capture, K=matrix)
    message = fault(tmp_path)
    assert "capture.json: K = " in message and "3x3" in message


def test_a_misspelt_key_in_the_capture(tmp_path, capture):
    rewrite(capture, T_camera_world=np.eye(4).tolist())
    assert "unknown key T_camera_world; did you mean T_world_camera?" in fault(tmp_path)


def test_neither_depth_nor_pose(tmp_path, capture):
    rewrite(capture, known_pose=False)
    for image in (capture / "depth").iterdir():
        image.unlink()
    parse(tmp_path)  # enough for a clip
    parsed = tmp_path / "data/artifacts/parse_video/clip"
    assert RecordedCamera.load(parsed).T_world_camera is None
    with pytest.raises(InputError, match="neither depth nor T_world_camera is there.*T_world_camera in capture.json"):
        load_camera(parsed)  # what a model is fitted with


def test_a_split_past_the_end(tmp_path, capture):
    rewrite(capture, split={"train": [0, 3], "test": [3, 9]})
    message = fault(tmp_path)
    assert "capture.json: split" in message and "4 frames" in message


@pytest.mark.parametrize(
    ("block", "words"),
    [
        ({"parse_video": {"max_widht": 320}}, "unknown key parse_video.max_widht; did you mean parse_video.max_width?"),
        ({"parse_video": {"max_width": 3}}, "parse_video.max_width = 3; expected greater than or equal to 32"),
        ({"parse_video": {"max_width": "wide"}}, "parse_video.max_width = 'wide'; expected a valid integer"),
        ({"parse_vidoe": {}}, "unknown key parse_vidoe; did you mean parse_video?"),
        ({"fits": {"clap": {}}}, "unknown key fits.clap; did you mean fits.clip?"),
        ({"fits": {"clip": {"fit_global": {}}}}, "unknown key fits.clip.fit_global; expected one of companion"),
        (
            {"fits": {"clip": {"companion": "clap"}}},
            "fits.clip.companion = 'clap' is no sequence; expected one of clip",
        ),
        ({"fits": {"clip": None}}, "fits.clip = None; expected a valid dictionary"),
        ({"predictions": {"clip": {"model_from": "x"}}}, "predictions.clip.model_from = 'x' is not a fitted sequence"),
        ({"sequences": {"clip": {"parse_video": {"max_widht": 320}}}}, "sequences.clip.parse_video.max_widht"),
    ],
)
def test_parameters_out_of_range_or_misspelt(tmp_path, capture, block, words):
    message = fault(tmp_path, **block)
    assert words in message and "params.yaml" in message
