"""The silicone beam: frames of reference, the release, what is known of the set-up."""

import numpy as np
import pytest

trimesh = pytest.importorskip("trimesh")

from data.importers.silicone_beam import AXIS_HEIGHT, MOUNTS, import_capture
from data.rig.raycast import Raycaster
from physreal_core.errors import InputError
from pipeline.capture import read_capture
from pipeline.check import check_capture
from pipeline.products.given_tracks import GivenTracks3d

TILT = np.radians(6.6)
RECORDED = np.array(
    [[np.sin(TILT), 0, np.cos(TILT)], [0, -1, 0], [np.cos(TILT), 0, -np.sin(TILT)]]
)  # beam to recording


@pytest.fixture
def recording(tmp_path):
    """Held for 20 frames, then a fall of the tip by 1 mm a frame."""
    markers = np.repeat(MOUNTS[None], 60, axis=0)
    markers[20:, :3, 2] -= 0.001 * np.arange(1, 41)[:, None]
    trimesh.creation.box((30, 30, 100)).apply_translation([15, 15, 50]).export(tmp_path / "beam.stl")
    path = tmp_path / "made_up.npz"
    np.savez(path, markers=markers @ RECORDED.T + [0.05, 0.03, 0.0], fps=100.0, tip_load_newton=0.5)
    return path


def test_recording_is_turned_into_the_beams_frame(recording, tmp_path):
    import_capture(recording, tmp_path / "beam", duration=0.3, split=0.5)
    capture = read_capture(tmp_path / "beam")
    tracks = GivenTracks3d.load(tmp_path / "beam")
    points = tracks.points3d
    assert tracks.valid3d.all() and (tracks.sigma3d > 0).all()
    assert points.shape == (30, 3, 3) and capture.split.train == (0, 15)
    np.testing.assert_allclose(points[0], MOUNTS[:3] + [0, 0, AXIS_HEIGHT], atol=1e-6)
    np.testing.assert_allclose(points[5] - points[0], [[0, 0, -0.005]] * 3, atol=1e-6)
    assert capture.notes["release_frame"] == 19 and capture.density == 1070
    mesh = trimesh.load(tmp_path / "beam" / "shape_prior.glb", force="mesh")
    np.testing.assert_allclose(mesh.bounds, [[0, -0.015, 0.485], [0.1, 0.015, 0.515]], atol=1e-6)
    assert mesh.volume == pytest.approx(9e-5)
    (clamp,), (payload,) = capture.clamps, capture.payloads
    assert clamp.upper[0] == 0 and clamp.lower[0] < 0
    assert payload.mass == pytest.approx(0.5 / 9.81) and not payload.force.any()
    np.testing.assert_allclose(payload.point, [0.1, 0, 0.515])


def test_faults_are_named(recording, tmp_path):
    with pytest.raises(InputError, match="there is no none"):
        import_capture(tmp_path / "none.npz", tmp_path / "beam")
    arrays = dict(np.load(recording))
    np.savez(recording, **(arrays | {"markers": arrays["markers"][:15]}))
    with pytest.raises(InputError, match="never let go"):
        import_capture(recording, tmp_path / "beam")
    np.savez(recording, **(arrays | {"markers": arrays["markers"][:, ::-1]}))
    with pytest.raises(InputError, match="miss their mounts"):
        import_capture(recording, tmp_path / "beam")
    np.savez(recording, markers=arrays["markers"])
    with pytest.raises(InputError, match="no array 'fps'"):
        import_capture(recording, tmp_path / "beam")


@pytest.mark.parametrize(("name", "load", "sag"), [("gravity_V2_a", 0.0, 6.4), ("load52_V2_a", 0.51012, 17.0)])
def test_real_recordings(real_data, tmp_path, name, load, sag):
    import_capture(real_data / "silicone_beam" / f"{name}.npz", tmp_path / "beam")
    capture = read_capture(tmp_path / "beam")
    assert "200 frames of tracked points" in check_capture(tmp_path / "beam")
    assert sum(9.81 * payload.mass for payload in capture.payloads) == pytest.approx(load)
    assert capture.notes["marker_misfit_m"] < 0.0012
    assert 1000 * -capture.notes["static_tip_displacement_m"][2] == pytest.approx(sag, abs=0.5)
    mesh = trimesh.load(tmp_path / "beam" / "shape_prior.glb", force="mesh")
    assert mesh.is_watertight
    points = GivenTracks3d.load(tmp_path / "beam").points3d
    # The balls' centres stand 6 mm off the beam's surface.
    distance = Raycaster(np.asarray(mesh.vertices), np.asarray(mesh.faces)).closest(points[0]).distance
    np.testing.assert_allclose(distance, 0.006, atol=0.001)
    # Straight at the start, falling from the next frame on: 0.5 g dt^2 is 0.5 mm, a released beam's tip falls faster.
    fall = (points[0] - points)[:, :, 2].mean(axis=1)
    assert fall[1] < 0.002 < fall[4]
