"""Recordings with keys, shapes, counts, sizes or numbers that cannot be: the importer says which, and writes nothing."""

import json
import os
import shutil
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("cv2")

from data.importers import images, phystwin, realsense, silicone_beam
from data.importers.silicone_beam import MOUNTS
from pipeline.capture import read_capture
from tests.hard_use.refusals import refused
from tests.importers.phystwin_case import FRAMES, HEIGHT, WIDTH, final_data, put_json, put_pickle, write_case


def refuses(importer, source, place, *words, **options):
    """The importer refuses the recording, changes nothing in it and leaves nothing behind."""
    before = set(source.parent.rglob("*"))
    error = refused(lambda: importer.import_capture(source, place / "capture", **options), *words)
    assert not list(place.iterdir()), "something was left behind"
    assert set(source.parent.rglob("*")) == before
    return error


@pytest.fixture
def place(tmp_path):
    """Where captures are written."""
    (tmp_path / "captures").mkdir()
    return tmp_path / "captures"


# --- PhysTwin -----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="session")
def whole_case(tmp_path_factory):
    return write_case(tmp_path_factory.mktemp("phystwin") / "single_lift")


@pytest.fixture
def case(whole_case, tmp_path):
    return shutil.copytree(whole_case, tmp_path / "recordings" / "single_lift")


def test_a_whole_case_is_read(case, place):
    phystwin.import_capture(case, place / "capture", camera=1)
    assert read_capture(place / "capture").frame_count == FRAMES


def put_in(file, **changes):
    """A change of keys in a JSON file; None removes one."""

    def change(case):
        values = json.loads((case / file).read_text()) | changes
        put_json(case / file, {key: value for key, value in values.items() if value is not None})

    return change


K = [[40.0, 0, 16], [0, 40.0, 12], [0, 0, 1]]
METADATA = {
    "no WH": ({"WH": None}, "no key 'WH'"),
    "no intrinsics": ({"intrinsics": None}, "no key 'intrinsics'"),
    "no fps": ({"fps": None}, "no key 'fps'"),
    "one length": ({"WH": [WIDTH]}, "WH [px] has the shape [1]"),
    "lengths of words": ({"WH": ["32", "24"]}, "WH [px] holds no numbers"),
    "negative lengths": ({"WH": [-32, 24]}, "WH [px] = -32"),
    "broken pixels": ({"WH": [32.5, 24]}, "WH [px] = 32.5"),
    "another size": ({"WH": [64, 48]}, "32x24 pixels"),
    "lengths turned": ({"WH": [HEIGHT, WIDTH]}, "32x24 pixels"),
    "an infinite length": ({"WH": [float("inf"), 24]}, "WH [px] is inf"),
    "no rate": ({"fps": 0}, "fps = 0"),
    "a negative rate": ({"fps": -30}, "fps = -30"),
    "a rate that is none": ({"fps": float("nan")}, "fps is nan"),
    "a rate in words": ({"fps": "30"}, "fps holds no numbers"),
    "a rate that is true": ({"fps": True}, "fps holds no numbers"),
    "a list of rates": ({"fps": [30]}, "fps has the shape [1]"),
    "a rate beyond floats": ({"fps": 10**400}, "fps"),
    "one camera": ({"intrinsics": [K]}, "camera 1"),
    "intrinsics of words": ({"intrinsics": "none"}, "intrinsics"),
    "a matrix of 2x2": ({"intrinsics": [K, [[1, 0], [0, 1]]]}, "intrinsics[1] [px] has the shape [2, 2]"),
    "a ragged matrix": ({"intrinsics": [K, [[1, 0, 0], [0, 1], [0, 0, 1]]]}, "rows of different lengths"),
    "a matrix with a gap": ({"intrinsics": [K, [[1, 0, 0], [0, float("nan"), 0], [0, 0, 1]]]}, "is nan at [1, 1]"),
    "a matrix of null": ({"intrinsics": [K, None]}, "intrinsics[1] [px] holds no numbers"),
    "no frames": ({"frame_num": 0}, "frame_num = 0"),
    "frames in words": ({"frame_num": "all"}, "frame_num holds no numbers"),
    "fewer frames": ({"frame_num": 2}, f"points over {FRAMES} frames"),
}


