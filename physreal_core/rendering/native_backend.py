"""The rasteriser on the CPU as one torch function: projection, tile lists and compositing in the C++ of `native/`.

Twin: `reference.py`. Equal inputs and numbers of threads give equal bits; the image depends on no number of threads at all.
"""

from __future__ import annotations

import ctypes
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import torch
import warp as wp
from torch.autograd.function import once_differentiable

from physreal_core.array_types import Float, Tensor
from physreal_core.native import launch_on_threads, native_module
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.reference import (
    ALPHA_MAX,
    ALPHA_MIN,
    LOW_PASS,
    NEAR,
    TRANSMITTANCE_MIN,
    jacobian_limits,
)

TILE = 16  # [px], as in native/scene.h
_SPLAT, _MOMENTS, _BOX = 16, 16, 4  # numbers a Gaussian in the working arrays, as in native/scene.h
# A thread with less work than this costs more to start than it saves.
_GAUSSIANS_A_THREAD, _PAIRS_A_THREAD = 4_000, 4_000
_SCALARS = {torch.float32: (ctypes.c_float, torch.int32), torch.float64: (ctypes.c_double, torch.int64)}

# The fields of Scene in native/scene.h, group by group.
_COUNTS = ("count", "threads", "width", "height", "tiles_x", "tiles_y")
_NUMBERS = (
    *("fx", "fy", "cx", "cy", "x_low", "x_high", "y_low", "y_high"),
    *("near", "low_pass", "alpha_min", "alpha_max", "transmittance_min"),
)
_INPUTS = ("means", "covariances", "opacities", "colours", "pose", "background")
_ONLY_FOR_LISTS = ("pairs", "cursors", "keys", "other_keys", "order", "other_order")
_WORKING = ("splats", "boxes", "starts", "lists", *_ONLY_FOR_LISTS)
_OUTPUTS = ("rgb", "depth", "alpha", "transmittance")
_ADJOINTS = (
    *("rgb_bar", "depth_bar", "alpha_bar", "moments"),
    *("means_bar", "covariances_bar", "opacities_bar", "colours_bar", "pose_bar"),
)
_PHASES = ("project", "list_tiles", "composite", "composite_adjoint", "project_adjoint")


def rasterise_native(
    means: Float[Tensor, "gaussians 3"],
    covariances: Float[Tensor, "gaussians 3 3"],
    opacities: Float[Tensor, " gaussians"],
    colours: Float[Tensor, "gaussians 3"],
    camera: Camera,
    pose: Float[Tensor, "4 4"],
    background: Float[Tensor, " 3"],
) -> tuple[Float[Tensor, "height width 3"], Float[Tensor, "height width"], Float[Tensor, "height width"]]:
    """RGB over the background, depth [m] and alpha of Gaussians given in the world [m]; gradients reach every tensor."""
    return _Rasterise.apply(means, covariances, opacities, colours, pose, background, camera)


class _Rasterise(torch.autograd.Function):
    @staticmethod
    def forward(ctx, means, covariances, opacities, colours, pose, background, camera):
        inputs = [a.detach().contiguous() for a in (means, covariances, opacities, colours, pose, background)]
        ctx.run = _Run(means.dtype, len(means), camera)
        outputs = ctx.run.forward(inputs)
        ctx.set_materialize_grads(False)
        ctx.save_for_backward(*inputs, *outputs)
        return tuple(outputs[:3])

    @staticmethod
    @once_differentiable
    def backward(ctx, rgb_bar, depth_bar, alpha_bar):
        if rgb_bar is None and depth_bar is None and alpha_bar is None:
            return (None,) * 7
        inputs, outputs = ctx.saved_tensors[:6], ctx.saved_tensors[6:]
        bars = ctx.run.backward(inputs, outputs, (rgb_bar, depth_bar, alpha_bar))
        background_bar = None
        if ctx.needs_input_grad[5] and rgb_bar is not None:
            background_bar = torch.einsum("hw,hwc->c", outputs[3], rgb_bar)
        return *bars, background_bar, None


