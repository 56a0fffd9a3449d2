"""Compressible neo-Hookean elasticity: tau = mu (b - I) + lambda log J I, with b = F F^T.

Source: Bonet and Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis", 2nd ed. 2008, ch. 6, with energy
mu/2 (tr b - 3) - mu log J + lambda/2 (log J)^2 per undeformed volume.
"""

from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.lame import lame_functions
from physreal_core.simulation.constitutive.law_types import adjoint_struct, law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra


@cache
def neo_hookean(scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(stress, stress_adjoint)` over `scalar`; det F > 0, stress [Pa]."""
    t = law_types(scalar)
    vec3, mat33 = t.vec3, t.mat33
    algebra, lame = linear_algebra(scalar), lame_functions(scalar)
    cofactor, identity_times = algebra.cofactor, algebra.identity_times
    shear_modulus, lame_lambda, lame_adjoint = lame.shear_modulus, lame.lame_lambda, lame.adjoint
    StressAdjoint = adjoint_struct(scalar)

    @wp.func
    def stress(F: mat33, E: scalar, nu: scalar):
        mu = shear_modulus(E, nu)
        log_J = wp.log(wp.determinant(F))
        return mu * F * wp.transpose(F) + identity_times(lame_lambda(E, nu) * log_J - mu)

    @wp.func
    def stress_adjoint(F: mat33, E: scalar, nu: scalar, tau_bar: mat33):
        mu = shear_modulus(E, nu)
        lam = lame_lambda(E, nu)
        C = cofactor(F)
        J = wp.dot(vec3(F[0, 0], F[1, 0], F[2, 0]), vec3(C[0, 0], C[1, 0], C[2, 0]))
        log_J = wp.log(J)
        b = F * wp.transpose(F)
        trace_bar = wp.trace(tau_bar)
        material = lame_adjoint(E, nu, wp.ddot(tau_bar, b) - trace_bar, trace_bar * log_J)
        out = StressAdjoint()
        out.tau = mu * b + identity_times(lam * log_J - mu)
        out.F = mu * (tau_bar + wp.transpose(tau_bar)) * F + (lam * trace_bar / J) * C
        out.E = material[0]
        out.nu = material[1]
        return out

    return stress, stress_adjoint
