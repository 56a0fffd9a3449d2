"""Stage evaluate on a synthetic sequence whose scores are known: a box that is lifted and shears under its weight."""

from __future__ import annotations

import csv
import json
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from physreal_core.errors import InputError
from physreal_core.fitting.model import save_model, uniform_model
from physreal_core.rendering import Camera, Gaussians, bind, render_carried
from pipeline.products.camera import RecordedCamera
from pipeline.products.controllers import Controllers
from pipeline.products.free_end import FreeEnd
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks
from pipeline.products.particles import Particles
from pipeline.products.placed_object import PlacedObject
from pipeline.products.rollout import Rollout
from pipeline.products.scores import Scores
from pipeline.products.tracks import MeasuredTracks
from pipeline.products.truth import CaptureTruth

FRAMES, OBSERVED, LIFT, SHEAR = 6, 4, 0.01, 0.04
SHIFT = np.array([0.005, 0.0, 0.0])
CAMERA = {"fps": 30.0, "width": 80, "height": 60, "K": [[90.0, 0, 39.5], [0, 90.0, 29.5], [0, 0, 1.0]]}


def _motion(shear: float, shift: tuple[float, ...] | np.ndarray = (0.0, 0.0, 0.0)):
    """x [T, N, 3] and F [T, 3, 3] of points: every frame LIFT higher, hanging by shear * (distance from x = 0)."""
    F = np.tile(np.eye(3), (FRAMES, 1, 1))
    F[:, 2, 0] = -shear * np.arange(FRAMES) / (FRAMES - 1)
    up = np.arange(FRAMES)[:, None] * [0, 0, LIFT] + np.where(np.arange(FRAMES)[:, None] > 0, shift, 0.0)
    return lambda points: np.einsum("tij,nj->tni", F, points) + up[:, None], F


class Context:
    """What the stage asks of its context, over folders made here."""

    def __init__(self, root: Path) -> None:
        from pipeline.config.evaluate import Evaluate

        self.root, self.capture, self.output, self.seed = root, root / "capture", root / "out", 0
        self.params = Evaluate(surface_points=400, settled_frames=1, min_sag=1e-4, swing_frames=5)
        self.fitted = {"fit_global": root / "fit_global", "fit_patches": root / "fit_patches"}
        self.timed = self._quiet

    def input(self, stage: str) -> Path:
        return self.root / stage

    def models(self) -> dict[str, Path]:
        return self.fitted

    @contextmanager
    def progress(self, description: str, total: int):
        yield SimpleNamespace(advance=lambda n=1: None)

    @contextmanager
    def _quiet(self, label: str):
        yield


@pytest.fixture(scope="module")
def context(tmp_path_factory) -> Context:
    trimesh = pytest.importorskip("trimesh")
    for package in ("plyfile", "PIL", "cv2", "imageio_ffmpeg"):
        pytest.importorskip(package)
    from physreal_core.geometry.mesh import Mesh
    from physreal_core.geometry.surface import sample_surface, surface_gaussians
    from stages._evaluation import scattered

    root = tmp_path_factory.mktemp("evaluate")
    for name in ("capture", "out", "parse_video", "segment_and_track", "fit_pose", "sample_particles"):
        (root / name).mkdir()
    box = trimesh.creation.box(bounds=[[0, -0.04, 0], [0.12, 0.04, 0.05]]).subdivide().subdivide()
    mesh = Mesh(np.asarray(box.vertices), np.asarray(box.faces), np.random.default_rng(0).random(box.vertices.shape))
    gaussians = surface_gaussians(sample_surface(mesh, 400, seed=0), inset=0.004)
    PlacedObject(mesh, gaussians, np.eye(4), 1.0, np.eye(4)).save(root / "fit_pose")
    placed = PlacedObject.load(root / "fit_pose")
    x0 = np.stack(np.meshgrid(*(np.arange(a, b, 0.01) + 0.005 for a, b in ((0, 0.12), (-0.04, 0.04), (0, 0.05)))), -1)
    x0 = x0.reshape(-1, 3)
    points = scattered(placed.mesh, 400, 0)[0]  # the very points that evaluate draws
    _write_particles(root, x0, points, placed.gaussians)
    carried, F = _motion(SHEAR)
    _write_capture(root, mesh.vertices, carried)
    seen, pixels = np.ones((FRAMES, 400), bool), np.full((FRAMES, 400, 2), np.nan)
    tracks = MeasuredTracks(pixels, seen, carried(points), seen, np.full((FRAMES, 400), 0.001))
    tracks.save(root / "segment_and_track")
    Controllers(np.zeros((FRAMES, 0, 3), np.float32)).save(root / "segment_and_track")
    _write_frames(root, x0, carried(x0), F, placed.gaussians)
    _write_model(root / "fit_global", x0, SHEAR, np.zeros(3))
    _write_model(root / "fit_patches", x0, 2 * SHEAR, SHIFT)
    return Context(root)


