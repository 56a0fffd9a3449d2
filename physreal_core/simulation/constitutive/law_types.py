"""Warp types and rounding tolerances of one scalar type, so that every law is written once for float32 and float64."""

from dataclasses import dataclass
from functools import cache

import warp as wp


@dataclass(frozen=True)
class LawTypes:
    """Warp types over one scalar.

    Attributes:
        scalar: `wp.float32` or `wp.float64`.
        vec2, vec3, mat33: its vectors and 3x3 matrix.
        tolerance: change of a Newton or Jacobi iterate below which the next, quadratically smaller one is rounding.
        rounding: relative rounding error of a product.
    """

    scalar: type
    vec2: type
    vec3: type
    mat33: type
    tolerance: float
    rounding: float


_TYPES = {
    wp.float32: LawTypes(wp.float32, wp.vec2f, wp.vec3f, wp.mat33f, 2e-4, 2e-7),
    wp.float64: LawTypes(wp.float64, wp.vec2d, wp.vec3d, wp.mat33d, 1e-8, 4e-16),
}


def law_types(scalar: type) -> LawTypes:
    """Types over `scalar` (`wp.float32` or `wp.float64`; `KeyError` for any other)."""
    return _TYPES[scalar]


@cache
def adjoint_struct(scalar: type) -> type:
    """Struct that `stress_adjoint` returns: adjoints of `F`, `E`, `nu`, and the stress `tau` itself, free by then."""
    t = law_types(scalar)
    mat33 = t.mat33

    @wp.struct
    class StressAdjoint:
        F: mat33
        E: scalar
        nu: scalar
        tau: mat33

    return StressAdjoint
