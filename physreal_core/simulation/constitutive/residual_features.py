"""Rotation-invariant strain features psi(F) of the residuals, smooth everywhere in det F > 0, and their adjoint.

With F = R U: the three elementary symmetric functions of (singular values - 1), that is of U - I (sorted singular
values themselves have no derivative where two meet); the six entries 00, 11, 22, 01, 02, 12 of F^T F - I; and J - 1.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.constitutive.residual_config import STRAIN_FEATURES


@dataclass(frozen=True)
class Features:
    """Warp functions over one scalar type.

    Attributes:
        forward: `(F, R) -> strains`, the ten features; R the polar rotation of F.
        adjoint: `(F, R, strains_bar, R_bar) -> F_bar`, with the adjoint that R carries from elsewhere.
    """

    forward: wp.Function
    adjoint: wp.Function


@cache
def feature_functions(scalar: type) -> Features:
    """The features over `scalar`."""
    mat33 = law_types(scalar).mat33
    half, one, two = scalar(0.5), scalar(1.0), scalar(2.0)
    algebra = linear_algebra(scalar)
    identity_times, symmetric, cofactor = algebra.identity_times, algebra.symmetric, algebra.cofactor
    polar_rotation_adjoint = algebra.polar_rotation_adjoint
    Strains = wp.types.vector(STRAIN_FEATURES, scalar)

    @wp.func
    def forward(F: mat33, R: mat33):
        W = symmetric(wp.transpose(R) * F) - identity_times(one)
        C = wp.transpose(F) * F
        trace = wp.trace(W)
        x = Strains()
        x[0] = trace
        x[1] = half * (trace * trace - wp.ddot(W, W))
        x[2] = wp.determinant(W)
        x[3] = C[0, 0] - one
        x[4] = C[1, 1] - one
        x[5] = C[2, 2] - one
        x[6] = C[0, 1]
        x[7] = C[0, 2]
        x[8] = C[1, 2]
        x[9] = wp.determinant(F) - one
        return x

    @wp.func
    def adjoint(F: mat33, R: mat33, x_bar: Strains, R_bar: mat33):
        W = symmetric(wp.transpose(R) * F) - identity_times(one)
        W_bar = x_bar[1] * (identity_times(wp.trace(W)) - W) + x_bar[2] * cofactor(W) + identity_times(x_bar[0])
        b01, b02, b12 = half * x_bar[6], half * x_bar[7], half * x_bar[8]
        C_bar = mat33(x_bar[3], b01, b02, b01, x_bar[4], b12, b02, b12, x_bar[5])
        F_bar = R * W_bar + two * F * C_bar + x_bar[9] * cofactor(F)
        return F_bar + polar_rotation_adjoint(F, R, F * W_bar + R_bar)

    return Features(forward, adjoint)
