"""The PhysTwin layout, written here in small: two cameras above a table in a z-down world."""

import json
import pickle

import numpy as np
import pytest
from PIL import Image

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("cv2")

from data.importers.phystwin import import_capture
from data.rig.rig_scene import View
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.frames import read_frames
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.truth import CaptureTruth

FRAMES, WIDTH, HEIGHT = 4, 32, 24
DOWN = np.diag([1.0, -1.0, -1.0, 1.0])  # our world to theirs
VIEW = View(focal=40.0, width=WIDTH, height=HEIGHT)


@pytest.fixture
def case(tmp_path):
    folder, random = tmp_path / "single_lift", np.random.default_rng(0)
    poses = [np.eye(4), DOWN @ VIEW.pose()]
    matrices = [np.eye(3).tolist(), VIEW.intrinsics().tolist()]
    metadata = {
        "intrinsics": matrices,
        "WH": [WIDTH, HEIGHT],
        "fps": 30,
        "frame_num": FRAMES,
        "serial_numbers": ["a", "b"],
    }
    put_json(folder / "metadata.json", metadata)
    put_json(folder / "split.json", {"frame_len": FRAMES, "train": [0, 3], "test": [3, 4]})
    put_json(folder / "mask" / "mask_info_1.json", {"0": "hand", "1": "sloth"})
    put_pickle(folder / "calibrate.pkl", poses)
    for frame in range(FRAMES):
        put_image(folder / "color" / "1" / f"{frame}.png", random.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8))
        depth = np.full((HEIGHT, WIDTH), 700 + frame, np.uint16)
        (folder / "depth" / "1").mkdir(parents=True, exist_ok=True)
        np.save(folder / "depth" / "1" / f"{frame}.npy", depth)
        for key, columns in (("0", slice(0, 8)), ("1", slice(10, 20))):
            mask = np.zeros((HEIGHT, WIDTH), np.uint8)
            mask[:, columns] = 255
            put_image(folder / "mask" / "1" / key / f"{frame}.png", mask)
    tracks = np.stack([np.full((FRAMES, 5), 3.0), np.full((FRAMES, 5), 17.0)], axis=-1)  # (row, column)
    (folder / "cotracker").mkdir()
    np.savez(folder / "cotracker" / "1.npz", tracks=tracks, visibility=np.ones((FRAMES, 5), bool))
    put_pickle(folder / "final_data.pkl", final_data())
    put_pickle(folder / "gt_track_3d.pkl", np.full((FRAMES, 2, 3), [0.1, 0.2, -0.3]))
    (folder / "shape" / "matching").mkdir(parents=True)
    box = trimesh.creation.box((0.1, 0.1, 0.04))
    box.apply_translation([0, 0, -0.02])  # on their table, above it
    box.export(folder / "shape" / "matching" / "final_mesh.glb")
    return folder


def final_data():
    points = np.full((FRAMES, 3, 3), [0.1, 0.2, -0.3])
    visible = np.ones((FRAMES, 3), bool)
    points[2, 1], visible[2, 1] = 0, False
    return {
        "object_points": points,
        "object_colors": np.zeros_like(points),
        "object_visibilities": visible,
        "object_motions_valid": visible.copy(),
        "controller_points": np.full((FRAMES, 30, 3), [0.0, 0.1, -0.2]),
        "surface_points": np.array([[0.0, 0.0, -0.04]]),
        "interior_points": np.zeros((0, 3)),
    }


def put_json(path, value):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(value))


def put_pickle(path, value):
    with path.open("wb") as file:
        pickle.dump(value, file)


def put_image(path, image):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(image).save(path)


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_everything_arrives_in_our_world(case, tmp_path):
    before, capture = contents(case), tmp_path / "sloth"
    import_capture(case, capture, camera=1)
    assert contents(case) == before
    described = read_capture(capture)
    assert described.description == "a sloth" and described.split.train == (0, 3)
    np.testing.assert_allclose(described.K, VIEW.intrinsics())
    np.testing.assert_allclose(described.T_world_camera, VIEW.pose(), atol=1e-12)
    frames = list(read_frames(capture, described, (0.1, 8.0)))
    assert [int(depth[0, 0]) for _, depth in frames] == [700, 701, 702, 703]
    np.testing.assert_array_equal(frames[2][0], np.asarray(Image.open(case / "color" / "1" / "2.png")))

    tracks2d = GivenTracks2d.load(capture)
    np.testing.assert_array_equal(tracks2d.points2d[0, 0], [17, 3])  # (u, v)
    tracks3d = GivenTracks3d.load(capture)
    np.testing.assert_allclose(tracks3d.points3d[0, 0], [0.1, -0.2, 0.3], rtol=1e-6)
    assert np.isnan(tracks3d.points3d[2, 1]).all() and not tracks3d.valid3d[2, 1]
    assert tracks3d.valid3d.sum() == 3 * FRAMES - 1
    np.testing.assert_allclose(Controllers.load(capture).points[0, 0], [0.0, -0.1, 0.2], atol=1e-7)
    truth = CaptureTruth.load(capture)
    np.testing.assert_allclose(truth.gt_track_3d[0, 0], [0.1, -0.2, 0.3])

    mesh = trimesh.load(capture / "shape_prior.glb", force="mesh")
    np.testing.assert_allclose(mesh.bounds[:, 2], [0, 0.04], atol=1e-6)
    assert mesh.volume > 0
    masks = {role: np.asarray(Image.open(capture / "masks" / role / "000001.png")) for role in ("object", "controller")}
    assert (masks["controller"][:, :8] == 255).all() and not masks["controller"][:, 8:].any()
    assert (masks["object"][:, 10:20] == 255).all() and masks["object"].sum() == 255 * 10 * HEIGHT


def test_own_perception_when_asked_for(case, tmp_path):
    import_capture(case, tmp_path / "sloth", camera=1, results=False)
    assert not (tmp_path / "sloth" / "masks").exists()
    assert not list((tmp_path / "sloth").glob("*tracks*")) and not (tmp_path / "sloth" / Controllers.FILE).exists()


def test_pickle_with_code_is_refused_and_leaves_nothing(case, tmp_path):
    class Evil:
        def __reduce__(self):
            return print, ("ran",)

    put_pickle(case / "calibrate.pkl", [Evil()])
    with pytest.raises(InputError, match=r"calibrate\.pkl.*builtins\.print"):
        import_capture(case, tmp_path / "sloth", camera=1)
    assert not (tmp_path / "sloth").exists() and not (tmp_path / "sloth.partial").exists()


@pytest.mark.parametrize("name", ["metadata.json", "color/1/2.png", "depth/1/3.npy", "mask/1/0/1.png", "calibrate.pkl"])
def test_missing_file_is_named(case, tmp_path, name):
    (case / name).unlink()
    if name == "color/1/2.png":  # a gap in the numbers, not a shorter clip
        (case / "color" / "1" / "4.png").write_bytes((case / "color" / "1" / "0.png").read_bytes())
    with pytest.raises(InputError, match=name.rsplit("/", 1)[-1]):
        import_capture(case, tmp_path / "sloth", camera=1)


def test_truncated_mask_is_named(case, tmp_path):
    path = case / "mask" / "1" / "0" / "1.png"
    path.write_bytes(path.read_bytes()[:40])
    with pytest.raises(InputError, match=r"mask.*1\.png"):
        import_capture(case, tmp_path / "sloth", camera=1)


def test_camera_that_does_not_exist(case, tmp_path):
    with pytest.raises(InputError, match="camera 2"):
        import_capture(case, tmp_path / "sloth", camera=2)
