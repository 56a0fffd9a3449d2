"""The logarithmic (Hencky) strain eps = log V of F = V R in its principal frame, and isotropic functions of it.

The principal frame comes from one-sided Jacobi rotations of the rows of F (Hestenes 1958): nothing is squared, small
singular values keep their relative accuracy, and repeated ones need no special case. Derivatives of matrix logarithm
and exponential follow Daleckii and Krein: in the principal frame, entries times divided differences. Written through
d / sinh(d) these have no cancellation and the right limit where two values meet.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra

JACOBI_SWEEPS = wp.constant(10)


@dataclass(frozen=True)
class LogStrain:
    """Warp functions and the struct that they share, over one scalar type.

    Attributes:
        Principal: struct with `Q` (mat33, columns are the principal directions) and `eps` (vec3): V = Q exp(eps) Q^T.
        principal: `(F) -> Principal`; not a number unless det F > 0.
        adjoint: `(F, Principal, eps_bar) -> F_bar`, where the mat33 eps_bar is given in the principal frame, symmetric.
        exponential_adjoint: `(eps: vec3, H_bar) -> eps_bar` of H = exp(eps), all in the principal frame.
    """

    Principal: type
    principal: wp.Function
    adjoint: wp.Function
    exponential_adjoint: wp.Function


@cache
def log_strain(scalar: type) -> LogStrain:
    """The functions over `scalar`."""
    t = law_types(scalar)
    vec3, mat33 = t.vec3, t.mat33
    zero, half, one, two = scalar(0.0), scalar(0.5), scalar(1.0), scalar(2.0)
    small, sixth = scalar(1e-3), scalar(1.0 / 6.0)
    jacobi_tolerance, rounding = scalar(t.tolerance), scalar(t.rounding * t.rounding)
    symmetric = linear_algebra(scalar).symmetric

    @wp.struct
    class Principal:
        Q: mat33
        eps: vec3

    @wp.func
    def rotation_tangent(a: scalar, b: scalar, c: scalar):
        """Tangent of the smaller angle that makes rows of squared lengths a, b and product c orthogonal."""
        tangent = zero
        if c * c > rounding * a * b:  # else orthogonal already; the angle would be noise where a and b are equal
            cotangent = (b - a) / (two * c)
            tangent = one / (wp.abs(cotangent) + wp.sqrt(one + cotangent * cotangent))
            if cotangent < zero:
                tangent = -tangent
        return tangent

    @wp.func
    def principal(F: mat33):
        # rows of A = Q^T F and columns of Q, rotated in pairs until the rows are orthogonal
        a0, a1, a2 = F[0], F[1], F[2]
        q0, q1, q2 = vec3(one, zero, zero), vec3(zero, one, zero), vec3(zero, zero, one)
        for _ in range(JACOBI_SWEEPS):
            t01 = rotation_tangent(wp.dot(a0, a0), wp.dot(a1, a1), wp.dot(a0, a1))
            c01 = one / wp.sqrt(one + t01 * t01)
            b0, p0 = c01 * (a0 - t01 * a1), c01 * (q0 - t01 * q1)
            a1, q1 = c01 * (a1 + t01 * a0), c01 * (q1 + t01 * q0)
            a0, q0 = b0, p0
            t02 = rotation_tangent(wp.dot(a0, a0), wp.dot(a2, a2), wp.dot(a0, a2))
            c02 = one / wp.sqrt(one + t02 * t02)
            b0, p0 = c02 * (a0 - t02 * a2), c02 * (q0 - t02 * q2)
            a2, q2 = c02 * (a2 + t02 * a0), c02 * (q2 + t02 * q0)
            a0, q0 = b0, p0
            t12 = rotation_tangent(wp.dot(a1, a1), wp.dot(a2, a2), wp.dot(a1, a2))
            c12 = one / wp.sqrt(one + t12 * t12)
            b1, p1 = c12 * (a1 - t12 * a2), c12 * (q1 - t12 * q2)
            a2, q2 = c12 * (a2 + t12 * a1), c12 * (q2 + t12 * q1)
            a1, q1 = b1, p1
            if wp.abs(t01) + wp.abs(t02) + wp.abs(t12) < jacobi_tolerance:
                break
        out = Principal()
        out.Q = wp.matrix_from_cols(q0, q1, q2)
        # singular values alone would hide an inversion; log of a negative number reports it
        squares = vec3(wp.dot(a0, a0), wp.dot(a1, a1), wp.dot(a2, a2))
        orientation = wp.sign(wp.determinant(F))
        out.eps = half * vec3(wp.log(orientation * squares[0]), wp.log(squares[1]), wp.log(squares[2]))
        return out

    @wp.func
    def over_sinh(d: scalar):
        """d / sinh(d)."""
        value = one - sixth * d * d
        if wp.abs(d) > small:
            value = d / wp.sinh(d)
        return value

    @wp.func
    def adjoint(F: mat33, p: Principal, eps_bar: mat33):
        # eps = log(b) / 2: the divided difference is d / (s_i^2 - s_j^2) = d / sinh(d) / (2 s_i s_j), d = e_i - e_j
        inverse = vec3(wp.exp(-p.eps[0]), wp.exp(-p.eps[1]), wp.exp(-p.eps[2]))
        d01 = over_sinh(p.eps[0] - p.eps[1])
        d02 = over_sinh(p.eps[0] - p.eps[2])
        d12 = over_sinh(p.eps[1] - p.eps[2])
        differences = mat33(one, d01, d02, d01, one, d12, d02, d12, one)
        b_bar = wp.cw_mul(half * wp.outer(inverse, inverse), wp.cw_mul(differences, eps_bar))
        return two * p.Q * b_bar * wp.transpose(p.Q) * F

    @wp.func
    def exponential_adjoint(eps: vec3, H_bar: mat33):
        # (exp(x) - exp(y)) / (x - y) = exp((x + y) / 2) sinh(d) / d, d = (x - y) / 2
        root = vec3(wp.exp(half * eps[0]), wp.exp(half * eps[1]), wp.exp(half * eps[2]))
        d01 = one / over_sinh(half * (eps[0] - eps[1]))
        d02 = one / over_sinh(half * (eps[0] - eps[2]))
        d12 = one / over_sinh(half * (eps[1] - eps[2]))
        differences = mat33(one, d01, d02, d01, one, d12, d02, d12, one)
        return wp.cw_mul(wp.outer(root, root), wp.cw_mul(differences, symmetric(H_bar)))

    return LogStrain(Principal, principal, adjoint, exponential_adjoint)
