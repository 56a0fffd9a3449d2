"""build_object → fit_pose → sample_particles on a tiny capture of known pose: from a prior, from the view, from tracks."""

from contextlib import contextmanager, nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.geometry import Mesh, Similarity, pose_error, save_mesh
from physreal_core.rendering import save_gaussians
from pipeline import capture as capture_files
from pipeline.capture import capture_of
from pipeline.config.build_object import BuildObject
from pipeline.config.fit_pose import FitPose
from pipeline.config.sample_particles import SampleParticles
from pipeline.products.built_object import read_facts
from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.tracks import MeasuredTracks
from stages import build_object, fit_pose, sample_particles
from tests.geometry.scenes import blob, ellipsoid, look_at

cv2 = pytest.importorskip("cv2")
pytest.importorskip("manifold3d")
pytest.importorskip("skimage")


class Context:
    """What a stage is given, on folders of its own."""

    sequence, seed, geometry = "tiny", 0, "volumetric"

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
        colour, depth = (seen.rgb * 255).round().astype(np.uint8), (seen.depth * 1000).round().astype(np.uint16)
        FrameImages(root / "parse_video").save(0, colour, depth)
        Masks(seen.mask[None], np.zeros_like(seen.mask)[None]).save(root / "segment_and_track")
        points = seen.points()[::20]
    else:
        points = np.array([[0.08, 0, 0.03], [0, 0.05, 0.03], [0, 0, 0.2], [np.nan] * 3])
    capture = capture_of(record)
    capture_files.write_capture(root / "parse_video", capture)
    view = capture.fps, capture.width, capture.height, capture.K, capture.T_world_camera
    RecordedCamera(*view, frame_count=1).save(root / "parse_video")
    valid = np.isfinite(points).all(axis=1)
    pixels, sigma = np.full((1, len(points), 2), np.nan), np.full((1, len(points)), 0.001)
    MeasuredTracks(pixels, valid[None], points[None], valid[None], sigma).save(root / "segment_and_track")
    hand = points[valid][:3] + [0, 0, 0.005] if mesh is not None else np.zeros((0, 3))
    Controllers(hand[None]).save(root / "segment_and_track")
    return root


def run_all(root: Path, build=None, pose=None, particles=None) -> Particles:
    build_object.run(Context(root, "build_object", build or BuildObject(gaussians=800)))
    fit_pose.run(Context(root, "fit_pose", pose or FitPose()))
    sample_particles.run(Context(root, "sample_particles", particles or SampleParticles(density=200)))
    return Particles.load(root / "sample_particles")


def check_particles(found: Particles, mesh: Mesh) -> None:
    count = len(found.x0)
    assert found.volume.sum() == pytest.approx(mesh.volume, rel=0.01)
    for weights in (found.patch_weights, found.gaussian_weights, found.track_weights):
        np.testing.assert_allclose(weights.sum(axis=1), 1, atol=1e-5)
    assert found.gaussian_neighbours.max() < count and found.patches.max() < count
    arrays = [value for value in vars(found).values() if isinstance(value, np.ndarray)]
    assert {a.dtype for a in arrays} <= {np.dtype("float32"), np.dtype("int32")}


def test_from_a_prior_in_another_pose(tmp_path):
    body = blob()
    root = write_capture(tmp_path, body, density=150)
    away = Similarity(np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]), np.array([1.0, 2, 3]), 4.0)
    save_mesh(root / "capture/shape_prior.glb", body.transformed(away.matrix))
    short = FitPose(
        restarts=1, generations=50, candidates=1, coarse_iterations=50, fine_iterations=30, surface_points=1500
    )
    particles = run_all(root, pose=short)
    placed = PlacedObject.load(root / "fit_pose")
    found = Similarity.from_matrix(placed.T_world_prior)
    true = Similarity.from_matrix(np.linalg.inv(away.matrix))
    turn, shift, scale = pose_error(found, true, away.apply(body.centroid))
    assert turn < 3 and shift < 0.005 and scale < 0.02
    check_particles(particles, placed.mesh)
    assert (particles.density == 150).all()
    assert particles.unseen is None and not placed.far_side_guessed
    assert len(particles.track_ids) > 20 and len(particles.grip_weights) > 0
    assert placed.notes["iou_frame0"] > 0.8
    assert len(placed.gaussians) == 800
    assert cv2.imread(str(root / "fit_pose/overlay.png")).shape == (360, 480, 3)
    facts = read_facts(root / "build_object")
    assert facts["watertight"] and max(facts["extents"]) == pytest.approx(1)


