"""RealSense recordings: what can be tested without one. The reader is a stand-in with Open3D's interface."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from data.importers import realsense
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.frames import read_frames

MATRIX = [[40.0, 0, 15.5], [0, 40.0, 11.5], [0, 0, 1]]


class Image:
    def __init__(self, array):
        self.array = array

    def __array__(self, dtype=None, copy=None):
        return self.array.astype(dtype or self.array.dtype)


class Bag:
    """Three frames of depth 5000 counts at 10 000 counts a metre."""

    def __init__(self, readable=True, frames=3):
        self.readable, self.left, self.closed = readable, frames, False
        self.metadata = SimpleNamespace(
            fps=30,
            width=32,
            height=24,
            depth_scale=10000.0,
            intrinsics=SimpleNamespace(intrinsic_matrix=np.array(MATRIX)),
        )

    def open(self, name):
        return self.readable and name.endswith(".bag")

    def is_eof(self):
        return self.left == 0

    def next_frame(self):
        self.left -= 1
        colour, depth = np.full((24, 32, 3), self.left, np.uint8), np.full((24, 32, 1), 5000, np.uint16)
        return SimpleNamespace(color=Image(colour), depth=Image(depth), is_empty=lambda: False)

    def close(self):
        self.closed = True


def with_reader(monkeypatch, bag):
    io = SimpleNamespace(RSBagReader=lambda: bag) if bag is not None else SimpleNamespace()
    monkeypatch.setitem(sys.modules, "open3d", SimpleNamespace(t=SimpleNamespace(io=io)))


@pytest.fixture
def path(tmp_path):
    (tmp_path / "clip.bag").write_bytes(b"#ROSBAG V2.0\n")
    return tmp_path / "clip.bag"


def test_frames_become_a_capture(monkeypatch, path, tmp_path):
    bag = Bag()
    with_reader(monkeypatch, bag)
    realsense.import_capture(path, tmp_path / "capture", description="a sponge")
    capture = read_capture(tmp_path / "capture")
    np.testing.assert_allclose(capture.K, MATRIX)
    frames = list(read_frames(tmp_path / "capture", capture, (0.1, 8.0)))
    assert [colour[0, 0, 0] for colour, _ in frames] == [2, 1, 0]
    assert all((depth == 500).all() for _, depth in frames) and bag.closed


@pytest.mark.parametrize(
    ("bag", "message"),
    [(None, "no RealSense reader"), (Bag(readable=False), "cannot read"), (Bag(frames=0), "no frame")],
)
def test_faults_are_named(monkeypatch, path, tmp_path, bag, message):
    with_reader(monkeypatch, bag)
    with pytest.raises(InputError, match=message):
        realsense.import_capture(path, tmp_path / "capture")
    assert not (tmp_path / "capture").exists()


def test_without_open3d(monkeypatch, path, tmp_path):
    monkeypatch.setitem(sys.modules, "open3d", None)
    with pytest.raises(InputError, match=r"Open3D cannot be imported.*pip install open3d"):
        realsense.import_capture(path, tmp_path / "capture")


def test_recording_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"there is no none\.bag.*\.bag of a RealSense"):
        realsense.import_capture(tmp_path / "none.bag", tmp_path / "capture")


def test_real_open3d_refuses_what_is_no_recording(tmp_path):
    try:
        import open3d  # noqa: F401
    except (ImportError, OSError) as error:
        pytest.skip(f"Open3D cannot be imported here: {error}")
    (tmp_path / "garbage.bag").write_bytes(b"not a bag")
    with pytest.raises(InputError, match="cannot read|no RealSense reader"):
        realsense.import_capture(tmp_path / "garbage.bag", tmp_path / "capture")
