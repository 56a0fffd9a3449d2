"""Image folders: numbering, units, intrinsics, and the real rope clip where it is at hand."""

import json

import numpy as np
import pytest
from PIL import Image

from data.importers.images import import_capture
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.check import check_capture
from pipeline.frames import read_frames

K = [[40.0, 0, 15.5], [0, 41.0, 11.5], [0, 0, 1]]


@pytest.fixture
def folder(tmp_path):
    source = tmp_path / "recording"
    for name in ("color", "depth"):
        (source / name).mkdir(parents=True)
    for frame in range(12):  # 2 before 10: order of numbers, not of letters
        image = np.full((24, 32, 3), frame, np.uint8)
        Image.fromarray(image).save(source / "color" / f"rgb_{frame}.png")
        Image.fromarray(np.full((24, 32), 5000 + frame, np.uint16)).save(source / "depth" / f"d{frame}.png")
    (source / "intrinsics.json").write_text(json.dumps({"fx": 40.0, "fy": 41.0, "cx": 15.5, "cy": 11.5, "fps": 15}))
    return source


def test_frames_units_and_intrinsics(folder, tmp_path):
    import_capture(folder, tmp_path / "capture", depth_unit=0.0001, description="a mug", controller="hand")
    capture = read_capture(tmp_path / "capture")
    assert (capture.fps, capture.width, capture.height, capture.description) == (15, 32, 24, "a mug")
    np.testing.assert_allclose(capture.K, K)
    assert capture.T_world_camera is None
    frames = list(read_frames(tmp_path / "capture", capture, (0.1, 8.0)))
    assert [colour[0, 0, 0] for colour, _ in frames] == list(range(12))
    assert all((depth == 500 + (frame >= 5)).all() for frame, (_, depth) in enumerate(frames) if frame != 5)


def test_text_intrinsics_and_array_depth(folder, tmp_path):
    (folder / "intrinsics.json").unlink()
    np.savetxt(folder / "intrinsics.txt", K)
    for frame in range(12):
        (folder / "depth" / f"d{frame}.png").unlink()
        depth = np.full((24, 32), 0.75, np.float32)
        depth[0, :3] = np.nan, np.inf, -1
        np.save(folder / "depth" / f"{frame}.npy", depth)
    import_capture(folder, tmp_path / "capture", depth_unit=1.0, fps=60)
    capture = read_capture(tmp_path / "capture")
    np.testing.assert_allclose(capture.K, K)
    _, depth = next(read_frames(tmp_path / "capture", capture, (0.1, 8.0)))
    assert depth[0, :4].tolist() == [0, 0, 0, 750] and capture.fps == 60


@pytest.mark.parametrize(
    ("break_it", "message"),
    [
        (lambda folder: (folder / "intrinsics.json").unlink(), "no intrinsics"),
        (lambda folder: (folder / "intrinsics.json").write_text('{"fx": 1}'), "no key 'fy'"),
        (lambda folder: (folder / "intrinsics.json").write_text("{"), "JSON"),
        (lambda folder: (folder / "depth" / "d3.png").unlink(), "12 colour but 11 depth"),
        (lambda folder: [path.unlink() for path in (folder / "color").iterdir()], "no colour images"),
        (lambda folder: (folder / "depth" / "d0.png").write_bytes(b"\x89PNG\r\n"), "d0.png"),
    ],
)
def test_faults_are_named(folder, tmp_path, break_it, message):
    break_it(folder)
    with pytest.raises(InputError, match=message):
        import_capture(folder, tmp_path / "capture")
    assert not (tmp_path / "capture").exists()


def test_rope_clip(real_data, tmp_path):
    source = real_data / "phystwin_single_lift_rope"
    import_capture(source, tmp_path / "rope")
    capture = read_capture(tmp_path / "rope")
    assert capture.description == "a rope" and capture.controller == "hand"
    assert check_capture(tmp_path / "rope").startswith("50 frames of 848x480 at 30 Hz, depth in 0")
    # Pose and K against the recording's own 3D: the rope's first visible centre projects into the picture.
    centre = np.loadtxt(source / "visible_rope_centre.csv", delimiter=",", skiprows=1)[0, 1:4]
    local = np.linalg.inv(capture.T_world_camera) @ [*centre, 1]
    u, v = (capture.K @ local[:3])[:2] / local[2]
    assert 0 < u < 848 and 0 < v < 480