class _Run:
    """One rendering: the scene that the kernels see, and the working arrays that stay from the image to the gradient."""

    def __init__(self, dtype: torch.dtype, count: int, camera: Camera) -> None:
        scalar, self.key_type = _SCALARS[dtype]
        self.dtype, self.count, self.size = dtype, count, (camera.height, camera.width)
        self.kernels, self.scene = _kernels(dtype), _scene_type(scalar)()
        s = self.scene
        s.count, s.width, s.height = count, camera.width, camera.height
        s.tiles_x, s.tiles_y = -(-camera.width // TILE), -(-camera.height // TILE)
        s.fx, s.fy, s.cx, s.cy = camera.intrinsics
        s.x_low, s.x_high, s.y_low, s.y_high = jacobian_limits(camera)
        s.near, s.low_pass, s.alpha_min, s.alpha_max = NEAR, LOW_PASS, ALPHA_MIN, ALPHA_MAX
        s.transmittance_min = TRANSMITTANCE_MIN
        self._held: dict[str, Tensor] = {}

    def forward(self, inputs: list[Tensor]) -> list[Tensor]:
        """RGB, depth, alpha and transmittance."""
        s, tiles = self.scene, self.scene.tiles_x * self.scene.tiles_y
        self._point(_INPUTS, inputs)
        self._hold("splats", self.dtype, self.count * _SPLAT)
        self._hold("boxes", torch.int32, self.count * _BOX)
        for name, dtype in (("keys", self.key_type), ("order", torch.int32)):
            self._hold(name, dtype, self.count)
            self._hold(f"other_{name}", dtype, self.count)
        self._hold("starts", torch.int32, tiles + 1)
        self._hold("cursors", torch.int32, tiles)
        threads = s.threads = max(1, min(torch.get_num_threads(), self.count // _GAUSSIANS_A_THREAD))
        self._hold("pairs", torch.int64, threads)
        self._launch("project", threads)
        pairs = int(self._held["pairs"].sum())
        self._hold("lists", torch.int32, pairs)
        self._launch("list_tiles", 1)
        for name in _ONLY_FOR_LISTS:
            del self._held[name]
        outputs = [torch.empty(*self.size, *tail, dtype=self.dtype) for tail in ((3,), (), (), ())]
        self._point(_OUTPUTS, outputs)
        self.threads = s.threads = max(1, min(torch.get_num_threads(), pairs // _PAIRS_A_THREAD))
        self._launch("composite", self.threads)
        return outputs

    def backward(self, inputs, outputs, bars) -> list[Tensor]:
        """Derivatives by means, covariances, opacities, colours and pose."""
        threads = self.threads
        bars = [None if bar is None else bar.contiguous() for bar in bars]
        gradients = [torch.empty_like(a) for a in inputs[:4]]
        self._point(_INPUTS, inputs)
        self._point(_OUTPUTS, outputs)
        self._point(("rgb_bar", "depth_bar", "alpha_bar"), bars)
        self._point([f"{name}_bar" for name in _INPUTS[:4]], gradients)
        self._hold("moments", self.dtype, threads * self.count * _MOMENTS)
        pose_bar = self._hold("pose_bar", self.dtype, threads * 12)
        self._launch("composite_adjoint", threads)
        self._launch("project_adjoint", threads)
        del self._held["moments"]
        pose_bar = torch.cat([pose_bar.view(threads, 3, 4).sum(dim=0), inputs[4].new_zeros(1, 4)])
        return [*gradients, pose_bar]

    def _hold(self, name: str, dtype: torch.dtype, length: int) -> Tensor:
        self._held[name] = array = torch.empty(length, dtype=dtype)
        setattr(self.scene, name, array.data_ptr())
        return array

    def _point(self, names, tensors) -> None:
        for name, tensor in zip(names, tensors, strict=True):
            setattr(self.scene, name, None if tensor is None else tensor.data_ptr())

    def _launch(self, phase: str, threads: int) -> None:
        launch_on_threads(getattr(self.kernels, phase), threads, ctypes.addressof(self.scene))


@cache
def _scene_type(scalar: type) -> type[ctypes.Structure]:
    """`Scene` of native/scene.h, field by field."""
    fields = [(name, ctypes.c_longlong) for name in _COUNTS] + [(name, scalar) for name in _NUMBERS]
    fields += [(name, ctypes.c_void_p) for name in (*_INPUTS, *_WORKING, *_OUTPUTS, *_ADJOINTS)]
    return type("Scene", (ctypes.Structure,), {"_fields_": fields})


@cache
def _kernels(dtype: torch.dtype) -> SimpleNamespace:
    """The phases of native/rasteriser.h by name; each takes the scene's address and the thread's number."""
    wp.config.log_level = wp.LOG_WARNING  # else the banner goes to the standard output of every stage
    wp.init()
    scalar = {torch.float32: "float", torch.float64: "double"}[dtype]
    module = native_module(f"physreal_rasteriser_{scalar}", Path(__file__).parent / "native" / "rasteriser.h")

    def phase(name: str) -> wp.Kernel:
        @wp.func_native(f"physreal::{name}(*(const physreal::Scene<{scalar}>*)scene, thread);")
        def call(scene: wp.uint64, thread: int): ...

        def kernel(scene: wp.uint64, thread: int):
            call(scene, thread)

        kernel.__name__ = kernel.__qualname__ = name
        return wp.kernel(kernel, module=module)

    return SimpleNamespace(**{name: phase(name) for name in _PHASES})
