"""3x3 linear algebra of the constitutive laws as Warp functions: cofactor, polar rotation and its adjoint.

All of it stays exact where singular values repeat, in float32 and float64, and needs no `wp.svd3`.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types

NEWTON_STEPS = wp.constant(16)


@dataclass(frozen=True)
class LinearAlgebra:
    """Warp functions over one scalar type.

    Attributes:
        identity_times: `(s) -> s I`.
        symmetric: `(A) -> (A + A^T) / 2`.
        cofactor: `(F) -> cof F`, the derivative of det F; F^-T det F.
        polar_rotation: `(F) -> R` with F = R U; not a number unless det F > 0.
        polar_rotation_adjoint: `(F, R, R_bar) -> F_bar`.
    """

    identity_times: wp.Function
    symmetric: wp.Function
    cofactor: wp.Function
    polar_rotation: wp.Function
    polar_rotation_adjoint: wp.Function


@cache
def linear_algebra(scalar: type) -> LinearAlgebra:
    """The functions over `scalar`; the same objects at every call, so that Warp compiles nothing twice."""
    t = law_types(scalar)
    vec3, mat33 = t.vec3, t.mat33
    half, one, far = scalar(0.5), scalar(1.0), scalar(0.1)
    newton_tolerance = scalar(t.tolerance * t.tolerance)

    @wp.func
    def identity_times(s: scalar):
        return wp.diag(vec3(s, s, s))

    @wp.func
    def symmetric(A: mat33):
        return half * (A + wp.transpose(A))

    @wp.func
    def cofactor(F: mat33):
        c0 = vec3(F[0, 0], F[1, 0], F[2, 0])
        c1 = vec3(F[0, 1], F[1, 1], F[2, 1])
        c2 = vec3(F[0, 2], F[1, 2], F[2, 2])
        return wp.matrix_from_cols(wp.cross(c1, c2), wp.cross(c2, c0), wp.cross(c0, c1))

    @wp.func
    def polar_rotation(F: mat33):
        # Newton's iteration X <- (g X + X^-T / g) / 2 with Higham's Frobenius scaling g (SIAM J. Sci. Stat. Comput.
        # 7(4), 1986) until it is near: at most about nine steps however ill-conditioned F is, four at moderate strain.
        X = F
        # sqrt(J) is not a number for det F < 0: an inverted particle has no rotation that a law could use, and the
        # rollout is to stop there instead of pulling the particle to a reflected rest shape.
        J = wp.determinant(F)
        X *= wp.sqrt(J) / wp.sqrt(J)
        change = far
        for _ in range(NEWTON_STEPS):
            C = cofactor(X)
            J = wp.dot(vec3(X[0, 0], X[1, 0], X[2, 0]), vec3(C[0, 0], C[1, 0], C[2, 0]))
            g = one
            if change >= far:
                g = wp.sqrt(wp.sqrt(wp.ddot(C, C) / wp.ddot(X, X)) / J)
            Y = (half * g) * X + (half / (g * J)) * C
            D = Y - X
            X = Y
            change = wp.ddot(D, D)
            if change < newton_tolerance:
                break
        return X

    @wp.func
    def polar_rotation_adjoint(F: mat33, R: mat33, R_bar: mat33):
        # dR = R [w]x with (tr(U) I - U) w = axl(R^T dF - dF^T R); the same matrix, symmetric, gives the adjoint.
        U = symmetric(wp.transpose(R) * F)
        W = wp.transpose(R) * R_bar
        axial = vec3(W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1])
        K = identity_times(wp.trace(U)) - U
        return R * wp.skew(wp.inverse(K) * axial)

    return LinearAlgebra(identity_times, symmetric, cofactor, polar_rotation, polar_rotation_adjoint)
