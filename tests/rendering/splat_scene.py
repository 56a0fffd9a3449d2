"""A small, dense scene in float64 for the rendering tests: overlapping Gaussians of all shapes, some out of view."""

from __future__ import annotations

import torch

from physreal_core.rendering import Camera, rotation_matrices


def camera(width: int = 40, height: int = 30) -> Camera:
    """A camera that looks along a tilted axis from above: nothing in it is the identity."""
    K = torch.tensor([[42.0, 0.0, 21.3], [0.0, 38.0, 13.6], [0.0, 0.0, 1.0]])
    pose = torch.eye(4, dtype=torch.float64)
    pose[:3, :3] = rotation_matrices(torch.tensor([0.8, 0.5, -0.2, 0.1], dtype=torch.float64))
    pose[:3, 3] = torch.tensor([0.2, -0.1, 0.4])
    return Camera(K, pose, width, height)


def inputs(count: int = 60, seed: int = 0, spread: float = 0.25) -> list[torch.Tensor]:
    """World means, covariances, opacities, colours as float64 leaves that require gradients."""
    generator = torch.Generator().manual_seed(seed)

    def rand(*shape: int) -> torch.Tensor:
        return torch.rand(*shape, generator=generator, dtype=torch.float64)

    local = torch.randn(count, 3, generator=generator, dtype=torch.float64) * spread
    local[:, 2] += 1.0
    axes = torch.randn(count, 3, 3, generator=generator, dtype=torch.float64) * 0.04
    pose = camera().T_world_camera
    means = local @ pose[:3, :3].T + pose[:3, 3]
    opacities = 0.02 + 0.979 * rand(count)  # some reach the cap of alpha
    parts = [means, axes @ axes.transpose(1, 2), opacities, rand(count, 3)]
    return [a.requires_grad_(True) for a in parts]
