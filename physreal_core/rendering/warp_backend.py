"""The Warp rasteriser as one torch function: launches `kernels.py`, tile lists by prefix sum and a stable sort."""

from __future__ import annotations

import torch
import warp as wp
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Float, Tensor
from physreal_core.native import on_torch_stream
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.kernels import raster_kernels
from physreal_core.rendering.reference import jacobian_limits

# [px] On a GPU a tile is a block of 256 threads; on the CPU (pixels one by one) smaller tiles test fewer Gaussians.
TILE_CUDA, TILE_CPU = 16, 8
_SCALARS = {torch.float32: wp.float32, torch.float64: wp.float64}


def rasterise_warp(
    means: Float[Tensor, "gaussians 3"],
    covariances: Float[Tensor, "gaussians 3 3"],
    opacities: Float[Tensor, " gaussians"],
    features: Float[Tensor, "gaussians 4"],
    camera: Camera,
    tile: int | None = None,
) -> tuple[Float[Tensor, "height width 4"], Float[Tensor, "height width"]]:
    """Composite Gaussians given in the camera's frame [m]; the same result as `rasterise_reference`, with gradients."""
    tile = tile or (TILE_CUDA if means.is_cuda else TILE_CPU)
    image, transmittance = _Rasterise.apply(means, covariances, opacities, features, camera, tile)
    return image, 1.0 - transmittance


class _Rasterise(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, covariances, opacities, features, camera, tile):
        kernels = raster_kernels(_SCALARS[means.dtype])
        tensors = [a.detach().contiguous() for a in (means, covariances, opacities, features)]
        device = wp.device_from_torch(means.device)
        with on_torch_stream(means.device):
            view = _View(kernels, camera, tile)
            splats, boxes, counts = _project(kernels, view, tensors, device)
            starts, pair_splats = _tile_lists(kernels, view, tensors[0][:, 2], boxes, counts, device)
            image = means.new_empty(camera.height, camera.width, 4)
            transmittance = means.new_empty(camera.height, camera.width)
            scene = [starts, pair_splats, splats, _array(tensors[3], kernels.vec4), *view.pixels]
            outputs = [_array(image, kernels.vec4), _array(transmittance, kernels.scalar)]
            wp.launch(kernels.composite, view.threads, [*scene, *outputs], device=device, block_dim=tile * tile)
        ctx.kernels, ctx.view, ctx.device, ctx.scene, ctx.counts = kernels, view, device, scene, counts
        ctx.save_for_backward(*tensors, image, transmittance)
        return image, transmittance

    @staticmethod
    @once_differentiable
    def backward(ctx, image_bar, transmittance_bar):
        means, covariances, opacities, features, image, transmittance = ctx.saved_tensors
        kernels, view, device = ctx.kernels, ctx.view, ctx.device
        moments = means.new_zeros(len(means), 6)
        bars = [torch.zeros_like(a) for a in (means, covariances, opacities, features)]
        with on_torch_stream(means.device):
            pixels = [_array(a.contiguous(), kernels.vec4) for a in (image, image_bar)]
            rest = [_array(a.contiguous(), kernels.scalar) for a in (transmittance, transmittance_bar)]
            outputs = [_array(moments, kernels.vec6), _array(bars[3], kernels.vec4)]
            inputs = [*ctx.scene, pixels[0], rest[0], pixels[1], rest[1], *outputs]
            wp.launch(kernels.composite_adjoint, view.threads, inputs, device=device, block_dim=view.tile**2)
            inputs = [
                _array(means, kernels.vec3), _array(covariances, kernels.mat33), view.intrinsics, view.limits,
                ctx.counts, ctx.scene[2], outputs[0],
                _array(bars[0], kernels.vec3), _array(bars[1], kernels.mat33), _array(bars[2], kernels.scalar),
            ]  # fmt: skip
            wp.launch(kernels.project_adjoint, len(means), inputs, device=device)
        return *bars, None, None


class _View:
    """What the kernels need to know of a camera: intrinsics, limits, tiles."""

    def __init__(self, kernels, camera: Camera, tile: int) -> None:
        self.tile = tile
        self.tiles_x, self.tiles_y = -(-camera.width // tile), -(-camera.height // tile)
        self.threads = self.tiles_x * self.tiles_y * tile * tile
        self.intrinsics, self.limits = kernels.vec4(*camera.intrinsics), kernels.vec4(*jacobian_limits(camera))
        self.pixels = [tile, self.tiles_x, camera.width, camera.height]


def _project(kernels, view: _View, tensors: list[Tensor], device: wp.Device):
    count = len(tensors[0])
    splats = wp.empty(count, dtype=kernels.Splat, device=device)
    boxes = wp.empty(count, dtype=wp.vec4i, device=device)
    counts = wp.empty(count, dtype=wp.int32, device=device)
    inputs = [_array(a, t) for a, t in zip(tensors, (kernels.vec3, kernels.mat33, kernels.scalar), strict=False)]
    inputs += [view.intrinsics, view.limits, view.tile, view.tiles_x, view.tiles_y, splats, boxes, counts]
    wp.launch(kernels.project, count, inputs, device=device)
    return splats, boxes, counts


def _tile_lists(kernels, view: _View, depth: Tensor, boxes: wp.array, counts: wp.array, device: wp.Device):
    """Per tile the Gaussians that reach it, near ones first: where each tile starts, and the Gaussians' ids."""
    order = torch.argsort(depth, stable=True)
    offsets = torch.cumsum(wp.to_torch(counts)[order], dim=0)
    pairs = int(offsets[-1]) if len(offsets) else 0
    pair_tiles, pair_splats = (torch.empty(pairs, dtype=torch.int32, device=depth.device) for _ in range(2))
    inputs = [_array(order, wp.int64), _array(offsets, wp.int64), boxes, counts, view.tiles_x]
    inputs += [_array(pair_tiles, wp.int32), _array(pair_splats, wp.int32)]
    wp.launch(kernels.list_tiles, len(order), inputs, device=device)
    # Stable: inside a tile the pairs stay in depth order.
    pair_tiles, permutation = torch.sort(pair_tiles, stable=True)
    edges = torch.arange(view.tiles_x * view.tiles_y + 1, dtype=torch.int32, device=depth.device)
    starts = torch.searchsorted(pair_tiles, edges, out_int32=True)
    return _array(starts, wp.int32), _array(pair_splats[permutation], wp.int32)


def _array(tensor: Tensor, dtype: type) -> wp.array:
    return wp.from_torch(tensor.detach(), dtype=dtype)
