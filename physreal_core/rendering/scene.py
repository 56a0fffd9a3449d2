"""`Scene` of native/scene.h as Python sees it: what a rendering's phases share, and who owns its working arrays."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from functools import cache

import torch

from physreal_core.array_types import Tensor
from physreal_core.rendering.camera import Camera
from physreal_core.rendering.reference import (
    ALPHA_MAX,
    ALPHA_MIN,
    LOW_PASS,
    NEAR,
    TRANSMITTANCE_MIN,
    jacobian_limits,
)

TILE = 16  # [px]
SPLAT, MOMENTS, BOX = 16, 16, 4  # numbers a Gaussian in the working arrays
SCALARS = {torch.float32: "float", torch.float64: "double"}

# The fields of Scene, group by group.
_COUNTS = ("count", "frames", "threads", "width", "height", "tiles_x", "tiles_y", "pair_count")
_NUMBERS = (
    *("fx", "fy", "cx", "cy", "x_low", "x_high", "y_low", "y_high"),
    *("near", "low_pass", "alpha_min", "alpha_max", "transmittance_min"),
)
INPUTS = ("means", "covariances", "opacities", "colours", "pose", "background")
_WORKING = (
    *("splats", "boxes", "starts", "lists"),
    *("pairs", "cursors", "keys", "other_keys", "order", "other_order"),
    *("counts", "ends", "ranks", "pair_keys"),
)
OUTPUTS = ("rgb", "depth", "alpha", "transmittance")
OUTPUT_BARS = ("rgb_bar", "depth_bar", "alpha_bar")
INPUT_BARS = ("means_bar", "covariances_bar", "opacities_bar", "colours_bar")


class Scene:
    """One rendering: the structure that the kernels see, and the working arrays that stay from the image to the gradient."""

    def __init__(self, like: Tensor, camera: Camera, frames: int) -> None:
        self.like, self.size = like.new_empty(0), (frames, camera.height, camera.width)
        self.fields = f = _structure(SCALARS[like.dtype])()
        f.count, f.frames, f.width, f.height = len(like), frames, camera.width, camera.height
        f.tiles_x, f.tiles_y = -(-camera.width // TILE), -(-camera.height // TILE)
        f.fx, f.fy, f.cx, f.cy = camera.intrinsics
        f.x_low, f.x_high, f.y_low, f.y_high = jacobian_limits(camera)
        f.near, f.low_pass, f.alpha_min, f.alpha_max = NEAR, LOW_PASS, ALPHA_MIN, ALPHA_MAX
        f.transmittance_min = TRANSMITTANCE_MIN
        self.held: dict[str, Tensor] = {}

    @staticmethod
    def words(scalar: str) -> int:
        """Length of the structure in words of 8 bytes."""
        return ctypes.sizeof(_structure(scalar)) // 8

    @property
    def tiles(self) -> int:
        """Number of tiles of all images."""
        return self.fields.frames * self.fields.tiles_x * self.fields.tiles_y

    def hold(self, name: str, length: int, dtype: torch.dtype | None = None) -> Tensor:
        """A new working array of this name, uninitialised."""
        return self.keep(name, torch.empty(length, dtype=dtype or self.like.dtype, device=self.like.device))

    def keep(self, name: str, array: Tensor) -> Tensor:
        """Take `array` for the working array of this name."""
        self.held[name] = array
        setattr(self.fields, name, array.data_ptr())
        return array

    def release(self, *names: str) -> None:
        """Let working arrays go."""
        for name in names:
            del self.held[name]

    def point(self, names: Sequence[str], tensors: Sequence[Tensor | None]) -> None:
        """Let fields point at tensors that somebody else keeps, or at nothing."""
        for name, tensor in zip(names, tensors, strict=True):
            setattr(self.fields, name, None if tensor is None else tensor.data_ptr())

    def outputs(self) -> list[Tensor]:
        """New RGB, depth, alpha and transmittance; the fields point at them."""
        outputs = [self.like.new_empty(*self.size, *tail) for tail in ((3,), (), (), ())]
        self.point(OUTPUTS, outputs)
        return outputs


@cache
def _structure(scalar: str) -> type[ctypes.Structure]:
    number = {"float": ctypes.c_float, "double": ctypes.c_double}[scalar]
    fields = [(name, ctypes.c_longlong) for name in _COUNTS] + [(name, number) for name in _NUMBERS]
    pointers = (*INPUTS, *_WORKING, *OUTPUTS, *OUTPUT_BARS, "moments", *INPUT_BARS, "pose_bar")
    return type("Scene", (ctypes.Structure,), {"_fields_": fields + [(name, ctypes.c_void_p) for name in pointers]})
