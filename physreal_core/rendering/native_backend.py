"""The rasteriser on the CPU as a run for `torch_function`: projection, tile lists and compositing in the C++ of `native/`.

Twin: `reference.py`. Equal inputs and numbers of threads give equal bits; the image depends on no number of threads at all.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import torch
import warp as wp

from physreal_core.array_types import Tensor
from physreal_core.native import launch_on_threads, native_module
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.scene import BOX, INPUT_BARS, INPUTS, MOMENTS, OUTPUT_BARS, OUTPUTS, SCALARS, SPLAT, Scene

# A thread with less work than this costs more to start than it saves.
_GAUSSIANS_A_THREAD, _PAIRS_A_THREAD = 10_000, 10_000
_ONLY_FOR_LISTS = ("pairs", "cursors", "keys", "other_keys", "order", "other_order")
_PHASES = ("project", "list_tiles", "composite", "composite_adjoint", "project_adjoint")


class NativeRun:
    """One rendering, forward and backward."""

    def __init__(self, means: Tensor, camera: Camera, frames: int) -> None:
        self.scene, self.kernels, self.threads = Scene(means, camera, frames), _kernels(SCALARS[means.dtype]), 1

    def forward(self, inputs: list[Tensor]) -> list[Tensor]:
        """RGB, depth, alpha and transmittance."""
        s, count = self.scene, len(inputs[0])
        s.point(INPUTS, inputs)
        s.hold("splats", count * SPLAT)
        s.hold("boxes", count * BOX, torch.int32)
        threads = _threads(count, _GAUSSIANS_A_THREAD)
        pairs = s.hold("pairs", threads, torch.int64)
        self._launch("project", threads)
        pairs = int(pairs.sum())
        for name in ("keys", "other_keys"):
            s.hold(name, count)  # as wide as the depths that they are the bits of
        for name in ("order", "other_order"):
            s.hold(name, count, torch.int32)
        s.hold("starts", s.tiles + 1, torch.int32)
        s.hold("cursors", s.tiles, torch.int32)
        s.hold("lists", pairs, torch.int32)
        self._launch("list_tiles", 1)
        s.release(*_ONLY_FOR_LISTS)
        outputs = s.outputs()
        self.threads = _threads(pairs, _PAIRS_A_THREAD)
        self._launch("composite", self.threads)
        return outputs

    def backward(self, inputs: list[Tensor], outputs: list[Tensor], bars: list[Tensor | None]) -> list[Tensor]:
        """Derivatives by means, covariances, opacities, colours and pose."""
        s, threads = self.scene, self.threads
        gradients = [torch.empty_like(a) for a in inputs[:4]]
        s.point((*INPUTS, *OUTPUTS, *OUTPUT_BARS, *INPUT_BARS), (*inputs, *outputs, *bars, *gradients))
        s.hold("moments", threads * len(inputs[0]) * MOMENTS)
        pose_bar = s.hold("pose_bar", threads * 12)
        self._launch("composite_adjoint", threads)
        self._launch("project_adjoint", threads)
        s.release("moments", "pose_bar")
        return [*gradients, pose_bar.view(threads, 3, 4).sum(dim=0)]

    def _launch(self, phase: str, threads: int) -> None:
        self.scene.fields.threads = threads
        launch_on_threads(getattr(self.kernels, phase), threads, ctypes.addressof(self.scene.fields))


def _threads(work: int, least: int) -> int:
    return max(1, min(torch.get_num_threads(), work // least))


@cache
def _kernels(scalar: str) -> SimpleNamespace:
    """The phases of native/rasteriser.h by name; each takes the scene's address and the thread's number."""
    wp.init()
    module = native_module(f"physreal_rasteriser_{scalar}", Path(__file__).parent / "native" / "rasteriser.h")

    def phase(name: str) -> wp.Kernel:
        @wp.func_native(f"physreal::{name}(*(const physreal::Scene<{scalar}>*)scene, thread);")
        def call(scene: wp.uint64, thread: int): ...

        def kernel(scene: wp.uint64, thread: int):
            call(scene, thread)

        kernel.__name__ = kernel.__qualname__ = name
        return wp.kernel(kernel, module=module)

    return SimpleNamespace(**{name: phase(name) for name in _PHASES})
