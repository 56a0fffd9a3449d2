"""What the native and the CUDA rasteriser look like to autograd: one function with a backward written by hand."""

from __future__ import annotations

import torch
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Tensor
from physreal_core.rendering.camera import Camera


def rasterise_with(
    run: type,
    means: Tensor,
    covariances: Tensor,
    opacities: Tensor,
    colours: Tensor,
    pose: Tensor,
    background: Tensor,
    camera: Camera,
) -> tuple[Tensor, Tensor, Tensor]:
    """RGB, depth and alpha by `run(means, camera, frames)` with its `forward(inputs)` and `backward(inputs, outputs, bars)`.

    Means [..., G, 3], covariances [..., G, 3, 3], opacities [..., G] and colours [..., G, 3] have the same leading axes.
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
