"""gsplat behind the same function as the Warp rasteriser; imported only when it draws (needs CUDA)."""

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
    features: Float[Tensor, "gaussians 4"],
    camera: Camera,
) -> tuple[Float[Tensor, "height width 4"], Float[Tensor, "height width"]]:
    """Composite Gaussians given in the camera's frame [m]; differs from the Warp kernels only where alpha is capped
    (0.999 in recent releases) and in when a pixel counts as finished."""
    from gsplat import rasterization

    K = camera.K.to(means).clone()
    K[:2, 2] += 0.5  # gsplat's pixel centres are at half integers
    image, alpha, _ = rasterization(
        means=means, quats=None, scales=None, opacities=opacities, colors=features,
        viewmats=torch.eye(4).to(means)[None], Ks=K[None], width=camera.width, height=camera.height,
        near_plane=NEAR, eps2d=LOW_PASS, covars=covariances, packed=False, render_mode="RGB",
    )  # fmt: skip
    return image[0], alpha[0, ..., 0]