@pytest.mark.parametrize(("changes", "words"), METADATA.values(), ids=METADATA.keys())
def test_metadata_that_cannot_be(case, place, changes, words):
    put_in("metadata.json", **changes)(case)
    where = () if words.endswith(("pixels", "frames")) else ("metadata.json",)
    if words.startswith("points over"):  # of the tracks, whichever comes first
        refused(lambda: phystwin.import_capture(case, place / "capture", camera=1), "[2, points, 2]")
        assert not list(place.iterdir())
    else:
        refuses(phystwin, case, place, words, *where, camera=1)


def without(file):
    return lambda case: (case / file).unlink()


def gap_in_colour(case):
    os.rename(case / "color" / "1" / "1.png", case / "color" / "1" / "9.png")


def truncate(file, share=0.5):
    return lambda case: (case / file).write_bytes(
        (case / file).read_bytes()[: int(share * (case / file).stat().st_size)]
    )


def image_at(file, shape, kind=np.uint8):
    return lambda case: Image.fromarray(np.zeros(shape, kind)).save(case / file)


def array_at(file, value):
    return lambda case: np.save(case / file, value)


def pipe_at(file):
    def change(case):
        (case / file).unlink()
        os.mkfifo(case / file)

    return change


FILES = {
    "no metadata": (without("metadata.json"), "there is no metadata.json"),
    "no poses": (without("calibrate.pkl"), "there is no calibrate.pkl"),
    "no images": (lambda case: shutil.rmtree(case / "color"), "no frames"),
    "no images of the camera": (lambda case: shutil.rmtree(case / "color" / "1"), "no frames"),
    "a frame is missing": (gap_in_colour, "there is no 1.png"),
    "a depth is missing": (without("depth/1/2.npy"), "there is no 2.npy"),
    "a mask is missing": (without("mask/1/1/3.png"), "there is no 3.png"),
    "metadata truncated": (truncate("metadata.json"), "not readable as JSON"),
    "metadata a list": (lambda case: put_json(case / "metadata.json", [1]), "the file holds a list"),
    "poses truncated": (truncate("calibrate.pkl"), "calibrate.pkl: not readable as a pickle"),
    "depth truncated": (truncate("depth/1/1.npy"), "1.npy"),
    "tracks truncated": (truncate("cotracker/1.npz"), "1.npz: not readable as .npz"),
    "mesh truncated": (truncate("shape/matching/final_mesh.glb"), "final_mesh.glb: no mesh can be read"),
    "final data truncated": (truncate("final_data.pkl"), "final_data.pkl: not readable as a pickle"),
    "colour a pipe": (pipe_at("color/1/0.png"), "0.png: it is a named pipe"),
    "depth a pipe": (pipe_at("depth/1/0.npy"), "0.npy: it is a named pipe"),
    "mask a pipe": (pipe_at("mask/1/1/0.png"), "0.png: it is a named pipe"),
    "metadata a pipe": (pipe_at("metadata.json"), "metadata.json: it is a named pipe"),
    "poses a pipe": (pipe_at("calibrate.pkl"), "calibrate.pkl: it is a named pipe"),
    "final data a pipe": (pipe_at("final_data.pkl"), "final_data.pkl: it is a named pipe"),
    "tracks a pipe": (pipe_at("cotracker/1.npz"), "1.npz: it is a named pipe"),
    "mesh a pipe": (pipe_at("shape/matching/final_mesh.glb"), "final_mesh.glb: it is a named pipe"),
    "a frame of another size": (image_at("color/1/2.png", (12, 16, 3)), "2.png: 16x12 pixels"),
    "a mask of another size": (image_at("mask/1/0/2.png", (12, 16)), "2.png: 16x12 pixels"),
    "a depth of another size": (array_at("depth/1/2.npy", np.ones((12, 16), np.uint16)), "2.npy: 16x12 pixels"),
    "a depth of three channels": (array_at("depth/1/2.npy", np.ones((24, 32, 3), np.uint16)), "depth of shape"),
    "a depth of complex numbers": (array_at("depth/1/2.npy", np.ones((24, 32), complex)), "depth of shape"),
    "a depth of words": (array_at("depth/1/2.npy", np.full((24, 32), "a")), "depth of shape"),
    "a colour of EPS": (lambda case: Image.new("RGB", (32, 24)).save(case / "color/1/1.png", "EPS"), "no PNG or JPEG"),
    "labels a list": (lambda case: put_json(case / "mask" / "mask_info_1.json", ["hand"]), "the file holds a list"),
    "a label that is no word": (put_in("mask/mask_info_1.json", **{"1": 7}), "label '1' is no string"),
    "a label that leads out": (put_in("mask/mask_info_1.json", **{"../../0": "x"}), "is no folder's name"),
    "a label without masks": (put_in("mask/mask_info_1.json", **{"2": "pig"}), "there is no 0.png"),
    "a split without a part": (put_in("split.json", test=None), "no key 'test'"),
    "a split of words": (put_in("split.json", train=["0", "3"]), "train holds no numbers"),
    "a split of three": (put_in("split.json", train=[0, 1, 3]), "train has the shape [3]"),
    "a split out of order": (put_in("split.json", train=[3, 0]), "split"),
    "no folder": (shutil.rmtree, "there is no such folder"),
}  # fmt: skip


