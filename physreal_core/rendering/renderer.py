"""The rasteriser's one public function: Gaussians in the world to RGB, depth and alpha, all differentiable."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, partial

import torch

from physreal_core.array_types import Float, Tensor
from physreal_core.errors import InputError
from physreal_core.rendering.binding import Binding, carried_rotations, carry_gaussians
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.cuda_backend import CudaRun
from physreal_core.rendering.gaussians import Gaussians
from physreal_core.rendering.gsplat_backend import gsplat_installed, rasterise_gsplat
from physreal_core.rendering.native_backend import NativeRun
from physreal_core.rendering.reference import ALPHA_MIN, rasterise_reference
from physreal_core.rendering.torch_function import rasterise_with


@dataclass(frozen=True, eq=False)
class Rendering:
    """One rendered view, or several frames of it.

    Args:
        rgb: composited over the background, shape [*frames, H, W, 3].
        depth: expected depth along the camera's z [m], normalised by alpha; 0 where nothing was drawn; shape
            [*frames, H, W].
        alpha: 0 to 1, shape [*frames, H, W].
    """

    rgb: Float[Tensor, "*frames height width 3"]
    depth: Float[Tensor, "*frames height width"]
    alpha: Float[Tensor, "*frames height width"]


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
        means: centres in the world [m], shape [G, 3]; or of several frames, drawn at once, [*frames, G, 3].
        covariances: in the world [m^2], shape [*frames, G, 3, 3]; only the symmetric part is used.
        opacities: 0 to 1, shape [G] for all frames, or [*frames, G].
        colours: RGB, 0 to 1, shape [G, 3] for all frames, or [*frames, G, 3].
        T_world_camera: pose used instead of the camera's own, for pose gradients.
        background: RGB.
        backend: "auto", "native" (vector C++, CPU), "cuda" (CUDA; on the CPU for tests), "gsplat" (needs CUDA and the
            package) or "reference" (plain torch, any device, slow).

    Returns:
        Rendering in the dtype and on the device of `means` (float32 or float64).

    Raises:
        InputError: for shapes or types that do not fit, and for a backend that is unknown or cannot run there.
    """
    opacities, colours = _of_frames(means, covariances, opacities, colours)
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
    """Through a rasteriser that takes one frame in the camera's frame and gives unnormalised features over black."""
    if means.ndim > 2:
        return _frame_by_frame(
            partial(_in_camera_frame, draw), means, covariances, opacities, colours, camera, pose, background
        )
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
    still: Gaussians | None = None,
    backend: str = "auto",
) -> Rendering:
    """Render a model carried by its particles (eqs. gs_binding, physics_rendering), beside Gaussians that stay where they are; differentiable in x
    and F."""
    means, covariances = carry_gaussians(binding, gaussians, x0, x, F)
    turned = carried_rotations(binding, F) if gaussians.harmonics.shape[1] > 1 else None
    colours = gaussians.colours(camera.centre, means, turned).to(means)
    opacities = gaussians.opacities().to(means)
    if still is not None:
        means, covariances = (
            torch.cat([means, still.means.to(means)]),
            torch.cat([covariances, still.covariances().to(means)]),
        )
        colours = torch.cat([colours, still.colours(camera.centre).to(means)])
        opacities = torch.cat([opacities, still.opacities().to(means)])
    return rasterise(means, covariances, opacities, colours, camera, background=background, backend=backend)


def choose_backend(device: torch.device, dtype: torch.dtype, requested: str = "auto") -> str:
    """The backend that will draw: as requested; "auto" is "native" on the CPU and "cuda" on CUDA.

    Raises:
        InputError: for an unknown name or one that cannot run here.
    """
    if requested not in ("auto", *_BACKENDS):
        raise InputError(f"backend {requested!r}", where="rasterise", expected=f"one of auto, {', '.join(_BACKENDS)}")
    if requested != "reference" and device.type not in ("cpu", "cuda"):
        raise InputError(
            f"Gaussians on {device}",
            where="rasterise",
            expected="the CPU or a CUDA device",
            remedy='move them there, or draw with `backend="reference"`',
        )
    if requested == "auto":
        return "cuda" if device.type == "cuda" else "native"
    if requested == "native" and device.type != "cpu":
        raise InputError(f"native on {device}", where="rasterise", expected="the CPU", remedy="use `cuda` or `auto`")
    if requested == "gsplat" and not (device.type == "cuda" and dtype == torch.float32 and gsplat_installed()):
        raise InputError(f"gsplat on {device} in {dtype}", where="rasterise", expected="the package, CUDA and float32")
    return requested


def _through_gsplat(means: Tensor, *rest) -> tuple[Tensor, ...]:
    return _frame_by_frame(rasterise_gsplat, means, *rest) if means.ndim > 2 else rasterise_gsplat(means, *rest)


_BACKENDS = {
    "native": partial(rasterise_with, NativeRun),
    "cuda": partial(rasterise_with, CudaRun),
    "gsplat": _through_gsplat,
    "reference": partial(_in_camera_frame, rasterise_reference),
}


def _of_frames(means: Tensor, covariances: Tensor, opacities: Tensor, colours: Tensor) -> tuple[Tensor, Tensor]:
    """Opacities and colours with the frames that the means have; InputError where shapes or types do not fit."""
    frames, count = means.shape[:-2], means.shape[-2] if means.ndim > 1 else 0
    got = [tuple(a.shape) for a in (means, covariances, opacities, colours)]
    shared, own = [(count,), (count, 3)], [(*frames, count), (*frames, count, 3)]
    fits = got[:2] == [(*frames, count, 3), (*frames, count, 3, 3)] and means.ndim > 1
    if not fits or any(
        shape not in either for shape, either in zip(got[2:], zip(shared, own, strict=True), strict=True)
    ):
        raise InputError(
            f"shapes {got}", where="rasterise", expected="[G, 3], [G, 3, 3], [G], [G, 3], or these after [*frames]"
        )
    kinds = {(a.dtype, a.device) for a in (means, covariances, opacities, colours)}
    if len(kinds) > 1 or means.dtype not in (torch.float32, torch.float64):
        raise InputError(
            f"{sorted(map(str, kinds))}", where="rasterise", expected="all float32 or float64, on one device"
        )
    return opacities.expand(own[0]), colours.expand(own[1])


def _frame_by_frame(draw, means, covariances, opacities, colours, *view) -> tuple[Tensor, ...]:
    """Frames through a rasteriser that draws one at a time."""
    frames = means.shape[:-2]
    parts = [a.flatten(0, len(frames) - 1).unbind(0) for a in (means, covariances, opacities, colours)]
    drawn = [draw(*gaussians, *view) for gaussians in zip(*parts, strict=True)]
    return tuple(torch.stack(outputs).unflatten(0, frames) for outputs in zip(*drawn, strict=True))
