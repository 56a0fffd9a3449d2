"""Pinhole camera: OpenCV axes (x right, y down, z forward), pixel centres at integers, poses as camera to world."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch

from physreal_core.array_types import Array, Float, Tensor
from physreal_core.errors import InputError


@dataclass(frozen=True, eq=False)
class Camera:
    """A calibrated view without lens distortion.

    Args:
        K: intrinsics [px], shape [3, 3], no skew; array or tensor (kept on the CPU in float64).
        T_world_camera: camera-to-world transform [m], shape [4, 4]; a tensor may require a gradient.
        width, height: image size [px].

    Raises:
        InputError: for another shape, a focal length that is not positive, or a skew.
    """

    K: Tensor | Array
    T_world_camera: Tensor | Array
    width: int
    height: int

    def __post_init__(self) -> None:
        K = torch.as_tensor(self.K, dtype=torch.float64).detach().cpu()
        pose = self.T_world_camera
        pose = pose if isinstance(pose, Tensor) else torch.as_tensor(pose, dtype=torch.float64)
        if K.shape != (3, 3) or not (K[0, 0] > 0 and K[1, 1] > 0) or abs(K[0, 1]) > 1e-9:
            raise InputError(f"K is {K.tolist()}", where="camera", expected="3x3, fx and fy > 0 [px], no skew")
        if pose.shape != (4, 4):
            raise InputError(f"T_world_camera has shape {tuple(pose.shape)}", where="camera", expected="4x4")
        object.__setattr__(self, "K", K)
        object.__setattr__(self, "T_world_camera", pose)

    @cached_property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """fx, fy, cx, cy [px]."""
        return float(self.K[0, 0]), float(self.K[1, 1]), float(self.K[0, 2]), float(self.K[1, 2])

    @property
    def centre(self) -> Float[Tensor, " 3"]:
        """Optical centre in the world [m]."""
        return self.T_world_camera[:3, 3]

    def to(self, device: torch.device | str) -> Camera:
        """The same with its pose on another device, so that points there are projected without a copy each time."""
        return Camera(self.K, self.T_world_camera.to(device), self.width, self.height)

    def scaled(self, factor: float) -> Camera:
        """The same view at `factor` times the resolution (0.5: half the pixels a side)."""
        K = self.K.clone()
        K[:2] *= factor
        # Pixel centres sit at integers, so it is the corner (-0.5, -0.5) that stays where it is.
        K[:2, 2] = (self.K[:2, 2] + 0.5) * factor - 0.5
        return Camera(K, self.T_world_camera, max(1, round(self.width * factor)), max(1, round(self.height * factor)))

    def to_camera(self, points: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
        """World points [m] in the camera's frame [m]."""
        pose = self.T_world_camera.to(points)
        return (points - pose[:3, 3]) @ pose[:3, :3]

    def project(self, points: Float[Tensor, "*batch 3"]) -> tuple[Float[Tensor, "*batch 2"], Float[Tensor, "*batch"]]:
        """World points [m] to pixels (u, v) [px] and depth along the camera's z [m]; differentiable.

        Points at or behind the camera have depth <= 0, and their pixels mean nothing.
        """
        local = self.to_camera(points)
        fx, fy, cx, cy = self.intrinsics
        depth = local[..., 2]
        safe = torch.where(depth.abs() > 1e-9, depth, torch.full_like(depth, 1e-9))
        pixels = torch.stack([fx * local[..., 0] / safe + cx, fy * local[..., 1] / safe + cy], dim=-1)
        return pixels, depth

    def unproject(self, pixels: Float[Tensor, "*batch 2"], depth: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch 3"]:
        """Pixels (u, v) [px] with depth along z [m] to world points [m]."""
        fx, fy, cx, cy = self.intrinsics
        x, y = (pixels[..., 0] - cx) / fx * depth, (pixels[..., 1] - cy) / fy * depth
        pose = self.T_world_camera.to(depth)
        return torch.stack([x, y, depth], dim=-1) @ pose[:3, :3].T + pose[:3, 3]
