"""Gaussians carried by particles in one pass, forward and backward: the C++ of `cuda/carrying.h` on CUDA and on the CPU.

Twin: `binding.carry_gaussians_plain`.
"""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import torch
import warp as wp
from torch.autograd.function import once_differentiable

from physreal_core.native import launch_on_threads, native_module, on_torch_stream

_WORDS = 18  # members of Carrying in cuda/carrying.h
_POINTS_A_THREAD = 4_000  # a thread with less work than this costs more to start than it saves


class CarryGaussians(torch.autograd.Function):
    """Means [T, G, 3] m and covariances [T, G, 3, 3] m^2 from x [T, N, 3] m and F [T, N, 3, 3], which get a gradient.

    The rest is fixed: neighbours [G, m] (int32) and weights [G, m], x0 [N, 3] and means0 [G, 3] m, covariances0 [G, 3, 3] m^2.
    """

    @staticmethod
    def forward(ctx, x, F, neighbours, weights, x0, means0, covariances0):
        tensors = [a.detach().contiguous() for a in (neighbours, weights, x0, means0, covariances0, x, F)]
        means = x.new_empty(len(x), len(means0), 3)
        covariances = x.new_empty(len(x), len(means0), 3, 3)
        _launch("carry", tensors, (means, covariances, None, None, None, None))
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*tensors)
        return means, covariances

    @staticmethod
    @once_differentiable
    def backward(ctx, means_bar, covariances_bar):
        tensors = ctx.saved_tensors
        x_bar, F_bar = torch.zeros_like(tensors[5]), torch.zeros_like(tensors[6])
        bars = [None if a is None else a.contiguous() for a in (means_bar, covariances_bar)]
        _launch("carry_adjoint", tensors, (None, None, *bars, x_bar, F_bar))
        return x_bar, F_bar, None, None, None, None, None


def _launch(phase: str, tensors, outputs) -> None:
    neighbours, x = tensors[0], tensors[5]
    kernels = _kernels({torch.float32: "float", torch.float64: "double"}[x.dtype])
    frames, (points, count), work = len(x), neighbours.shape, len(x) * len(neighbours)
    if work == 0:
        return
    threads = max(1, min(torch.get_num_threads(), frames, work // _POINTS_A_THREAD))
    pointers = [0 if a is None else a.data_ptr() for a in (*tensors, *outputs)]
    carrying = kernels.Carrying(frames, points, x.shape[1], count, threads, *pointers)
    if not x.is_cuda:
        launch_on_threads(getattr(kernels, phase), threads, carrying)
        return
    with on_torch_stream(x.device):
        wp.launch(getattr(kernels, f"{phase}_all"), work, [carrying], device=wp.device_from_torch(x.device))


@cache
def _kernels(scalar: str) -> SimpleNamespace:
    """`carry` and `carry_adjoint` by thread, and the same over all threads of a CUDA launch."""
    wp.init()
    header = Path(__file__).parent / "cuda" / "carrying.h"
    module = native_module(f"physreal_carrying_{scalar}", header, cuda=True)
    carrying_type = wp.types.vector(_WORDS, wp.uint64)

    def phase(name: str, *, whole_launch: bool) -> wp.Kernel:
        @wp.func_native(f"physreal::{name}(*(const physreal::Carrying<{scalar}>*)&carrying, thread);")
        def call(carrying: carrying_type, thread: int): ...

        def one(carrying: carrying_type, thread: int):
            call(carrying, thread)

        def each(carrying: carrying_type):
            call(carrying, wp.tid())

        kernel = each if whole_launch else one
        kernel.__name__ = kernel.__qualname__ = f"{name}_all" if whole_launch else name
        return wp.kernel(kernel, module=module)

    kernels = [phase(name, whole_launch=w) for name in ("carry", "carry_adjoint") for w in (False, True)]
    return SimpleNamespace(Carrying=carrying_type, **{kernel.func.__name__: kernel for kernel in kernels})
