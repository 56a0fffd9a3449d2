"""gsplat behind the same function as our own rasterisers; imported only when it draws (needs CUDA)."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.reference import LOW_PASS, NEAR


@cache
def gsplat_installed() -> bool:
    """Whether the package can be found (it is not imported)."""
    return find_spec("gsplat") is not None


def rasterise_gsplat(
    means: Float[Tensor, "gaussians 3"],
    covariances: Float[Tensor, "gaussians 3 3"],
    opacities: Float[Tensor, " gaussians"],
    colours: Float[Tensor, "gaussians 3"],
    camera: Camera,
    pose: Float[Tensor, "4 4"],
    background: Float[Tensor, " 3"],
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"], Float[Tensor, "height width"]]:
    """RGB over the background, depth [m] and alpha of Gaussians given in the world [m]; differs from our own only where
    alpha is capped (0.999 in recent releases) and in when a pixel counts as finished."""
    from gsplat import rasterization

    # Every copy to the device stops the host: so made on the CPU, in one piece.
    K = camera.K.float().clone()
    K[:2, 2] += 0.5  # gsplat's pixel centres are at half integers
    rotation = pose[:3, :3]
    top = torch.cat([rotation.T, -rotation.T @ pose[:3, 3:]], dim=1)
    image, alpha, _ = rasterization(
        means=means, quats=None, scales=None, opacities=opacities, colors=colours,
        viewmats=torch.cat([top, pose[3:]])[None], Ks=K.to(means.device)[None], width=camera.width, height=camera.height,
        near_plane=NEAR, eps2d=LOW_PASS, covars=covariances, packed=False, render_mode="RGB+ED",
        backgrounds=background[None],
    )  # fmt: skip
    return image[0, ..., :3], image[0, ..., 3], alpha[0, ..., 0]
