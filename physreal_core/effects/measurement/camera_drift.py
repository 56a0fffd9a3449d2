"""The camera moves, though it is taken to stand still."""

from dataclasses import replace

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.effects.shape import middle
from physreal_core.effects.turns import rotation_about


class CameraDrift(Effect):
    """Steady drift and roll, as points seem to move; roll about the view axis, without a camera the body's vertical."""

    name = "camera_drift"
    family = "measurement"
    words = "The camera drifts: everything seems to move, even what lies still."
    formula = "x_seen(t) = o + R(w t) (x(t) - o) + v t, R about the view axis through o"
    shows = "in all points alike, growing with time, also before the hand moves"
    distinguished_by = "anything that lies still in view; waiting before the hand moves"
    coefficients = (
        Coefficient("x", "m/s", "apparent drift along x", 0.0, -0.1, 0.1, 0.005),
        Coefficient("y", "m/s", "apparent drift along y", 0.0, -0.1, 0.1, 0.005),
        Coefficient("z", "m/s", "apparent drift upwards", 0.0, -0.1, 0.1, 0.005),
        Coefficient("roll", "rad/s", "apparent turn about the view axis", 0.0, -0.5, 0.5, 0.04),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        if setting.T_world_camera is None or not setting.hand_seen:
            return inputs
        turn, shift, centre = _motion(inputs.controllers, values, setting)
        true = (inputs.controllers - shift - centre) @ turn + centre
        return replace(inputs, controllers=true)

    def observe(self, points: Float[Tensor, "frames points 3"], values: Values, setting: Setting) -> Tensor:
        turn, shift, centre = _motion(points, values, setting)
        return (points - centre) @ turn.mT + centre + shift


def _motion(points: Tensor, values: Values, setting: Setting) -> tuple[Tensor, Tensor, Tensor]:
    """Of the apparent motion: rotations [T, 3, 3], shifts [T, 1, 3] m, and the point of its axis [3] m."""
    pose = setting.T_world_camera
    axis = points.new_tensor([0.0, 0.0, 1.0] if pose is None else pose[:3, 2])
    centre = points.new_tensor(middle(setting.body) if pose is None else pose[:3, 3])
    time = torch.arange(len(points)).to(points) / setting.fps
    shift = time[:, None, None] * vector(values, "x", "y", "z", like=points)
    return rotation_about(axis, values["roll"].to(points) * time), shift, centre
