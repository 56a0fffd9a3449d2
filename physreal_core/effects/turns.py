"""Rotations as torch functions of their angle, smooth at zero."""

import torch

from physreal_core.array_types import Float, Tensor


def rotation_about(axis: Float[Tensor, "3"], angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3 3"]:
    """Rodrigues' rotation by an angle [rad] about a unit axis."""
    x, y, z = axis
    zero = torch.zeros_like(x)
    cross = torch.stack([zero, -z, y, z, zero, -x, -y, x, zero]).reshape(3, 3)
    angle = angle[..., None, None]
    return torch.eye(3).to(axis) + torch.sin(angle) * cross + (1 - torch.cos(angle)) * (cross @ cross)


def direction(azimuth: Tensor, elevation: Tensor) -> Float[Tensor, "3"]:
    """Unit vector at an azimuth from x towards y and an elevation above the horizontal [rad]."""
    flat = torch.cos(elevation)
    return torch.stack([flat * torch.cos(azimuth), flat * torch.sin(azimuth), torch.sin(elevation)])