def _write_particles(root: Path, x0: np.ndarray, points: np.ndarray, gaussians: Gaussians) -> None:
    drawn, tracks, none = bind(gaussians.means, x0), bind(points[::8], x0), np.zeros(0)
    Particles(
        x0=x0,
        volume=np.full(len(x0), 1e-6),
        spacing=0.01,
        density=np.full(len(x0), 300.0),
        patches=np.array([0]),
        patch_neighbours=np.zeros((len(x0), 1), int),
        patch_weights=np.ones((len(x0), 1)),
        gaussian_neighbours=drawn.neighbours.numpy(),
        gaussian_weights=drawn.weights.numpy(),
        track_ids=np.arange(0, 400, 8),
        track_points0=points[::8],
        track_neighbours=tracks.neighbours.numpy(),
        track_weights=tracks.weights.numpy(),
        grip_particles=none.astype(int),
        grip_controllers=none.astype(int),
        grip_weights=none,
        grip_rest_lengths=none,
    ).save(root / "sample_particles")


def _write_capture(root: Path, vertices: np.ndarray, carried) -> None:
    pose = np.array([[1.0, 0, 0, 0.06], [0, -0.8, 0.6, -0.24], [0, -0.6, -0.8, 0.37], [0, 0, 0, 1]])
    described = CAMERA | {"T_world_camera": pose.tolist(), "frame_count": FRAMES}
    RecordedCamera(**described | {"K": np.array(CAMERA["K"]), "T_world_camera": pose}).save(root / "parse_video")
    split = {"train": [0, OBSERVED], "test": [OBSERVED, FRAMES]}
    (root / "parse_video" / "capture.json").write_text(json.dumps(described | {"kind": "video", "split": split}))
    hand = np.arange(FRAMES)[:, None] * [0, 0, LIFT]
    gripped = np.flatnonzero(vertices[:, 0] == 0)
    CaptureTruth(youngs_modulus=5e4, vertices=carried(vertices), hand=hand, gripped=gripped).save(root / "capture")


def _write_frames(root: Path, x0: np.ndarray, x: np.ndarray, F: np.ndarray, gaussians: Gaussians) -> None:
    """The film of the true motion, through the same renderer; a strip of the image is the hand."""
    view, images = RecordedCamera.load(root / "parse_video"), FrameImages(root / "parse_video")
    camera = Camera(view.K, view.T_world_camera, 80, 60)
    binding, objects = bind(gaussians.means, x0), []
    hand = np.zeros((60, 80), bool)
    hand[:, :10] = True
    for t in range(FRAMES):
        now, stretch = torch.from_numpy(x[t]).float(), torch.from_numpy(F[t]).float().expand(len(x0), 3, 3)
        out = render_carried(gaussians, binding, torch.from_numpy(x0).float(), now, stretch, camera)
        objects.append((out.alpha.numpy() > 0) & ~hand)
        colour, depth = out.rgb.clamp(0, 1).numpy() * 255, out.depth.numpy() * 1000
        images.save(t, colour.round().astype(np.uint8), depth.round().astype(np.uint16))
    Masks(np.stack(objects), np.tile(hand, (FRAMES, 1, 1))).save(root / "segment_and_track")


def _write_model(folder: Path, x0: np.ndarray, shear: float, shift: np.ndarray) -> None:
    folder.mkdir()
    carried, F = _motion(shear, shift)
    F = np.broadcast_to(F[:, None], (FRAMES, len(x0), 3, 3))
    Rollout(carried(x0), F).save(folder)
    model = uniform_model(torch.zeros(2, 3), {"youngs_modulus": 4e4}, elastic_law="fixed_corotated")
    save_model(folder, model.with_fields(youngs_modulus=torch.tensor([3e4, 5e4])))


