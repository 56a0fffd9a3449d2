"""Effects of the measurement against a camera that truly errs."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from physreal_core.effects import EFFECTS, Inputs
from physreal_core.rendering import Camera
from tests.effects.specimen import VIEW, complete, held_specimen

K = np.array([[500.0, 0, 320], [0, 500, 240], [0, 0, 1]])


def path(frames: int = 7) -> torch.Tensor:
    """Points that move before the camera [m], shape [T, 5, 3]."""
    generator = torch.Generator().manual_seed(0)
    start, speed = (0.1 * torch.randn(5, 3, generator=generator, dtype=torch.float64) for _ in range(2))
    return start + speed * torch.arange(frames)[:, None, None] / 10


def observed(name: str, points: torch.Tensor, values: dict[str, float], **scene) -> torch.Tensor:
    return EFFECTS[name].observe(points, complete(name, values), replace(held_specimen(), **scene).setting)


def seen_by(camera: Camera, believed: Camera, points: torch.Tensor) -> torch.Tensor:
    """World points as they are taken to be by one who believes in another pose of the camera."""
    return believed.unproject(*camera.project(points))


def test_drift_is_what_a_moving_camera_sees_that_is_taken_to_stand_still():
    """A camera that rolls by -w about its view axis and moves so that points seem to turn by w and shift by v."""
    velocity, roll, fps = np.array([0.03, -0.02, 0.04]), 0.3, 60.0
    points, believed = path(), Camera(K, VIEW, 640, 480)
    expected = []
    for frame, now in enumerate(points):
        turn = Rotation.from_rotvec(-roll * frame / fps * VIEW[:3, 2]).as_matrix()
        pose = VIEW.copy()
        pose[:3, :3] = turn @ VIEW[:3, :3]
        pose[:3, 3] = VIEW[:3, 3] - turn @ velocity * frame / fps
        expected.append(seen_by(Camera(K, pose, 640, 480), believed, now))
    values = {"roll": roll, **dict(zip("xyz", velocity, strict=True))}
    torch.testing.assert_close(observed("camera_drift", points, values), torch.stack(expected))


def test_drift_without_a_camera_turns_about_the_vertical_through_the_body():
    points = path()
    seen = observed("camera_drift", points, {"roll": 0.5, "z": 0.1}, T_world_camera=None)
    middle = held_specimen().body.x0.mean(0)
    for frame in (0, 6):
        turn = Rotation.from_euler("z", 0.5 * frame / 60).as_matrix()
        expected = (points[frame].numpy() - middle) @ turn.T + middle + [0, 0, 0.1 * frame / 60]
        np.testing.assert_allclose(seen[frame], expected, atol=1e-12)


def test_depth_bias_is_what_a_sensor_with_that_bias_sees():
    """Of points that were put, at frame 0, where the sensor saw them."""
    camera, (offset, scale), seen0 = Camera(K, VIEW, 640, 480), (0.03, 0.05), path()[0]
    pixels, depth = camera.project(seen0)
    true = camera.unproject(pixels, (depth - offset) / (1 + scale)) + path() - seen0
    pixels, depth = camera.project(true)
    expected = camera.unproject(pixels, (1 + scale) * depth + offset)
    torch.testing.assert_close(observed("depth_bias", path(), {"offset": offset, "scale": scale}), expected)
    assert EFFECTS["depth_bias"].starts(replace(held_specimen(), T_world_camera=None).setting) == ()


@pytest.mark.parametrize("excess", [-0.05, 0.0, 0.02, 0.13])
def test_frame_rate_reads_a_swing_at_other_times_up_to_the_last(excess):
    """A swing of three and a third frames at full size at the end, from the frames that are said to be needed."""
    frames = 30

    def swing(time):
        return (1.0 - torch.exp(-((time / 8.0) ** 2))) * torch.cos(2.0 * np.pi * time / 3.3)

    needed = EFFECTS["frame_rate"].frames_needed(frames, {"excess": excess})
    time, along = torch.arange(needed, dtype=torch.float64), torch.ones(1, 4, 3, dtype=torch.float64)
    seen = observed("frame_rate", swing(time)[:, None, None] * along, {"excess": excess})[:frames]
    later = swing((1 + excess) * time[:frames])[:, None, None] * along
    torch.testing.assert_close(seen, later, rtol=0, atol=0.03)


def test_a_hand_seen_by_the_same_camera_is_read_back():
    """`act` undoes on the hand's record what `observe` does to points; of another clock, up to what lies between frames."""
    scene = held_specimen(9)
    cases = {
        "camera_drift": ({"x": 0.05, "roll": 0.4}, 1e-12),
        "depth_bias": ({"offset": 0.02, "scale": -0.04}, 1e-12),
        "frame_rate": ({"excess": -0.02}, 1e-3),
    }
    for name, (given, tolerance) in cases.items():
        values = complete(name, given)
        recorded = EFFECTS[name].observe(scene.controllers, values, scene.setting)
        read = EFFECTS[name].act(Inputs(scene.material, recorded), values, scene.setting).controllers
        torch.testing.assert_close(read, scene.controllers, rtol=0, atol=tolerance)
        for elsewhere in (replace(scene, T_world_camera=None).setting, replace(scene.setting, hand_seen=False)):
            untouched = EFFECTS[name].act(Inputs(scene.material, recorded), values, elsewhere).controllers
            assert untouched is recorded