@pytest.mark.parametrize(("change", "words"), FILES.values(), ids=FILES.keys())
def test_files_that_cannot_be(case, place, change, words):
    change(case)
    refuses(phystwin, case, place, words, camera=1)


POSES = {
    "an array of one pose": (np.eye(4), "the list of poses has the shape [4, 4]"),
    "poses of 3x4": ([np.eye(4)[:3]] * 2, "the list of poses has the shape [2, 3, 4]"),
    "poses of different shapes": ([np.eye(4), np.eye(3)], "rows of different lengths"),
    "one pose": ([np.eye(4)], "poses of 1 cameras"),
    "no poses": ([], "the list of poses"),
    "poses with a gap": ([np.eye(4), np.full((4, 4), np.nan)], "is nan at [1, 0, 0]"),
    "poses of words": ([[["a"] * 4] * 4] * 2, "holds no numbers"),
    "a dict": ({"0": np.eye(4)}, "holds no numbers"),
    "nothing": (None, "holds no numbers"),
    "a word": ("poses", "holds no numbers"),
}


@pytest.mark.parametrize(("value", "words"), POSES.values(), ids=POSES.keys())
def test_poses_that_cannot_be(case, place, value, words):
    put_pickle(case / "calibrate.pkl", value)
    refuses(phystwin, case, place, words, "calibrate.pkl", camera=1)


def replaced(key, value):
    return final_data() | {key: value(final_data()[key])}


def at(index, value):
    def change(array):
        array = np.array(array, float)
        array[index] = value
        return array

    return change


