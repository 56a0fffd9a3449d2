"""Depth readings that are too long or too short."""

from dataclasses import replace

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.fields import vector
from physreal_core.simulation import States


class DepthBias(Effect):
    """Offset and scale of depth along the camera's rays.

    Frame 0 is where the object was put into the camera's world, bias and all, so only what changes after it shows.
    """

    name = "depth_bias"
    family = "measurement"
    words = "The camera's depth readings are too long or too short."
    formula = "z_seen = (1 + s) z + b along the ray of the pixel, less what it shifts in frame 0"
    shows = "in proportion to how far a point has moved, towards the camera or across; nothing at rest"
    distinguished_by = "moving the object towards the camera and back"
    coefficients = (
        Coefficient("offset", "m", "b", 0.0, -0.2, 0.2, 0.03),
        Coefficient("scale", "1", "s", 0.0, -0.3, 0.3, 0.02),
    )

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        seen = inputs.controllers
        if setting.T_world_camera is None or not setting.hand_seen or seen.shape[1] == 0:
            return inputs
        true = _with_depth(seen, setting, lambda z, b, s: (z - b) / (1 + s), values)
        return replace(inputs, controllers=seen[:1] + true - true[:1])

    def observe(self, points: Float[Tensor, "frames points 3"], values: Values, setting: Setting) -> Tensor:
        if setting.T_world_camera is None:
            return points
        start = _with_depth(points[:1], setting, lambda z, b, s: (z - b) / (1 + s), values)
        seen = _with_depth(start + points - points[:1], setting, lambda z, b, s: (1 + s) * z + b, values)
        return seen

    def starts(self, setting: Setting, motion: States | None = None) -> tuple[dict[str, float], ...]:
        """Only with a camera."""
        return () if setting.T_world_camera is None else ({},)


def _with_depth(points: Tensor, setting: Setting, depth, values: Values) -> Tensor:
    """World points whose depth z along the camera's axis has become `depth(z, offset, scale)`, each on its ray."""
    pose = torch.as_tensor(setting.T_world_camera).to(points)
    local = (points - pose[:3, 3]) @ pose[:3, :3]
    z = local[..., 2:]
    return (local * (depth(z, *vector(values, "offset", "scale", like=points)) / z)) @ pose[:3, :3].T + pose[:3, 3]
