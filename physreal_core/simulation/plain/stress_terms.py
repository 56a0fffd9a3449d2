"""Kirchhoff stresses beside the expert law's: viscosity, stiffening, fibres; with the adjoints.

The laws are stated in `term_laws`. Every kernel adds to what is there, one thread per particle. All stresses are
symmetric, so that only the symmetric part of tau_bar acts.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def stress_term_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `average_rate`, `viscosity`, `stiffening`, `fibres`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec2, vec3, mat33 = types.scalar, types.vec2, types.vec3, types.mat33
    module = kernel_module("stress_terms", dtype)
    algebra = linear_algebra(scalar)
    identity_times, symmetric, cofactor = algebra.identity_times, algebra.symmetric, algebra.cofactor
    half, one, two, three, four = (scalar(c) for c in (0.5, 1.0, 2.0, 3.0, 4.0))

    @wp.kernel(module=module)
    def average_rate(
        slot: wp.int32,
        slot_next: wp.int32,
        # Model:
        timing: wp.array(dtype=scalar),
        # Data in:
        C_in: wp.array2d(dtype=mat33),
        # Data in and out: `slot_next` may be `slot`
        rate: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        remembered = timing[3]
        rate[slot_next, p] = remembered * rate[slot, p] + (one - remembered) * symmetric(C_in[slot_next, p])

    @wp.kernel(module=module)
    def average_rate_adjoint(
        # Model:
        timing: wp.array(dtype=scalar),
        # Data in and out:
        C_bar: wp.array(dtype=mat33),
        rate_bar: wp.array(dtype=mat33),
    ):
        p = wp.tid()
        remembered = timing[3]
        bar = rate_bar[p]
        C_bar[p] = C_bar[p] + (one - remembered) * symmetric(bar)
        rate_bar[p] = remembered * bar

    @wp.kernel(module=module)
    def viscosity(
        slot: wp.int32,
        # Model:
        coefficients: wp.array(dtype=vec2),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        rate_in: wp.array2d(dtype=mat33),
        # Data in and out:
        tau: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        D = rate_in[slot, p]
        J = wp.determinant(F_in[slot, p])
        y = coefficients[p]
        tau[slot, p] = tau[slot, p] + (two * J * y[0]) * D + identity_times(J * y[1] * wp.trace(D))

    @wp.kernel(module=module)
    def viscosity_adjoint(
        slot: wp.int32,
        # Model:
        coefficients: wp.array(dtype=vec2),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        rate_in: wp.array2d(dtype=mat33),
        tau_bar_in: wp.array(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        rate_bar: wp.array(dtype=mat33),
        coefficients_bar: wp.array(dtype=vec2),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        D = rate_in[slot, p]
        y = coefficients[p]
        J = wp.determinant(F)
        T = symmetric(tau_bar_in[p])
        sheared = two * wp.ddot(T, D)
        squeezed = wp.trace(T) * wp.trace(D)
        F_bar[p] = F_bar[p] + (y[0] * sheared + y[1] * squeezed) * cofactor(F)
        rate_bar[p] = rate_bar[p] + (two * J * y[0]) * T + identity_times(J * y[1] * wp.trace(T))
        coefficients_bar[p] = coefficients_bar[p] + J * vec2(sheared, squeezed)

    @wp.func
    def isochoric(F: mat33):
        """J^(-2/3) F F^T."""
        return wp.pow(wp.determinant(F), -two / three) * F * wp.transpose(F)

    @wp.kernel(module=module)
    def stiffening(
        slot: wp.int32,
        # Model:
        modulus: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        # Data in and out:
        tau: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        b = isochoric(F_in[slot, p])
        I1 = wp.trace(b)
        tau[slot, p] = tau[slot, p] + (four * modulus[p] * (I1 - three)) * (b - identity_times(I1 / three))

    @wp.kernel(module=module)
    def stiffening_adjoint(
        slot: wp.int32,
        # Model:
        modulus: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        tau_bar_in: wp.array(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        modulus_bar: wp.array(dtype=scalar),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        T = symmetric(tau_bar_in[p])
        b = isochoric(F)
        I1 = wp.trace(b)
        excess = four * (I1 - three)
        work = wp.ddot(T, b) - wp.trace(T) * I1 / three
        b_bar = (modulus[p] * excess) * (T - identity_times(wp.trace(T) / three)) + identity_times(
            four * modulus[p] * work
        )
        J = wp.determinant(F)
        power = wp.pow(J, -two / three)
        F_bar[p] = F_bar[p] + (two * power) * b_bar * F - (two / three * wp.ddot(b_bar, b) / J) * cofactor(F)
        modulus_bar[p] = modulus_bar[p] + excess * work

    @wp.kernel(module=module)
    def fibres(
        slot: wp.int32,
        # Model:
        modulus: wp.array(dtype=scalar),
        direction: wp.array(dtype=vec3),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        # Data in and out:
        tau: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        g = F_in[slot, p] * direction[p]
        tau[slot, p] = tau[slot, p] + (half * modulus[p] * (wp.dot(g, g) - one)) * wp.outer(g, g)

    @wp.kernel(module=module)
    def fibres_adjoint(
        slot: wp.int32,
        # Model:
        modulus: wp.array(dtype=scalar),
        direction: wp.array(dtype=vec3),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        tau_bar_in: wp.array(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        modulus_bar: wp.array(dtype=scalar),
        direction_bar: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        a = direction[p]
        g = F * a
        pulled = symmetric(tau_bar_in[p]) * g
        strain = wp.dot(g, g) - one
        work = wp.dot(g, pulled)
        g_bar = modulus[p] * (work * g + strain * pulled)
        F_bar[p] = F_bar[p] + wp.outer(g_bar, a)
        modulus_bar[p] = modulus_bar[p] + half * strain * work
        direction_bar[p] = direction_bar[p] + wp.transpose(F) * g_bar

    return SimpleNamespace(
        average_rate=average_rate,
        average_rate_adjoint=average_rate_adjoint,
        viscosity=viscosity,
        viscosity_adjoint=viscosity_adjoint,
        stiffening=stiffening,
        stiffening_adjoint=stiffening_adjoint,
        fibres=fibres,
        fibres_adjoint=fibres_adjoint,
    )