FINAL = {
    **{f"no {key}": ({k: v for k, v in final_data().items() if k != key}, f"no key {key!r}")
       for key in final_data() if key != "object_colors"},
    "a list": ([final_data()], "the pickle holds a list"),
    "nothing": (None, "the pickle holds a NoneType"),
    "points in two axes": (replaced("object_points", lambda a: a[0]), "object_points [m] has the shape [3, 3]"),
    "points in the plane": (replaced("object_points", lambda a: a[..., :2]), "object_points [m] has the shape"),
    "points of words": (replaced("object_points", lambda a: a.astype(str)), "object_points [m] holds no numbers"),
    "a seen point that is not finite": (replaced("object_points", at((1, 2, 0), np.nan)), "not finite at frame 1, point 2"),
    "an infinite point": (replaced("object_points", at((1, 2, 0), np.inf)), "object_points [m] is inf at [1, 2, 0]"),
    "visibilities of other points": (replaced("object_visibilities", lambda a: a[:, :2]), "object_visibilities has the shape"),
    "visibilities of fewer frames": (replaced("object_visibilities", lambda a: a[:2]), "object_visibilities has the shape"),
    "visibilities of words": (replaced("object_visibilities", lambda a: a.astype(str)), "object_visibilities holds no numbers"),
    "motions of fewer frames": (replaced("object_motions_valid", lambda a: a[:2]), "object_motions_valid has 2 frames"),
    "motions of other points": (replaced("object_motions_valid", lambda a: a[:, :1]), "object_motions_valid has the shape"),
    "a hand of fewer frames": (replaced("controller_points", lambda a: a[:2]), "controller_points [m] has the shape [2, 30, 3]"),
    "a hand in the plane": (replaced("controller_points", lambda a: a[..., :2]), "controller_points [m] has the shape"),
    "a hand with a gap": (replaced("controller_points", at((2, 4, 1), np.nan)), "controller_points [m] is nan at [2, 4, 1]"),
    "a hand of nothing": (replaced("controller_points", lambda a: None), "controller_points [m] holds no numbers"),
    "a surface in the plane": (replaced("surface_points", lambda a: a[:, :2]), "surface_points [m] has the shape"),
    "a surface with a gap": (replaced("surface_points", at((0, 0), np.nan)), "surface_points [m] is nan"),
    "an inside of words": (replaced("interior_points", lambda a: ["a", "b"]), "interior_points [m] holds no numbers"),
    "fewer frames than images": ({k: v[:3] if len(v) == FRAMES else v for k, v in final_data().items()}, "points over 3 frames"),
}  # fmt: skip


@pytest.mark.parametrize(("value", "words"), FINAL.values(), ids=FINAL.keys())
def test_final_data_that_cannot_be(case, place, value, words):
    put_pickle(case / "final_data.pkl", value)
    refuses(phystwin, case, place, words, "final_data.pkl", camera=1)


TRACKS = {
    "no tracks": ({"visibility": np.ones((FRAMES, 5))}, "no array 'tracks'"),
    "no visibility": ({"tracks": np.ones((FRAMES, 5, 2))}, "no array 'visibility'"),
    "tracks in space": ({"tracks": np.ones((FRAMES, 5, 3)), "visibility": np.ones((FRAMES, 5))}, "tracks [px] has the shape"),
    "tracks of fewer frames": ({"tracks": np.ones((2, 5, 2)), "visibility": np.ones((2, 5))}, "tracks [px] has the shape"),
    "two batches": ({"tracks": np.ones((2, FRAMES, 5, 2)), "visibility": np.ones((2, FRAMES, 5))}, "tracks [px] has the shape"),
    "visibility of others": ({"tracks": np.ones((FRAMES, 5, 2)), "visibility": np.ones((FRAMES, 4))}, "visibility has the shape"),
    "infinite tracks": ({"tracks": np.full((FRAMES, 5, 2), np.inf), "visibility": np.ones((FRAMES, 5))}, "tracks [px] is inf"),
    "objects": ({"tracks": np.array([None]), "visibility": np.ones(1)}, "an array of type object"),
}  # fmt: skip


@pytest.mark.parametrize(("arrays", "words"), TRACKS.values(), ids=TRACKS.keys())
def test_tracks_that_cannot_be(case, place, arrays, words):
    np.savez(case / "cotracker" / "1.npz", **arrays)
    refuses(phystwin, case, place, words, "1.npz", camera=1)


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (np.ones((FRAMES, 2)), "has the shape"),
        (np.full((FRAMES, 2, 3), np.inf), "is inf"),
        ({"a": 1}, "holds no numbers"),
    ],
)
def test_annotated_tracks_that_cannot_be(case, place, value, words):
    put_pickle(case / "gt_track_3d.pkl", value)
    refuses(phystwin, case, place, words, "annotated tracks", camera=1)