def test_scores_of_a_known_motion(context: Context) -> None:
    from stages.evaluate import run

    run(context)
    metrics = Scores.load(context.output).metrics
    exact, off = metrics["fit_global"], metrics["fit_patches"]
    assert exact["observed"]["frames"] == [1, OBSERVED] and exact["future"]["frames"] == [OBSERVED, FRAMES]
    for interval in ("observed", "future"):
        assert exact[interval]["iou"] == 1.0
        assert exact[interval]["psnr"] > 50  # 8-bit colours: 58.9 dB at best
        assert exact[interval]["ssim"] > 0.999
        assert exact[interval]["track_error"] < 1e-6  # tracks start on surface points
        assert exact[interval]["cd_l1_oneway"] < 0.010  # surface points are 10 mm apart
        assert exact["truth"][interval]["vertex_error"] < 1e-6
        assert off[interval]["iou"] < 0.99 and off[interval]["psnr"] < exact[interval]["psnr"] - 10
    times = np.arange(1, OBSERVED)[:, None] / (FRAMES - 1)
    tracks = Particles.load(context.root / "sample_particles").track_points0
    errors = np.hypot(SHIFT[0], SHEAR * times * tracks[:, 0])
    assert off["observed"]["track_error"] == pytest.approx(errors.mean(), rel=1e-4)
    statics = off["truth"]["statics"]
    assert statics["true_youngs_modulus"] == 5e4 and statics["youngs_modulus"] == 4e4
    assert statics["equivalent_youngs_modulus"] == pytest.approx(2 * 4e4, rel=1e-4)


def test_files(context: Context) -> None:
    rows = list(csv.DictReader((context.output / "frames.csv").open()))
    assert len(rows) == 2 * FRAMES and float(rows[0]["iou"]) == 1.0
    for stage in ("fit_global", "fit_patches"):
        assert (context.output / f"{stage}.mp4").stat().st_size > 1000


def test_tracks_without_images(context: Context, tmp_path) -> None:
    """No image scores; track error, the deflection of the tracked points, the free end, and a video from the side."""
    from stages.evaluate import run

    described = json.loads((context.root / "parse_video" / "capture.json").read_text())
    (context.root / "parse_video" / "capture.json").write_text(json.dumps(described | {"kind": "tracks"}))
    try:
        context.output = tmp_path
        run(context)
    finally:
        (context.root / "parse_video" / "capture.json").write_text(json.dumps(described))
    metrics = Scores.load(tmp_path).metrics
    assert set(metrics["fit_global"]["observed"]) == {"frames", "track_error"}
    assert metrics["fit_global"]["tip"]["error"] < 1e-6
    tip = metrics["fit_patches"]["tip"]
    weights = np.array([1, 3, 4, 3, 1]) / 12  # Hann over frames 1 to 5
    mean_time = weights @ np.arange(1, 6) / (FRAMES - 1)
    tracks = Particles.load(context.root / "sample_particles").track_points0
    down = SHEAR * mean_time * tracks[:, 0].mean()
    assert tip["error"] == pytest.approx(np.hypot(SHIFT[0], down), rel=1e-4)
    end = FreeEnd.load(tmp_path)
    assert np.allclose(end.simulated[0], end.measured, atol=1e-6), "the true model's free end is the measured one"
    assert np.abs(end.simulated[1] - end.measured).max() > 1e-4, "the other model's is not"
    assert {path.stem for path in tmp_path.glob("*.mp4")} == set(metrics)


def test_what_is_seen_is_compared_with_the_measurement_and_what_is_with_the_truth(context: Context, tmp_path) -> None:
    """A rollout that is off by `SHIFT`, and a model that says that the measurement is off by as much the other way."""
    from stages._evaluation import Replay, load_sequence
    from stages.evaluate import _against_truth

    x0 = Particles.load(context.root / "sample_particles").x0
    _write_model(tmp_path / "off", x0, SHEAR, SHIFT)
    off, right = Rollout.load(tmp_path / "off"), Rollout.load(context.root / "fit_global")
    Rollout(off.x, off.F, x_seen=right.x).save(tmp_path / "off")
    sequence = load_sequence(context)
    replay = Replay(sequence, tmp_path / "off")
    seen = replay.carry(3, sequence.track_points0, replay.tracks)
    np.testing.assert_allclose(seen, sequence.tracks3d[3], atol=1e-6)
    truth = _against_truth(sequence, replay, context.root / "fit_global", context.params)
    assert truth["observed"]["vertex_error"] == pytest.approx(SHIFT[0], rel=1e-4)


def test_rollout_of_another_body(context: Context, tmp_path) -> None:
    from stages._evaluation import Replay, load_sequence

    Rollout(np.zeros((FRAMES, 3, 3)), np.zeros((FRAMES, 3, 3, 3))).save(tmp_path)
    with pytest.raises(InputError, match="6 frames of 3 particles"):
        Replay(load_sequence(context), tmp_path)
