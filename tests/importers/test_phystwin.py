"""The PhysTwin layout, written here in small: two cameras above a table in a z-down world."""

import numpy as np
import pytest
from PIL import Image

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("cv2")

from data.importers.phystwin import import_capture
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.frames import read_frames
from pipeline.products.controllers import Controllers
from pipeline.products.given_tracks import GivenTracks2d, GivenTracks3d
from pipeline.products.truth import CaptureTruth
from tests.importers.phystwin_case import FRAMES, HEIGHT, VIEW, put_pickle, write_case


@pytest.fixture
def case(tmp_path):
    return write_case(tmp_path / "single_lift")


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


def test_everything_arrives_in_our_world(case, tmp_path):
    before, capture = contents(case), tmp_path / "sloth"
    import_capture(case, capture, camera=1, results="all")
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


def test_by_default_only_what_this_camera_saw(case, tmp_path):
    """Points in space and the hand's points come from all cameras; what the scores compare with comes all the same."""
    import_capture(case, tmp_path / "sloth", camera=1)
    assert GivenTracks2d.load(tmp_path / "sloth").visible.all() and (tmp_path / "sloth" / "masks").is_dir()
    assert not any((tmp_path / "sloth" / name).exists() for name in (GivenTracks3d.FILE, Controllers.FILE))
    assert CaptureTruth.load(tmp_path / "sloth").object_points.shape == (FRAMES, 3, 3)


def test_own_perception_when_asked_for(case, tmp_path):
    import_capture(case, tmp_path / "sloth", camera=1, results="none")
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
