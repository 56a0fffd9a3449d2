"""Fixed corotated elasticity: tau = 2 mu (F - R) F^T + lambda J (J - 1) I.

Source: Stomakhin, Howes, Schroeder, Teran, "Energetically consistent invertible elasticity", SCA 2012, with energy mu
|F - R|^2 + lambda/2 (J - 1)^2 per undeformed volume and tau = P F^T. The rotation R comes from Newton's polar
iteration, so that nothing is singular where singular values repeat.
"""

from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.lame import lame_functions
from physreal_core.simulation.constitutive.law_types import adjoint_struct, law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra


@cache
def fixed_corotated(scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(stress, stress_adjoint)` over `scalar`; det F > 0, stress [Pa]."""
    t = law_types(scalar)
    vec3, mat33 = t.vec3, t.mat33
    one, two = scalar(1.0), scalar(2.0)
    algebra, lame = linear_algebra(scalar), lame_functions(scalar)
    cofactor, identity_times = algebra.cofactor, algebra.identity_times
    polar_rotation, polar_rotation_adjoint = algebra.polar_rotation, algebra.polar_rotation_adjoint
    shear_modulus, lame_lambda, lame_adjoint = lame.shear_modulus, lame.lame_lambda, lame.adjoint
    StressAdjoint = adjoint_struct(scalar)

    @wp.func
    def stress(F: mat33, E: scalar, nu: scalar):
        J = wp.determinant(F)
        D = F - polar_rotation(F)
        volumetric = lame_lambda(E, nu) * J * (J - one)
        return (two * shear_modulus(E, nu)) * D * wp.transpose(F) + identity_times(volumetric)

    @wp.func
    def stress_adjoint(F: mat33, E: scalar, nu: scalar, tau_bar: mat33):
        two_mu = two * shear_modulus(E, nu)
        lam = lame_lambda(E, nu)
        C = cofactor(F)
        J = wp.dot(vec3(F[0, 0], F[1, 0], F[2, 0]), vec3(C[0, 0], C[1, 0], C[2, 0]))
        R = polar_rotation(F)
        D = F - R
        DFt = D * wp.transpose(F)
        D_bar = two_mu * tau_bar * F
        trace_bar = wp.trace(tau_bar)
        material = lame_adjoint(E, nu, two * wp.ddot(tau_bar, DFt), trace_bar * J * (J - one))
        out = StressAdjoint()
        out.tau = two_mu * DFt + identity_times(lam * J * (J - one))
        out.F = D_bar + two_mu * wp.transpose(tau_bar) * D - polar_rotation_adjoint(F, R, D_bar)
        out.F += (lam * (two * J - one) * trace_bar) * C
        out.E = material[0]
        out.nu = material[1]
        return out

    return stress, stress_adjoint
