"""A gripper of two fingers as Gaussians, so that pictures show the hand. It is drawn and pushes nothing."""

from dataclasses import dataclass

import numpy as np
import torch

from applications.generate.way import HandWay
from physreal_core.array_types import Float, Tensor

OPEN, CLOSED = 0.03, 0.012
"""Distance of each finger from the middle [m]."""

_SPACING = 0.005
_FINGER, _PALM = (0.01, 0.014, 0.06), (0.08, 0.03, 0.02)
"""Spacing of the Gaussians, and sides of the parts [m]; the fingers end 1 cm below the hand's place, the palm lies on them."""

_BELOW = 0.01


@dataclass(frozen=True)
class Gripper:
    """Gaussians around the hand's place.

    Attributes:
        finger, palm: places [m]; both fingers are the same, apart from each other.
        colours: of all, in this order.
        covariance: of each [m2].
        opacity: of each.
    """

    finger: Float[Tensor, "finger 3"]
    palm: Float[Tensor, "palm 3"]
    colours: Float[Tensor, "all 3"]
    covariance: Float[Tensor, "3 3"]
    opacity: float = 0.95


def _block(sides: tuple[float, float, float], bottom: float) -> Float[Tensor, "points 3"]:
    """Points in a block around the z axis."""
    axes = [np.linspace(-0.5, 0.5, max(2, round(side / _SPACING) + 1)) * side for side in sides]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return torch.as_tensor(points + [0.0, 0.0, bottom + sides[2] / 2], dtype=torch.float32)


def _made() -> Gripper:
    finger, palm = _block(_FINGER, -_BELOW), _block(_PALM, _FINGER[2] - _BELOW)
    grey = torch.cat([torch.full((2 * len(finger), 3), 0.25), torch.full((len(palm), 3), 0.4)])
    return Gripper(finger, palm, grey, (0.6 * _SPACING) ** 2 * torch.eye(3))


GRIPPER = _made()


def gripper_at(way: HandWay) -> Float[Tensor, "frames all 3"]:
    """Places of its Gaussians on a way of the hand [m]."""
    apart = torch.as_tensor(np.where(way.closed, CLOSED, OPEN), dtype=torch.float32)[:, None, None]
    side = torch.tensor([1.0, 0.0, 0.0])
    palm = GRIPPER.palm.expand(way.frames, -1, 3)
    local = torch.cat([GRIPPER.finger - apart * side, GRIPPER.finger + apart * side, palm], 1)
    return local + torch.as_tensor(way.places, dtype=torch.float32)[:, None]
