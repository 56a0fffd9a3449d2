"""The rasteriser's one public function: Gaussians in the world to RGB, depth and alpha, all differentiable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError
from physreal_core.rendering.binding import Binding, carried_rotations, carry_gaussians
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.cuda_backend import rasterise_cuda
from physreal_core.rendering.gaussians import Gaussians
from physreal_core.rendering.gsplat_backend import gsplat_installed, rasterise_gsplat
from physreal_core.rendering.native_backend import rasterise_native
from physreal_core.rendering.reference import ALPHA_MIN, rasterise_reference
from physreal_core.rendering.warp_backend import rasterise_warp


@dataclass(frozen=True, eq=False)
class Rendering:
    """One rendered view.

    Args:
        rgb: composited over the background, shape [H, W, 3].
        depth: expected depth along the camera's z [m], normalised by alpha; 0 where nothing was drawn; shape [H, W].
        alpha: 0 to 1, shape [H, W].
    """

    rgb: Float[Tensor, "height width 3"]
    depth: Float[Tensor, "height width"]
    alpha: Float[Tensor, "height width"]


def rasterise(
    means: Tensor,
    covariances: Tensor,
    opacities: Tensor,
    colours: Tensor,
    camera: Camera,
    T_world_camera: Float[Tensor, "4 4"] | None = None,
    background: tuple[float, float, float] | Tensor = (0.0, 0.0, 0.0),
    *,
    backend: str = "auto",
) -> Rendering:
    """Render Gaussians front to back; gradients reach means, covariances, opacities, colours, the pose and background.

    Args:
        means: centres in the world [m], shape [G, 3].
        covariances: in the world [m^2], shape [G, 3, 3]; only the symmetric part is used.
        opacities: 0 to 1, shape [G].
        colours: RGB, 0 to 1, shape [G, 3].
        T_world_camera: pose used instead of the camera's own, for pose gradients.
        background: RGB.
        backend: "auto", "native" (vector C++, CPU), "cuda" (CUDA; on the CPU for tests), "gsplat" (needs CUDA and the
            package), "warp" (one kernel source for any device) or "reference" (plain torch, slow).

    Returns:
        Rendering in the dtype and on the device of `means` (float32 or float64).
    """
    _check(means, covariances, opacities, colours)
    pose = camera.T_world_camera if T_world_camera is None else T_world_camera
    pose = pose.to(means)
    chosen = choose_backend(means.device, means.dtype, backend)
    background = (
        background.to(means) if isinstance(background, Tensor) else _colour(background, means.dtype, means.device)
    )
    return Rendering(*_BACKENDS[chosen](means, covariances, opacities, colours, camera, pose, background))


@cache
def _colour(rgb: tuple[float, ...], dtype: torch.dtype, device: torch.device) -> Tensor:
    """A fixed colour as a tensor: made once, since each copy to a GPU takes longer than most of its kernels."""
    return torch.tensor(rgb, dtype=dtype, device=device)


def _in_camera_frame(draw, means, covariances, opacities, colours, camera, pose, background) -> tuple[Tensor, ...]:
    """Through a rasteriser that takes Gaussians in the camera's frame and gives unnormalised features over black."""
    rotation = pose[:3, :3]
    local_means = (means - pose[:3, 3]) @ rotation
    # R^T C R; C is symmetric, so its rows can be turned as row vectors: no batch of tiny matrix products.
    half = (covariances.reshape(-1, 3) @ rotation).reshape(-1, 3, 3)
    local_covariances = (half.transpose(1, 2).reshape(-1, 3) @ rotation).reshape(-1, 3, 3)
    features = torch.cat([colours, local_means[:, 2:]], dim=1)
    image, alpha = draw(local_means, local_covariances, opacities, features, camera)
    rgb = image[..., :3] + (1.0 - alpha)[..., None] * background
    # Drawn pixels have alpha >= ALPHA_MIN, so the clamp only keeps 0 / 0 out.
    return rgb, image[..., 3] / alpha.clamp(min=0.5 * ALPHA_MIN), alpha


def render(
    gaussians: Gaussians, camera: Camera, background: tuple[float, float, float] = (0.0, 0.0, 0.0), *, backend="auto"
) -> Rendering:
    """Render a Gaussian model where it lies."""
    colours = gaussians.colours(camera.centre)
    covariances, opacities = gaussians.covariances(), gaussians.opacities()
    return rasterise(gaussians.means, covariances, opacities, colours, camera, background=background, backend=backend)


def render_carried(
    gaussians: Gaussians,
    binding: Binding,
    x0: Float[Tensor, "particles 3"],
    x: Float[Tensor, "particles 3"],
    F: Float[Tensor, "particles 3 3"],
    camera: Camera,
    background: tuple[float, float, float] = (0.0, 0.0, 0.0),
    *,
    backend: str = "auto",
) -> Rendering:
    """Render a model carried by its particles (eqs. gs_binding, physics_rendering); differentiable in x and F."""
    means, covariances = carry_gaussians(binding, gaussians, x0, x, F)
    turned = carried_rotations(binding, F) if gaussians.harmonics.shape[1] > 1 else None
    colours = gaussians.colours(camera.centre, means, turned).to(means)
    opacities = gaussians.opacities().to(means)
    return rasterise(means, covariances, opacities, colours, camera, background=background, backend=backend)


def choose_backend(device: torch.device, dtype: torch.dtype, requested: str = "auto") -> str:
    """The backend that will draw: as requested; "auto" is "native" on the CPU and "cuda" on CUDA.

    Raises:
        InputError: for an unknown name or one that cannot run here.
    """
    if requested == "auto":
        return "cuda" if device.type == "cuda" else "native"
    if requested not in _BACKENDS:
        raise InputError(f"backend {requested!r}", where="rasterise", expected=f"one of auto, {', '.join(_BACKENDS)}")
    if requested == "native" and device.type != "cpu":
        raise InputError(f"native on {device}", where="rasterise", expected="the CPU", remedy="use `cuda` or `auto`")
    if requested == "gsplat" and not (device.type == "cuda" and dtype == torch.float32 and gsplat_installed()):
        raise InputError(f"gsplat on {device} in {dtype}", where="rasterise", expected="the package, CUDA and float32")
    return requested


_BACKENDS = {
    "native": rasterise_native,
    "cuda": rasterise_cuda,
    "gsplat": rasterise_gsplat,
    "warp": partial(_in_camera_frame, rasterise_warp),
    "reference": partial(_in_camera_frame, rasterise_reference),
}


def _check(means: Tensor, covariances: Tensor, opacities: Tensor, colours: Tensor) -> None:
    count = len(means)
    got = [tuple(a.shape) for a in (means, covariances, opacities, colours)]
    if got != [(count, 3), (count, 3, 3), (count,), (count, 3)]:
        raise InputError(f"shapes {got}", where="rasterise", expected="[G, 3], [G, 3, 3], [G], [G, 3]")
    kinds = {(a.dtype, a.device) for a in (means, covariances, opacities, colours)}
    if len(kinds) > 1 or means.dtype not in (torch.float32, torch.float64):
        raise InputError(
            f"{sorted(map(str, kinds))}", where="rasterise", expected="all float32 or float64, on one device"
        )
