"""What a recording shows beside object and hand, lifted: it gives the picture back, and takes nothing from what was in the way."""

import dataclasses
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch

from applications import filmed
from applications.filmed import filmed_gaussians
from physreal_core.errors import InputError
from physreal_core.rendering import Camera, Gaussians, render
from pipeline.products.camera import RecordedCamera
from pipeline.products.images import FrameImages
from pipeline.products.masks import Masks

FRAMES, WIDTH, HEIGHT = 9, 80, 60
RED = np.array([230, 30, 30], np.uint8)


def over_a_table() -> Camera:
    """30 degrees down on the plane z = 0, half a metre away."""
    down = np.deg2rad(30.0)
    T = np.eye(4)
    T[:3, :3] = np.array([[1, 0, 0], [0, -np.sin(down), np.cos(down)], [0, -np.cos(down), -np.sin(down)]])
    T[:3, 3] = -0.5 * T[:3, 2]
    return Camera(np.array([[120.0, 0, 39.5], [0, 120.0, 29.5], [0, 0, 1]]), T, WIDTH, HEIGHT)


def table(camera: Camera) -> tuple[np.ndarray, np.ndarray]:
    """Colour [H, W, 3], 0 to 1, with waves of 12 cm, and depth [H, W] m."""
    v, u = np.indices((camera.height, camera.width))
    pixels = torch.as_tensor(np.stack([u, v], -1), dtype=torch.float64)
    eye = camera.centre.numpy()
    rays = camera.unproject(pixels, torch.ones(v.shape, dtype=torch.float64)).numpy() - eye
    depth = -eye[2] / rays[..., 2]
    x, y, _ = np.moveaxis(eye + depth[..., None] * rays, -1, 0)
    return np.stack([0.5 + 0.3 * np.sin(52 * x), 0.5 + 0.3 * np.cos(52 * y), 0.4 + 0 * x], -1), depth


@dataclasses.dataclass
class Recording:
    """A table in `FRAMES` frames, which a test may put things in."""

    folder: Path
    camera: Camera
    colour: np.ndarray
    depth: np.ndarray
    object: np.ndarray
    hand: np.ndarray

    @classmethod
    def of(cls, folder: Path) -> "Recording":
        camera = over_a_table()
        colour, depth = table(camera)
        colours = np.repeat((255 * colour).round().astype(np.uint8)[None], FRAMES, 0)
        noise = np.random.default_rng(0).normal(0.0, 1.0, (FRAMES, HEIGHT, WIDTH))
        depths = (1000 * depth + noise).round().astype(np.uint16)
        nothing = np.zeros((FRAMES, HEIGHT, WIDTH), bool)
        return cls(folder, camera, colours, depths, nothing, nothing.copy())

    def gaussians(self) -> Gaussians:
        """Written and lifted."""
        images = FrameImages(self.folder)
        for frame in range(FRAMES):
            images.save(frame, self.colour[frame], self.depth[frame])
        Masks(self.object, self.hand).save(self.folder)
        pose = self.camera.T_world_camera.numpy()
        RecordedCamera(30.0, WIDTH, HEIGHT, self.camera.K.numpy(), pose, FRAMES).save(self.folder)
        return filmed_gaussians(self.folder, self.folder, self.camera, where="here", remedy="another")


@pytest.fixture
def recording(tmp_path) -> Recording:
    return Recording.of(tmp_path)


def test_a_table_lifted_from_its_recording_gives_the_picture_back(recording):
    """Colours of 0.3 amplitude to 0.03. Of overlapping cells the nearer covers the farther, so depth is nearer, by less than a row of pixels."""
    gaussians = recording.gaussians()
    assert len(gaussians) == WIDTH * HEIGHT
    seen, (colour, depth) = render(gaussians, recording.camera), table(recording.camera)
    assert seen.alpha.min() > 0.75 and seen.alpha[2:-2, 2:-2].min() > 0.95
    assert np.abs(seen.rgb.numpy() - colour)[2:-2, 2:-2].mean() < 0.03
    nearer, row = depth - seen.depth.numpy(), -np.gradient(depth, axis=0)
    assert nearer[2:-2, 2:-2].min() > -2e-3 and (nearer - 0.9 * row)[2:-2, 2:-2].max() < 2e-3
    assert gaussians.means[:, 2].abs().max() < 2e-3


def test_it_is_closed_from_above_too(recording):
    """Cells lie along the table: seen from straight above, they are twice as far apart in y as in x."""
    gaussians, T = recording.gaussians(), np.diag([1.0, -1.0, -1.0, 1.0])
    T[2, 3] = 0.5
    above = Camera(recording.camera.K, T, WIDTH, HEIGHT)
    assert render(gaussians, above).alpha[20:40, 20:60].min() > 0.9


def test_what_the_hand_covers_in_some_frames_is_taken_from_the_others(recording):
    """The hand, red, covers a place in most frames, and its masks are two pixels too small. Elsewhere what has no depth is red."""
    plain = recording.gaussians()
    place, found = np.s_[20:35, 30:50], np.s_[22:33, 32:48]
    for frame in range(6):
        recording.colour[frame][place], recording.depth[frame][place] = RED, 300
        recording.hand[frame][found] = True
    recording.colour[:5, :10, :10], recording.depth[:5, :10, :10] = RED, 0
    lifted = recording.gaussians()
    assert len(lifted) == len(plain)
    before, after = (render(gaussians, recording.camera) for gaussians in (plain, lifted))
    assert (after.rgb - before.rgb).abs().max() < 0.05
    assert (after.depth - before.depth).abs().max() < 5e-3


def test_what_no_frame_shows_stays_empty(recording):
    recording.object[:, 20:40, 30:50] = True
    recording.depth[:, 20:40, 30:50] = 300
    seen = render(recording.gaussians(), recording.camera)
    assert seen.alpha[23:37, 33:47].max() < 0.01
    assert seen.alpha[:14].min() > 0.75 and seen.alpha[46:].min() > 0.75


def test_a_step_in_depth_is_not_bridged(recording):
    recording.depth[:, :, 40:] = recording.depth[:, :, 40:] + 200
    gaussians = recording.gaussians()
    assert gaussians.log_scales.exp().max() < 0.02, "a cell of the table is 24 mm long at most, the step 200 mm high"
    seen = render(gaussians, recording.camera)
    off = seen.depth.numpy() - table(recording.camera)[1]
    assert np.abs(off)[5:-5, 5:38].max() < 0.03 and np.abs(off - 0.2)[5:-5, 42:-5].max() < 0.03


def test_of_many_pixels_every_second_is_taken_and_the_picture_stays_closed(recording, monkeypatch):
    monkeypatch.setattr(filmed, "LARGEST", WIDTH * HEIGHT // 4)
    gaussians, (colour, _) = recording.gaussians(), table(recording.camera)
    assert len(gaussians) == WIDTH * HEIGHT // 4
    seen = render(gaussians, recording.camera)
    assert seen.alpha[4:-4, 4:-4].min() > 0.9
    assert np.abs(seen.rgb.numpy() - colour)[4:-4, 4:-4].mean() < 0.04


def test_a_recording_without_depth_or_without_a_rest_says_so(recording):
    recording.hand[:] = True
    with pytest.raises(InputError, match="here: no frame shows anything.*neither object nor hand.*another"):
        recording.gaussians()
    shutil.rmtree(recording.folder / "depth")
    with pytest.raises(InputError, match="here: the recording has no depth.*colour and depth.*another"):
        filmed_gaussians(recording.folder, recording.folder, recording.camera, where="here", remedy="another")