def test_built_from_the_view_stays_in_the_world(tmp_path):
    body = ellipsoid()
    particles = run_all(write_capture(tmp_path, body))
    check_particles(particles, PlacedObject.load(tmp_path / "fit_pose").mesh)
    assert particles.volume.sum() == pytest.approx(body.volume, rel=0.15)
    centre = (particles.x0 * particles.volume[:, None]).sum(axis=0) / particles.volume.sum()
    np.testing.assert_allclose(centre, body.centroid, atol=0.006)
    assert (particles.density == 200).all()
    assert PlacedObject.load(tmp_path / "fit_pose").far_side_guessed
    assert particles.unseen.min() == 0.0 and particles.unseen.max() == 1.0


def test_tracks_alone_take_the_known_pose(tmp_path):
    body = ellipsoid()
    T = np.eye(4)
    T[:3, 3] = 0.5, 0, -1
    root = write_capture(tmp_path, None, T_world_object=T.tolist())
    save_mesh(root / "capture/shape_prior.glb", body.transformed(np.linalg.inv(T)))
    particles, placed = run_all(root), PlacedObject.load(root / "fit_pose")
    check_particles(particles, placed.mesh)
    np.testing.assert_allclose(placed.mesh.centroid, body.centroid, atol=1e-5)
    assert particles.track_ids.tolist() == [0, 1]  # the third is far off, the fourth unknown
    assert len(particles.grip_weights) == 0
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
    placed = PlacedObject.load(root / "fit_pose")
    assert np.abs(placed.mesh.colours - [0.2, 0.8, 0.1]).max() < 0.01
    assert placed.mesh.volume == pytest.approx(body.volume, rel=0.06)
    means = placed.gaussians.means.numpy()
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
    assert read_facts(context.output)["watertight"]


def test_tracks_without_a_shape_are_refused(tmp_path):
    root = write_capture(tmp_path, None)
    with pytest.raises(InputError, match="needs a shape"):
        build_object.run(Context(root, "build_object", BuildObject()))


def test_a_controller_that_pushes_holds_nothing_or_holds_too(tmp_path):
    body = ellipsoid()
    root = write_capture(tmp_path, None, holds=[[0, None]])
    save_mesh(root / "capture/shape_prior.glb", body)
    high = float(body.vertices[:, 2].max())
    points = np.array([[0.0, 0.0, high + 0.015], [0.0, 0.0, high + 0.1]])[None] - np.linspace(0, 0.02, 3)[:, None, None]
    Controllers(points, np.array([[0, 1]]), np.array([0.012])).save(root / "segment_and_track")
    build_object.run(Context(root, "build_object", BuildObject(gaussians=200)))
    fit_pose.run(Context(root, "fit_pose", FitPose()))

    def sampled(name, **grip):
        context = Context(root, name, SampleParticles(grip={"radius": 0.025, **grip}))
        sample_particles.run(context)
        return Particles.load(context.output)

    with pytest.raises(InputError, match=r"capture.json, holds.*shall only push.*hold_and_push"):
        sampled("refused", contact="push")
    both = sampled("both", contact="hold_and_push")
    assert both.tool_ends.tolist() == [[0, 1]] and both.tool_radius[0] == pytest.approx(0.012)
    assert both.pushed and set(both.tool_spared) == set(both.grip_particles) and len(both.tool_spared)
    held = sampled("held")
    assert not held.pushed and held.tool_ends is None and held.grip_particles.tolist() == both.grip_particles.tolist()
    capture_files.write_capture(root / "parse_video", capture_of({"kind": "tracks", "fps": 30}))
    push = sampled("push", contact="push")
    assert len(push.grip_particles) == 0 and push.tool_spared is None
    assert push.tool_radius[0] == pytest.approx(0.012)
    Controllers(points).save(root / "segment_and_track")
    assert sampled("seen", contact="push", push_radius=0.01).tool_radius[0] == pytest.approx(0.01)
