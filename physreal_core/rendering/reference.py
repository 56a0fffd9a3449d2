"""Gaussian rasteriser in plain torch, tile by tile: the readable twin that the native and the CUDA one are held to."""

from __future__ import annotations

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.rendering.camera import Camera

NEAR = 0.01  # [m] Gaussians whose centre is nearer along z are not drawn
LOW_PASS = 0.3  # [px^2] added to the projected variances: no Gaussian is thinner than a pixel
ALPHA_MAX = 0.99
ALPHA_MIN = 1.0 / 255.0  # weaker contributions are skipped
TRANSMITTANCE_MIN = 1e-4  # a pixel this opaque is finished
FOV_MARGIN = 0.3  # the Jacobian is taken at most this share of the half field of view outside the image


def jacobian_limits(camera: Camera) -> tuple[float, float, float, float]:
    """Smallest and largest x / z, then y / z, at which the projection's Jacobian is taken (as in 3DGS)."""
    fx, fy, cx, cy = camera.intrinsics
    margin_x, margin_y = FOV_MARGIN * 0.5 * camera.width / fx, FOV_MARGIN * 0.5 * camera.height / fy
    return (
        -(cx + 0.5) / fx - margin_x, (camera.width - 0.5 - cx) / fx + margin_x,
        -(cy + 0.5) / fy - margin_y, (camera.height - 0.5 - cy) / fy + margin_y,
    )  # fmt: skip


def project_gaussians(
    means: Float[Tensor, "gaussians 3"], covariances: Float[Tensor, "gaussians 3 3"], camera: Camera
) -> tuple[Float[Tensor, "gaussians 2"], Float[Tensor, "gaussians 2 2"]]:
    """EWA projection (Zwicker et al. 2001) of Gaussians in the camera's frame: pixel centres, covariances [px^2]."""
    fx, fy, cx, cy = camera.intrinsics
    x_low, x_high, y_low, y_high = jacobian_limits(camera)
    x, y, z = means.unbind(-1)
    inverse = 1.0 / z.clamp(min=NEAR)
    u, v = (x * inverse).clamp(x_low, x_high), (y * inverse).clamp(y_low, y_high)
    zero = torch.zeros_like(z)
    J = torch.stack([fx * inverse, zero, -fx * u * inverse, zero, fy * inverse, -fy * v * inverse], -1).unflatten(
        -1, (2, 3)
    )
    symmetric = 0.5 * (covariances + covariances.transpose(1, 2))
    footprint = J @ symmetric @ J.transpose(1, 2) + LOW_PASS * torch.eye(2).to(means)
    return torch.stack([fx * x * inverse + cx, fy * y * inverse + cy], -1), footprint


def rasterise_reference(
    means: Float[Tensor, "gaussians 3"],
    covariances: Float[Tensor, "gaussians 3 3"],
    opacities: Float[Tensor, " gaussians"],
    features: Float[Tensor, "gaussians channels"],
    camera: Camera,
    tile: int = 16,
) -> tuple[Float[Tensor, "height width channels"], Float[Tensor, "height width"]]:
    """Composite Gaussians given in the camera's frame [m], front to back: sum of w * feature, and alpha = sum of w."""
    centres, footprint = project_gaussians(means, covariances, camera)
    with torch.no_grad():
        # Where opacity * exp(-d^2 / 2) >= ALPHA_MIN ends, along x and y: the tight box of that ellipse.
        reach = (2.0 * (opacities / ALPHA_MIN).clamp(min=1.0).log())[:, None] * footprint.diagonal(dim1=1, dim2=2)
        low, high = centres - reach.sqrt(), centres + reach.sqrt()
        order = torch.argsort(means[:, 2], stable=True)
        drawn = (means[:, 2] >= NEAR) & (opacities >= ALPHA_MIN)
        order = order[drawn[order]]
    conic = torch.linalg.inv(footprint)
    rows = []
    for top in range(0, camera.height, tile):
        row = []
        for left in range(0, camera.width, tile):
            bottom, right = min(top + tile, camera.height), min(left + tile, camera.width)
            corner, end = centres.new_tensor([left, top]), centres.new_tensor([right - 1, bottom - 1])
            hit = order[((low[order] <= end) & (high[order] >= corner)).all(dim=1)]
            v, u = torch.meshgrid(torch.arange(top, bottom), torch.arange(left, right), indexing="ij")
            pixels = torch.stack([u, v], -1).to(centres).flatten(0, 1)
            image = _composite(pixels, centres[hit], conic[hit], opacities[hit], features[hit])
            row.append(image.unflatten(0, (bottom - top, right - left)))
        rows.append(torch.cat(row, dim=1))
    image = torch.cat(rows, dim=0)
    return image[..., :-1], image[..., -1]


def _composite(pixels: Tensor, centres: Tensor, conic: Tensor, opacities: Tensor, features: Tensor) -> Tensor:
    """Features and alpha, [P, channels + 1], of Gaussians sorted front to back at P pixels."""
    offset = pixels[:, None, :] - centres[None]  # [P, g, 2]
    power = -0.5 * torch.einsum("pgi,gij,pgj->pg", offset, conic, offset)
    alpha = (opacities * power.exp()).clamp(max=ALPHA_MAX)
    alpha = torch.where(alpha >= ALPHA_MIN, alpha, torch.zeros_like(alpha))
    ones = torch.ones_like(alpha[:, :1])
    transmittance = torch.cumprod(torch.cat([ones, 1.0 - alpha], dim=1), dim=1)[:, :-1]
    weights = alpha * transmittance * (transmittance > TRANSMITTANCE_MIN)
    return torch.cat([weights @ features, weights.sum(dim=1, keepdim=True)], dim=1)
