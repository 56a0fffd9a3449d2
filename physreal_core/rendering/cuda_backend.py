"""The rasteriser on CUDA as a run for `torch_function`: projection, tile lists and compositing in the C++ of `cuda/`.

Twin: `reference.py`. The same code runs on the CPU, slowly, where the tests hold it to the twin.
"""

from functools import cache
from pathlib import Path
from types import SimpleNamespace

import torch
import warp as wp

from physreal_core.array_types import Tensor
from physreal_core.native import native_module, on_torch_stream
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.scene import BOX, INPUT_BARS, INPUTS, MOMENTS, OUTPUT_BARS, OUTPUTS, SCALARS, SPLAT, Scene

_BLOCK = 128  # threads that draw a tile, as in cuda/compositing.h
_WARP = 32
_PHASES = ("project", "list_tiles", "find_starts", "composite_tile", "composite_tile_adjoint", "project_adjoint")


class CudaRun:
    """One rendering, forward and backward, on torch's current stream."""

    def __init__(self, means: Tensor, camera: Camera, frames: int) -> None:
        self.scene, self.kernels = Scene(means, camera, frames), _kernels(SCALARS[means.dtype])
        self.device = wp.device_from_torch(means.device)

    def forward(self, inputs: list[Tensor]) -> list[Tensor]:
        """RGB, depth, alpha and transmittance."""
        s, count = self.scene, len(inputs[0])
        with on_torch_stream(self.scene.like.device):
            s.point(INPUTS, inputs)
            s.hold("splats", count * SPLAT)
            s.hold("boxes", count * BOX, torch.int32)
            counts = s.hold("counts", count, torch.int32)
            self._launch("project", count)
            s.keep("ends", torch.cumsum(counts, dim=0, dtype=torch.int32))
            self._sort_pairs(inputs)
            outputs = s.outputs()
            self._launch("composite_tile", s.tiles, block=_BLOCK)
        return outputs

    def _sort_pairs(self, inputs: list[Tensor]) -> None:
        """Lists of the tiles' Gaussians, near ones first, and where each tile's begins."""
        s, count = self.scene, len(inputs[0])
        # The one time the host waits: how long the lists are.
        pairs = s.fields.pair_count = int(s.held["ends"][-1]) if count else 0
        keys, lists = s.hold("pair_keys", 2 * pairs, torch.int64), s.hold("lists", 2 * pairs, torch.int32)
        if s.like.dtype == torch.float64:  # a key has room for 32 bits of depth: of a finer one, its place
            depth = (inputs[0] - inputs[4][:3, 3]) @ inputs[4][:3, 2]
            order = torch.argsort(depth, stable=True)
            s.keep("ranks", torch.empty_like(order, dtype=torch.int32)).scatter_(
                0, order, torch.arange(count, dtype=torch.int32, device=order.device)
            )
        self._launch("list_tiles", count)
        if pairs:
            end = 32 + (s.tiles - 1).bit_length()
            wp.utils.radix_sort_pairs(wp.from_torch(keys, wp.int64), wp.from_torch(lists, wp.int32), pairs, 0, end)
        s.hold("starts", s.tiles + 1, torch.int32)
        self._launch("find_starts", pairs + 1)
        s.release("pair_keys", "ends")

    def backward(self, inputs: list[Tensor], outputs: list[Tensor], bars: list[Tensor | None]) -> list[Tensor]:
        """Derivatives by means, covariances, opacities, colours and pose."""
        s, count = self.scene, len(inputs[0])
        with on_torch_stream(self.scene.like.device):
            gradients = [torch.empty_like(a) for a in inputs[:4]]
            s.point((*INPUTS, *OUTPUTS, *OUTPUT_BARS, *INPUT_BARS), (*inputs, *outputs, *bars, *gradients))
            sums = s.keep("moments", s.like.new_zeros(count * MOMENTS + 12))
            pose_bar = sums[count * MOMENTS :]
            s.point(["pose_bar"], [pose_bar])
            self._launch("composite_tile_adjoint", s.tiles, block=_BLOCK)
            self._launch("project_adjoint", count)
            s.release("moments")
        return [*gradients, pose_bar.view(3, 4)]

    def _launch(self, phase: str, count: int, block: int | None = None) -> None:
        """`count` threads in whole warps, or blocks; on the CPU one thread stands for a block."""
        if self.device.is_cuda:
            count = count * block if block else -(-count // _WARP) * _WARP
        kernels, fields = self.kernels, self.scene.fields
        scene = kernels.Scene.from_buffer_copy(fields)
        wp.launch(getattr(kernels, phase), count, [scene], device=self.device, block_dim=block or 128)


@cache
def _kernels(scalar: str) -> SimpleNamespace:
    """The phases of cuda/rasteriser.h by name; each takes the scene, as so many bytes."""
    wp.init()
    here = Path(__file__).parent
    module = native_module(
        f"physreal_rasteriser_cuda_{scalar}", here / "cuda" / "rasteriser.h", here / "native", cuda=True
    )
    scene_type = wp.types.vector(Scene.words(scalar), wp.uint64)

    def phase(name: str) -> wp.Kernel:
        @wp.func_native(f"physreal::{name}(*(const physreal::Scene<{scalar}>*)&scene, thread);")
        def call(scene: scene_type, thread: int): ...

        def kernel(scene: scene_type):
            call(scene, wp.tid())

        kernel.__name__ = kernel.__qualname__ = name
        return wp.kernel(kernel, module=module)

    return SimpleNamespace(Scene=scene_type, **{name: phase(name) for name in _PHASES})
