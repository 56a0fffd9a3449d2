"""Warp types of one floating-point width, and the Warp module that the kernels of one family and width live in."""

import functools
from dataclasses import dataclass
from typing import Any

import torch
import warp as wp

wp.config.log_level = wp.LOG_WARNING  # else compile notes run through every progress bar


@dataclass(frozen=True)
class ScalarTypes:
    """Scalar, vector and matrix types of one width, in Warp and in torch."""

    name: str
    scalar: Any
    vec2: Any
    vec3: Any
    vec4: Any
    mat33: Any
    torch_dtype: torch.dtype


@functools.cache
def scalar_types(dtype: str) -> ScalarTypes:
    """Types of `dtype`, "float32" or "float64"."""
    if dtype == "float32":
        return ScalarTypes(dtype, wp.float32, wp.vec2f, wp.vec3f, wp.vec4f, wp.mat33f, torch.float32)
    return ScalarTypes(dtype, wp.float64, wp.vec2d, wp.vec3d, wp.vec4d, wp.mat33d, torch.float64)
