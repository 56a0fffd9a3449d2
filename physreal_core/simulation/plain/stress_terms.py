"""Kirchhoff stresses beside the expert law's: viscosity, stiffening, fibres; with the adjoints.

The laws are stated in `term_laws`: as Warp functions of one particle, for the plain kernels and for the fused ones, and as
kernels that add to what is there, one thread per particle. All stresses are symmetric, so that only the symmetric part
of tau_bar acts.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def stress_term_functions(dtype: str) -> SimpleNamespace:
    """Warp functions `average_rate`, `viscosity`, `stiffening`, `fibres`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec2, vec3, mat33 = types.scalar, types.vec2, types.vec3, types.mat33
    algebra = linear_algebra(scalar)
    identity_times, symmetric, cofactor = algebra.identity_times, algebra.symmetric, algebra.cofactor
    half, one, two, three, four = (scalar(c) for c in (0.5, 1.0, 2.0, 3.0, 4.0))

    @wp.func
    def average_rate(remembered: scalar, rate: mat33, C: mat33):
        """Mean rate of deformation after a substep with the affine velocity C."""
        return remembered * rate + (one - remembered) * symmetric(C)

    @wp.func
    def average_rate_adjoint(remembered: scalar, rate_bar: mat33):
        """Adjoint of C; that of the mean rate before is `remembered` times the one after."""
        return (one - remembered) * symmetric(rate_bar)

    @wp.func
    def viscosity(y: vec2, F: mat33, D: mat33):
        J = wp.determinant(F)
        return (two * J * y[0]) * D + identity_times(J * y[1] * wp.trace(D))

    @wp.struct
    class ViscosityAdjoint:
        F: mat33
        rate: mat33
        coefficients: vec2

    @wp.func
    def viscosity_adjoint(y: vec2, F: mat33, D: mat33, tau_bar: mat33):
        out = ViscosityAdjoint()
        J = wp.determinant(F)
        T = symmetric(tau_bar)
        sheared = two * wp.ddot(T, D)
        squeezed = wp.trace(T) * wp.trace(D)
        out.F = (y[0] * sheared + y[1] * squeezed) * cofactor(F)
        out.rate = (two * J * y[0]) * T + identity_times(J * y[1] * wp.trace(T))
        out.coefficients = J * vec2(sheared, squeezed)
        return out

    @wp.func
    def isochoric(F: mat33):
        """J^(-2/3) F F^T."""
        return wp.pow(wp.determinant(F), -two / three) * F * wp.transpose(F)

    @wp.func
    def stiffening(modulus: scalar, F: mat33):
        b = isochoric(F)
        I1 = wp.trace(b)
        return (four * modulus * (I1 - three)) * (b - identity_times(I1 / three))

    @wp.struct
    class StiffeningAdjoint:
        F: mat33
        modulus: scalar

    @wp.func
    def stiffening_adjoint(modulus: scalar, F: mat33, tau_bar: mat33):
        out = StiffeningAdjoint()
        T = symmetric(tau_bar)
        b = isochoric(F)
        I1 = wp.trace(b)
        excess = four * (I1 - three)
        work = wp.ddot(T, b) - wp.trace(T) * I1 / three
        b_bar = (modulus * excess) * (T - identity_times(wp.trace(T) / three)) + identity_times(four * modulus * work)
        J = wp.determinant(F)
        power = wp.pow(J, -two / three)
        out.F = (two * power) * b_bar * F - (two / three * wp.ddot(b_bar, b) / J) * cofactor(F)
        out.modulus = excess * work
        return out

    @wp.func
    def fibres(modulus: scalar, direction: vec3, F: mat33):
        g = F * direction
        return (half * modulus * (wp.dot(g, g) - one)) * wp.outer(g, g)

    @wp.struct
    class FibresAdjoint:
        F: mat33
        modulus: scalar
        direction: vec3

    @wp.func
    def fibres_adjoint(modulus: scalar, direction: vec3, F: mat33, tau_bar: mat33):
        out = FibresAdjoint()
        g = F * direction
        pulled = symmetric(tau_bar) * g
        strain = wp.dot(g, g) - one
        work = wp.dot(g, pulled)
        g_bar = modulus * (work * g + strain * pulled)
        out.F = wp.outer(g_bar, direction)
        out.modulus = half * strain * work
        out.direction = wp.transpose(F) * g_bar
        return out

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


@functools.cache
def stress_term_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `average_rate`, `viscosity`, `stiffening`, `fibres`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec2, vec3, mat33 = types.scalar, types.vec2, types.vec3, types.mat33
    module = kernel_module("stress_terms", dtype)
    laws = stress_term_functions(dtype)
    average_rate_of, average_rate_adjoint_of = laws.average_rate, laws.average_rate_adjoint
    viscosity_of, viscosity_adjoint_of = laws.viscosity, laws.viscosity_adjoint
    stiffening_of, stiffening_adjoint_of = laws.stiffening, laws.stiffening_adjoint
    fibres_of, fibres_adjoint_of = laws.fibres, laws.fibres_adjoint

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
        rate[slot_next, p] = average_rate_of(timing[3], rate[slot, p], C_in[slot_next, p])

    @wp.kernel(module=module)
    def average_rate_adjoint(
        # Model:
        timing: wp.array(dtype=scalar),
        # Data in and out:
        C_bar: wp.array(dtype=mat33),
        rate_bar: wp.array(dtype=mat33),
    ):
        p = wp.tid()
        bar = rate_bar[p]
        C_bar[p] = C_bar[p] + average_rate_adjoint_of(timing[3], bar)
        rate_bar[p] = timing[3] * bar

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
        tau[slot, p] = tau[slot, p] + viscosity_of(coefficients[p], F_in[slot, p], rate_in[slot, p])

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
        bar = viscosity_adjoint_of(coefficients[p], F_in[slot, p], rate_in[slot, p], tau_bar_in[p])
        F_bar[p] = F_bar[p] + bar.F
        rate_bar[p] = rate_bar[p] + bar.rate
        coefficients_bar[p] = coefficients_bar[p] + bar.coefficients

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
        tau[slot, p] = tau[slot, p] + stiffening_of(modulus[p], F_in[slot, p])

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
        bar = stiffening_adjoint_of(modulus[p], F_in[slot, p], tau_bar_in[p])
        F_bar[p] = F_bar[p] + bar.F
        modulus_bar[p] = modulus_bar[p] + bar.modulus

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
        tau[slot, p] = tau[slot, p] + fibres_of(modulus[p], direction[p], F_in[slot, p])

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
        bar = fibres_adjoint_of(modulus[p], direction[p], F_in[slot, p], tau_bar_in[p])
        F_bar[p] = F_bar[p] + bar.F
        modulus_bar[p] = modulus_bar[p] + bar.modulus
        direction_bar[p] = direction_bar[p] + bar.direction

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
