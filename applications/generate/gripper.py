"""A gripper of two fingers, so that pictures show the hand. What pushes is a ball around its place (`way.FIST`)."""

import numpy as np
import torch

from applications.generate.look import Look
from applications.generate.way import HandWay
from physreal_core.array_types import Float, Tensor

OPEN, CLOSED = 0.03, 0.012
"""Distance of each finger from the middle [m]."""

_SPACING = 0.005
_FINGER, _PALM = (0.01, 0.014, 0.06), (0.08, 0.03, 0.02)
"""Spacing of the Gaussians, and sides of the parts [m]; the fingers end 1 cm below the hand's place, the palm lies on them."""

_BELOW = 0.01


def gripper(way: HandWay) -> Look:
    """On a way of the hand."""
    finger, palm = _block(_FINGER, -_BELOW), _block(_PALM, _FINGER[2] - _BELOW)
    apart = torch.as_tensor(np.where(way.closed, CLOSED, OPEN), dtype=torch.float32)[:, None, None]
    side = torch.tensor([1.0, 0.0, 0.0])
    local = torch.cat([finger - apart * side, finger + apart * side, palm.expand(way.frames, -1, 3)], 1)
    grey = torch.cat([torch.full((2 * len(finger), 3), 0.25), torch.full((len(palm), 3), 0.4)])
    return Look(local + torch.as_tensor(way.places, dtype=torch.float32)[:, None], None, grey, 0.6 * _SPACING)


def _block(sides: tuple[float, float, float], bottom: float) -> Float[Tensor, "points 3"]:
    """Points in a block around the z axis."""
    axes = [np.linspace(-0.5, 0.5, max(2, round(side / _SPACING) + 1)) * side for side in sides]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return torch.as_tensor(points + [0.0, 0.0, bottom + sides[2] / 2], dtype=torch.float32)
