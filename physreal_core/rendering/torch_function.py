"""The native and the CUDA rasteriser to autograd: one function with a backward written by hand."""

from __future__ import annotations

import torch
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Float, Tensor
from physreal_core.rendering.camera import Camera


def rasterise_with(
    run: type,
    means: Float[Tensor, "*frames gaussians 3"],
    covariances: Float[Tensor, "*frames gaussians 3 3"],
    opacities: Float[Tensor, "*frames gaussians"],
    colours: Float[Tensor, "*frames gaussians 3"],
    camera: Camera,
    pose: Float[Tensor, "4 4"],
    background: Float[Tensor, " 3"],
) -> tuple[
    Float[Tensor, "*frames height width 3"],
    Float[Tensor, "*frames height width"],
    Float[Tensor, "*frames height width"],
]:
    """RGB over the background, depth [m] and alpha of Gaussians given in the world [m]; gradients reach every tensor.

    Frames share the view; all of them are drawn in the same launches, by `run(means, camera, frames)` with its
    `forward(inputs)` and `backward(inputs, outputs, bars)`.
    """
    frames = means.shape[:-2]
    flat = means.reshape(-1, 3), covariances.reshape(-1, 3, 3), opacities.reshape(-1), colours.reshape(-1, 3)
    outputs = _Rasterise.apply(*flat, pose, background, camera, frames.numel(), run)
    return tuple(a.reshape(*frames, *a.shape[1:]) for a in outputs)


class _Rasterise(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, covariances, opacities, colours, pose, background, camera, frames, run):
        inputs = [a.detach().contiguous() for a in (means, covariances, opacities, colours, pose, background)]
        ctx.run = run(inputs[0], camera, frames)
        outputs = ctx.run.forward(inputs)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs, *outputs)
        return tuple(outputs[:3])

    @staticmethod
    @once_differentiable
    def backward(ctx, *bars):
        if all(bar is None for bar in bars):
            return (None,) * 9
        inputs, outputs = ctx.saved_tensors[:6], ctx.saved_tensors[6:]
        bars = [None if bar is None else bar.contiguous() for bar in bars]
        *gradients, pose_bar = ctx.run.backward(inputs, outputs, bars)
        if ctx.needs_input_grad[4]:
            gradients.append(torch.cat([pose_bar, pose_bar.new_zeros(1, 4)]))
        else:
            gradients.append(None)
        background_bar = None
        if ctx.needs_input_grad[5] and bars[0] is not None:
            background_bar = torch.einsum("thw,thwc->c", outputs[3], bars[0])
        return *gradients, background_bar, None, None, None