# --- folders of images --------------------------------------------------------------------------------------------

CAMERA = {"fx": 40.0, "fy": 41.0, "cx": 15.5, "cy": 11.5, "fps": 15}


@pytest.fixture
def recording(tmp_path):
    source = tmp_path / "recordings" / "mug"
    for name in ("color", "depth"):
        (source / name).mkdir(parents=True)
    for frame in range(3):
        Image.fromarray(np.full((24, 32, 3), frame, np.uint8)).save(source / "color" / f"{frame}.png")
        Image.fromarray(np.full((24, 32), 700, np.uint16)).save(source / "depth" / f"{frame}.png")
    (source / "camera.json").write_text(json.dumps(CAMERA))
    return source


CAMERAS = {
    "no key": ({"fx": None}, "no key 'fx'"),
    "a focal length in words": ({"fx": "40"}, "fx [px] holds no numbers"),
    "a focal length that is none": ({"fx": float("nan")}, "fx [px] is nan"),
    "an infinite focal length": ({"fy": float("inf")}, "fy [px] is inf"),
    "a list": ({"cx": [1, 2]}, "cx [px] has the shape [2]"),
    "a matrix of 2x2": ({"K": [[1, 0], [0, 1]]}, "K [px] has the shape [2, 2]"),
    "a ragged matrix": ({"K": [[1, 0, 0], [0, 1], [0, 0, 1]]}, "rows of different lengths"),
    "a matrix of words": ({"K": "eye"}, "K [px] holds no numbers"),
    "no rate": ({"fps": 0}, "fps = 0"),
    "a rate in words": ({"fps": "fast"}, "fps holds no numbers"),
    "another width": ({"width": 64}, "width = 64, but the images have 32"),
    "a height of half pixels": ({"height": 24.5}, "height = 24.5"),
    "a pose of 3x3": ({"T_world_camera": np.eye(3).tolist()}, "T_world_camera has the shape [3, 3]"),
    "a pose with a gap": ({"T_world_camera": [[float("nan")] * 4] * 4}, "T_world_camera is nan"),
    "a description of numbers": ({"description": 5}, "description is no string"),
    "a controller of lists": ({"controller": ["hand"]}, "controller is no string"),
}


@pytest.mark.parametrize(("changes", "words"), CAMERAS.values(), ids=CAMERAS.keys())
def test_cameras_that_cannot_be(recording, place, changes, words):
    put_in("camera.json", **changes)(recording)
    refuses(images, recording, place, words)


def double_number(recording):
    shutil.copy(recording / "color" / "1.png", recording / "color" / "left_1.png")


RECORDINGS = {
    "no camera": (without("camera.json"), "no intrinsics"),
    "a camera of lists": (lambda r: put_json(r / "camera.json", [CAMERA]), "the file holds a list"),
    "a camera truncated": (truncate("camera.json"), "not readable as JSON"),
    "a camera in a pipe": (pipe_at("camera.json"), "camera.json: it is a named pipe"),
    "no colour": (lambda r: shutil.rmtree(r / "color"), "no colour images"),
    "a depth too few": (without("depth/2.png"), "3 colour but 2 depth images"),
    "a depth too many": (lambda r: shutil.copy(r / "depth/1.png", r / "depth/7.png"), "3 colour but 4 depth images"),
    "one number twice": (double_number, "left_1.png: the frame number of 1.png, too"),
    "no number": (lambda r: os.rename(r / "color/1.png", r / "color/last.png"), "no frame number"),
    "a frame of another size": (image_at("color/2.png", (12, 16, 3)), "2.png: 16x12 pixels"),
    "a depth of another size": (image_at("depth/2.png", (12, 16), np.uint16), "2.png: 16x12 pixels"),
    "a depth in colour": (image_at("depth/2.png", (24, 32, 3)), "a depth image of mode RGB"),
    "a frame in a pipe": (pipe_at("color/2.png"), "2.png: it is a named pipe"),
    "a depth in a pipe": (pipe_at("depth/2.png"), "2.png: it is a named pipe"),
    "a frame truncated": (truncate("color/2.png"), "2.png: the image cannot be read"),
    "a depth truncated": (truncate("depth/2.png"), "2.png: the image cannot be read"),
    "a folder for a frame": (lambda r: ((r / "color/0.png").unlink(), (r / "color/0.png").mkdir()), "no colour images"),
    "no folder": (shutil.rmtree, "there is no such folder"),
}


