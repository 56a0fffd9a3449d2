"""build_object → fit_pose → sample_particles on a tiny capture of known pose: from a prior, from the view, from tracks."""

import json
from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh, Similarity, load_mesh, pose_error, save_mesh
from physreal_core.rendering import load_gaussians, save_gaussians
from pipeline.config.build_object import BuildObject
from pipeline.config.fit_pose import FitPose
from pipeline.config.sample_particles import SampleParticles
from stages import build_object, fit_pose, sample_particles
from tests.geometry.scenes import blob, ellipsoid, look_at

cv2 = pytest.importorskip("cv2")
pytest.importorskip("manifold3d")
pytest.importorskip("skimage")


class Context:
    """What a stage is given, on folders of its own."""

    sequence, seed = "tiny", 0

    def __init__(self, root: Path, stage: str, params) -> None:
        self.root, self.params, self.capture, self.output = root, params, root / "capture", root / stage
        self.output.mkdir()

    def input(self, stage: str) -> Path:
        return self.root / stage

    @contextmanager
    def progress(self, description, total):
        yield SimpleNamespace(advance=lambda n=1, note="": None)

    def timed(self, label):
        return nullcontext()


def write_capture(root: Path, mesh: Mesh | None, **facts) -> Path:
    """Frame 0 of `mesh` (or a tracks-only capture), as parse_video and segment_and_track write it."""
    for folder in ("capture", "parse_video", "segment_and_track"):
        (root / folder).mkdir()
    record = {"kind": "video" if mesh else "tracks", "fps": 30, **facts}
    if mesh is not None:
        seen = look_at(mesh)
        view = {"width": seen.camera.width, "height": seen.camera.height, "K": seen.camera.K.tolist()}
        record |= {**view, "T_world_camera": seen.camera.T_world_camera.tolist()}
        for name, image in {
            "parse_video/color": (seen.rgb[..., ::-1] * 255).round().astype(np.uint8),
            "parse_video/depth": (seen.depth * 1000).round().astype(np.uint16),
            "segment_and_track/masks/object": seen.mask.astype(np.uint8) * 255,
        }.items():
            (root / name).mkdir(parents=True)
            cv2.imwrite(str(root / name / "000000.png"), image)
        points = seen.points()[::20]
    else:
        points = np.array([[0.08, 0, 0.03], [0, 0.05, 0.03], [0, 0, 0.2], [np.nan] * 3])
    (root / "parse_video/capture.json").write_text(json.dumps(record))
    (root / "parse_video/camera.json").write_text(json.dumps(record))
    valid = np.isfinite(points).all(axis=1)
    np.savez(root / "segment_and_track/tracks.npz", points3d=points[None].astype(np.float32), valid3d=valid[None])
    hand = points[valid][:3] + [0, 0, 0.005] if mesh is not None else np.zeros((0, 3))
    np.savez(root / "segment_and_track/controllers.npz", points=hand[None].astype(np.float32))
    return root


def run_all(root: Path, build=None, pose=None, particles=None) -> dict:
    build_object.run(Context(root, "build_object", build or BuildObject(gaussians=800)))
    fit_pose.run(Context(root, "fit_pose", pose or FitPose()))
    sample_particles.run(Context(root, "sample_particles", particles or SampleParticles(density=200)))
    return dict(np.load(root / "sample_particles/particles.npz"))


def check_particles(arrays: dict, mesh: Mesh) -> None:
    count = len(arrays["x0"])
    assert arrays["volume"].sum() == pytest.approx(mesh.volume, rel=0.01)
    for name in ("patch", "gaussian", "track"):
        np.testing.assert_allclose(arrays[f"{name}_weights"].sum(axis=1), 1, atol=1e-5)
    assert arrays["gaussian_neighbours"].max() < count and arrays["patches"].max() < count
    assert {a.dtype for a in arrays.values()} <= {np.dtype("float32"), np.dtype("int32")}


