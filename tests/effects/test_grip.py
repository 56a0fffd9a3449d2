"""Effects of the grip: paths that are known, and a hold whose stiffness is known."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from physreal_core.effects import EFFECTS
from physreal_core.effects.paths import first_motion, resampled
from physreal_core.simulation import Grip
from tests.effects.specimen import Specimen, held_specimen, lattice_body, material

GRAVITY = 9.81


def waiting_bar(rest: int, frames: int = 8) -> Specimen:
    """`held_specimen` whose hand rests for some frames first."""
    scene = held_specimen(frames)
    path = torch.cat([scene.controllers[:1].expand(rest, -1, -1), scene.controllers])[:frames]
    return replace(scene, controllers=path)


def rollout(scene: Specimen, **values: dict[str, float]) -> torch.Tensor:
    with torch.no_grad():
        return scene.rollout(**values).x


def test_a_lag_of_whole_frames_is_the_rollout_with_the_hand_shifted_by_them():
    scene = waiting_bar(2)
    late = rollout(replace(scene, controllers=waiting_bar(4).controllers))
    torch.testing.assert_close(rollout(scene, grip_lag={"lag": 2 / scene.fps}), late, rtol=0, atol=1e-12)


def test_a_lag_between_frames_reads_a_swing_of_three_frames():
    """Three and a third frames a swing, as of a body on a shaken hand at 24 frames/s; a cubic loses 23 % of it."""

    def swing(time):
        return torch.exp(-((time - 20.0) ** 2) / 50.0) * torch.cos(2.0 * np.pi * time / 3.3)

    time = torch.arange(41, dtype=torch.float64)
    for lag in (0.3, 0.5, 0.9):
        read = resampled(swing(time)[:, None], time - lag)[:, 0]
        torch.testing.assert_close(read, swing(time - lag), rtol=0, atol=0.01)


def test_what_is_read_can_be_differentiated_by_time_and_path():
    path = torch.sin(torch.arange(9, dtype=torch.float64))[:, None].requires_grad_()
    times = (torch.arange(9, dtype=torch.float64) * 0.9 + 0.3).requires_grad_()
    assert torch.autograd.gradcheck(resampled, (path, times))


def test_a_path_that_breaks_off_is_read_up_to_there():
    path = torch.arange(9, dtype=torch.float64)[:, None].repeat(1, 2)
    whole = resampled(path[:5], torch.arange(9, dtype=torch.float64) - 0.5)
    path[5:, 1] = torch.nan
    read = resampled(path, torch.arange(9, dtype=torch.float64) - 0.5)
    torch.testing.assert_close(read[:5], whole[:5])
    assert torch.isnan(read[5:]).all()


def test_a_path_rests_before_its_first_frame_and_goes_on_after_its_last():
    path = torch.tensor([[0.0], [1.0], [2.0], [4.0]])
    torch.testing.assert_close(resampled(path, torch.tensor([-2.0, 3.0, 4.5])), torch.tensor([[0.0], [4.0], [7.0]]))


def test_a_slip_as_fast_as_the_hand_leaves_the_object_where_it_is():
    scene = held_specimen(8)
    velocity = torch.tensor([0.4, -0.2, 0.5], dtype=torch.float64)
    steps = torch.arange(8, dtype=torch.float64)[:, None, None] / scene.fps
    resting = scene.controllers[:1].expand(8, -1, -1)
    moving = replace(scene, controllers=resting + velocity * steps)
    slip = dict(zip("xyz", velocity.tolist(), strict=True))
    torch.testing.assert_close(
        rollout(moving, grip_slip=slip), rollout(replace(scene, controllers=resting)), rtol=0, atol=1e-12
    )


def test_slip_and_offset_begin_with_the_first_motion():
    scene = waiting_bar(4)
    assert first_motion(scene.controllers) == 4
    still = rollout(scene)
    for name in ("grip_slip", "grip_offset"):
        moved = (rollout(scene, **{name: {"x": 0.05}}) - still).abs().amax((1, 2))
        assert moved[:4].max() == 0
        assert moved[4] < 0.1 * moved[5], "the way to frame 4 bends towards the place in frame 5"
        assert moved[6:].min() > 0


def held_cube(frames: int, gravity: float, fps: float = 60.0) -> Specimen:
    """A stiff cube with six bonds from its middle along the axes, which together are as stiff in every direction."""
    body = lattice_body((3, 3, 3), corner=(0.0, 0.0, 0.5))
    middle = np.linalg.norm(body.x0 - body.x0.mean(0), axis=1).argmin()
    arms = 0.05 * np.concatenate([np.eye(3), -np.eye(3)])
    points = torch.as_tensor(body.x0[middle] + arms)[None].repeat(frames, 1, 1)
    points[frames // 6 :] += torch.tensor([0.02, 0.0, 0.0], dtype=torch.float64)
    grip = Grip(np.full(6, middle), np.arange(6), np.ones(6), np.full(6, 0.05))
    given = material(body, 5e4, 0.3, grip_stiffness=0.5, grip_damping=0.2)
    return Specimen(body, points, fps, given, grip, ground_height=None, gravity=(0.0, 0.0, -gravity))


def test_offset_is_where_the_body_ends_beside_the_hand():
    scene, shift = held_cube(60, 0.0), torch.tensor([0.003, -0.004, 0.005], dtype=torch.float64)
    moved, still = rollout(scene, grip_offset=dict(zip("xyz", shift.tolist(), strict=True))), rollout(scene)
    torch.testing.assert_close((moved - still)[-1].mean(0), shift, rtol=0.01, atol=1e-5)


def test_compliance_lets_the_body_sag_by_weight_times_compliance_more():
    """To the springs' own geometry, which is not quite linear at a sag of a tenth of their length."""
    scene, compliance = held_cube(60, 1.0), 0.05
    weight = scene.body.mass.sum() * 1.0
    sag = (rollout(scene) - rollout(scene, grip_compliance={"compliance": compliance}))[-1, :, 2].mean()
    assert float(sag) == pytest.approx(weight * compliance, rel=0.03)


@pytest.mark.parametrize("name", [name for name, effect in EFFECTS.items() if effect.family == "grip"])
def test_without_a_hand_there_is_nothing_to_try(name):
    scene = held_specimen()
    assert EFFECTS[name].starts(scene.setting)
    assert EFFECTS[name].starts(replace(scene, grip=None).setting) == ()