@pytest.mark.parametrize(("change", "words"), RECORDINGS.values(), ids=RECORDINGS.keys())
def test_folders_of_images_that_cannot_be(recording, place, change, words):
    change(recording)
    refuses(images, recording, place, words)


@pytest.mark.parametrize("text", ["1 2 3", "1 2 3 4 5 6 7 8 x", "", "nan 0 1 0 1 1 0 0 1", "1 2 3\n4 5\n6 7 8"])
def test_intrinsics_in_text_that_cannot_be(recording, place, text):
    (recording / "camera.json").unlink()
    (recording / "intrinsics.txt").write_text(text)
    refuses(images, recording, place, "intrinsics.txt")


def test_a_file_for_a_folder(recording, place):
    refuses(images, recording / "camera.json", place, "it is no folder")


# --- the silicone beam --------------------------------------------------------------------------------------------


def beam_arrays():
    """Held for 20 frames, then a fall of the tip by 1 mm a frame, in the beam's own frame."""
    markers = np.repeat(MOUNTS[None] + [0, 0, 0.5], 60, axis=0)
    markers[20:, :3, 2] -= 0.001 * np.arange(1, 41)[:, None]
    return {"markers": markers, "fps": np.float64(100), "tip_load_newton": np.float64(0.5)}


@pytest.fixture
def beam(tmp_path):
    (tmp_path / "recordings").mkdir()
    trimesh.creation.box((30, 30, 100)).apply_translation([15, 15, 50]).export(tmp_path / "recordings" / "beam.stl")
    np.savez(tmp_path / "recordings" / "beam.npz", **beam_arrays())
    return tmp_path / "recordings" / "beam.npz"


BEAMS = {
    "no markers": ({"markers": None}, "no array 'markers'"),
    "no rate": ({"fps": None}, "no array 'fps'"),
    "a rate of zero": ({"fps": np.float64(0)}, "fps = 0"),
    "a rate that is none": ({"fps": np.float64("nan")}, "fps is nan"),
    "rates": ({"fps": np.ones(3)}, "fps has the shape [3]"),
    "a rate in words": ({"fps": np.array("100")}, "fps holds no numbers"),
    "a negative load": ({"tip_load_newton": np.float64(-1)}, "tip_load_newton = -1"),
    "an infinite load": ({"tip_load_newton": np.float64("inf")}, "tip_load_newton [N] is inf"),
    "five markers": ({"markers": beam_arrays()["markers"][:, :5]}, "markers [m] has the shape [60, 5, 3]"),
    "no frames": ({"markers": beam_arrays()["markers"][:0]}, "no frames"),
    "a gap": ({"markers": at((7, 1, 2), np.nan)(beam_arrays()["markers"])}, "markers [m] is nan at [7, 1, 2]"),
    "millimetres": ({"markers": 1000 * beam_arrays()["markers"]}, "the markers miss their mounts"),
    "never let go": ({"markers": beam_arrays()["markers"][:15]}, "never let go"),
    "objects": ({"markers": np.array([None])}, "an array of type object"),
}


