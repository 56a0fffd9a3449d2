"""The camera's frames come slower or faster than stated."""

import math
from collections.abc import Mapping
from dataclasses import replace

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.effects.effect import Coefficient, Effect, Inputs, Setting, Values
from physreal_core.effects.paths import MARGIN, resampled


class FrameRate(Effect):
    """A time between frames other than 1 / fps; paths are read between frames by a spline (`paths`)."""

    name = "frame_rate"
    family = "measurement"
    words = "The camera's frames come slower or faster than stated."
    formula = "x_seen(frame k) = x((1 + s) k / fps)"
    shows = "in proportion to speed and to the time since the start"
    distinguished_by = "a long recording with a quick motion at its end (a time lag is the same at the beginning)"
    coefficients = (Coefficient("excess", "1", "relative excess of the time between frames, s", 0.0, -0.2, 0.2, 0.02),)

    def act(self, inputs: Inputs, values: Values, setting: Setting) -> Inputs:
        if setting.T_world_camera is None or not setting.hand_seen:
            return inputs
        return replace(inputs, controllers=_stretched(inputs.controllers, 1 / (1 + values["excess"])))

    def observe(self, points: Float[Tensor, "frames points 3"], values: Values, setting: Setting) -> Tensor:
        return _stretched(points, 1 + values["excess"])

    def frames_needed(self, frames: int, values: Mapping[str, float]) -> int:
        """Up to the time that the last frame shows, and as many more as the spline there needs."""
        return frames + max(math.ceil(values["excess"] * (frames - 1)), 0) + MARGIN


def _stretched(path: Tensor, factor: Tensor) -> Tensor:
    """The path at `factor` times its frame times."""
    return resampled(path, torch.arange(len(path)).to(path) * factor.to(path))