def test_from_a_prior_in_another_pose(tmp_path):
    body = blob()
    root = write_capture(tmp_path, body, density=150)
    away = Similarity(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([1.0, 2, 3]), 4.0)
    save_mesh(root / "capture/shape_prior.glb", body.transformed(away.matrix))
    short = FitPose(
        restarts=1, generations=50, candidates=1, coarse_iterations=50, fine_iterations=30, surface_points=1500
    )
    arrays = run_all(root, pose=short)
    pose = json.loads((root / "fit_pose/pose.json").read_text())
    found = Similarity.from_matrix(np.array(pose["T_world_prior"]))
    true = Similarity.from_matrix(np.linalg.inv(away.matrix))
    turn, shift, scale = pose_error(found, true, away.apply(body.centroid))
    assert turn < 3 and shift < 0.005 and scale < 0.02
    check_particles(arrays, load_mesh(root / "fit_pose/mesh.glb"))
    assert (arrays["density"] == 150).all()
    assert len(arrays["track_ids"]) > 20 and len(arrays["grip_weights"]) > 0
    assert pose["iou_frame0"] > 0.8
    assert len(load_gaussians(root / "fit_pose/gaussians.ply")) == 800
    assert cv2.imread(str(root / "fit_pose/overlay.png")).shape == (360, 480, 3)
    facts = json.loads((root / "build_object/object.json").read_text())
    assert facts["watertight"] and max(facts["extents"]) == pytest.approx(1)


def test_built_from_the_view_stays_in_the_world(tmp_path):
    body = ellipsoid()
    arrays = run_all(write_capture(tmp_path, body))
    check_particles(arrays, load_mesh(tmp_path / "fit_pose/mesh.glb"))
    assert arrays["volume"].sum() == pytest.approx(body.volume, rel=0.15)
    centre = (arrays["x0"] * arrays["volume"][:, None]).sum(axis=0) / arrays["volume"].sum()
    np.testing.assert_allclose(centre, body.centroid, atol=0.006)
    assert (arrays["density"] == 200).all()


def test_tracks_alone_take_the_known_pose(tmp_path):
    body = ellipsoid()
    T = np.eye(4)
    T[:3, 3] = 0.5, 0, -1
    root = write_capture(tmp_path, None, T_world_object=T.tolist())
    save_mesh(root / "capture/shape_prior.glb", body.transformed(np.linalg.inv(T)))
    arrays = run_all(root)
    check_particles(arrays, load_mesh(root / "fit_pose/mesh.glb"))
    np.testing.assert_allclose(load_mesh(root / "fit_pose/mesh.glb").centroid, body.centroid, atol=1e-5)
    assert arrays["track_ids"].tolist() == [0, 1]  # the third is far off, the fourth unknown
    assert len(arrays["grip_weights"]) == 0
    assert not (root / "fit_pose/overlay.png").exists()


def test_prior_of_gaussians_alone(tmp_path):
    from physreal_core.geometry import sample_surface, surface_gaussians

    body = ellipsoid()
    root = write_capture(tmp_path, None)
    green = np.tile([0.2, 0.8, 0.1], (len(body.vertices), 1))
    gaussians = surface_gaussians(sample_surface(Mesh(body.vertices, body.faces, green), 3000))
    save_gaussians(root / "capture/shape_prior.ply", gaussians)
    build_object.run(Context(root, "build_object", BuildObject(voxels_across=40)))
    fit_pose.run(Context(root, "fit_pose", FitPose()))
    assert np.abs(load_mesh(root / "fit_pose/mesh.glb").colours - [0.2, 0.8, 0.1]).max() < 0.01
    assert load_mesh(root / "fit_pose/mesh.glb").volume == pytest.approx(body.volume, rel=0.06)
    means = load_gaussians(root / "fit_pose/gaussians.ply").means.numpy()
    np.testing.assert_allclose([means.min(0), means.max(0)], body.bounds, atol=0.002)


def test_open_prior_is_refused_and_closed_on_request(tmp_path):
    body = ellipsoid()
    root = write_capture(tmp_path, None)
    save_mesh(root / "capture/shape_prior.glb", Mesh(body.vertices, body.faces[20:]))
    with pytest.raises(InputError, match="shape_prior.glb: mesh is not closed: [0-9]+ open edges.*close_holes"):
        build_object.run(Context(root, "build_object", BuildObject()))
    (root / "again").mkdir()
    context = Context(root, "closed", BuildObject(close_holes=True, gaussians=200))
    build_object.run(context)
    assert json.loads((context.output / "object.json").read_text())["watertight"]


def test_tracks_without_a_shape_are_refused(tmp_path):
    root = write_capture(tmp_path, None)
    with pytest.raises(InputError, match="needs a shape"):
        build_object.run(Context(root, "build_object", BuildObject()))