@pytest.mark.parametrize(("changes", "words"), BEAMS.values(), ids=BEAMS.keys())
def test_beams_that_cannot_be(beam, place, changes, words):
    np.savez(beam, **{key: value for key, value in (beam_arrays() | changes).items() if value is not None})
    refuses(silicone_beam, beam, place, words, "beam.npz")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda beam: beam.unlink(), "there is no beam.npz"),
        (lambda beam: beam.write_bytes(beam.read_bytes()[:300]), "not readable as .npz"),
        (lambda beam: beam.with_name("beam.stl").unlink(), "there is no beam.stl"),
        (lambda beam: beam.with_name("beam.stl").write_bytes(b"solid nothing"), "beam.stl"),
        (lambda beam: (beam.unlink(), os.mkfifo(beam)), "it is a named pipe"),
    ],
)
def test_files_of_the_beam_that_cannot_be(beam, place, change, words):
    change(beam)
    refuses(silicone_beam, beam, place, words)


def test_a_beam_cut_too_short(beam, place):
    refuses(silicone_beam, beam, place, "1 frames from the release on", duration=0.01)


# --- RealSense ----------------------------------------------------------------------------------------------------


class Bag:
    """Open3D's reader, with what the case wants it to say."""

    def __init__(self, frames=2, colour=(24, 32, 3), depth=(24, 32, 1), **metadata):
        self.left, self.shapes = frames, (colour, depth)
        matrix = metadata.pop("matrix", np.array(K))
        known = {"fps": 30, "width": 32, "height": 24, "depth_scale": 1000.0} | metadata
        self.metadata = SimpleNamespace(intrinsics=SimpleNamespace(intrinsic_matrix=matrix), **known)

    def open(self, name):
        return True

    def is_eof(self):
        return self.left == 0

    def next_frame(self):
        self.left -= 1
        colour, depth = (np.full(shape, 5, np.uint8) for shape in self.shapes)
        return SimpleNamespace(color=colour, depth=depth.astype(np.uint16), is_empty=lambda: False)

    def close(self):
        pass


BAGS = {
    "no frame": (Bag(frames=0), "holds no frame"),
    "no rate": (Bag(fps=0), "fps = 0"),
    "an infinite rate": (Bag(fps=float("inf")), "fps is inf"),
    "no width": (Bag(width=0), "width = 0"),
    "no scale": (Bag(depth_scale=0.0), "depth_scale [counts per m] = 0"),
    "a scale that is none": (Bag(depth_scale=float("nan")), "depth_scale [counts per m] is nan"),
    "a matrix of 2x2": (Bag(matrix=np.eye(2)), "intrinsics [px] has the shape [2, 2]"),
    "a matrix with a gap": (Bag(matrix=np.full((3, 3), np.nan)), "intrinsics [px] is nan"),
    "grey": (Bag(colour=(24, 32, 1)), "colour of shape (24, 32, 1)"),
    "no depth": (Bag(depth=(0,)), "depth of shape (0,)"),
    "depth of another size": (Bag(depth=(12, 16, 1)), "depth of shape (12, 16, 1)"),
}


@pytest.mark.parametrize(("bag", "words"), BAGS.values(), ids=BAGS.keys())
def test_bags_that_cannot_be(monkeypatch, tmp_path, place, bag, words):
    (tmp_path / "recordings").mkdir()
    (tmp_path / "recordings" / "clip.bag").write_bytes(b"#ROSBAG V2.0\n")
    io = SimpleNamespace(RSBagReader=lambda: bag)
    monkeypatch.setitem(sys.modules, "open3d", SimpleNamespace(t=SimpleNamespace(io=io)))
    refuses(realsense, tmp_path / "recordings" / "clip.bag", place, words, "clip.bag")


@pytest.mark.parametrize(
    "kind", [lambda path: None, os.mkfifo, lambda path: path.mkdir(), lambda path: path.symlink_to("/dev/zero")]
)
def test_a_bag_that_is_no_file(tmp_path, place, kind):
    (tmp_path / "recordings").mkdir()
    kind(tmp_path / "recordings" / "clip.bag")
    refuses(realsense, tmp_path / "recordings" / "clip.bag", place, "clip.bag")
