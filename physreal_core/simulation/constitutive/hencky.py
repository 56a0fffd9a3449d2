"""Hencky elasticity (St. Venant-Kirchhoff in the logarithmic strain): tau = 2 mu eps + lambda tr(eps) I, eps = log V.

Source: Simo, "Algorithms for static and dynamic multiplicative plasticity", CMAME 99 (1992), with energy
mu eps:eps + lambda/2 (tr eps)^2 per undeformed volume; in MPM: Klar et al., "Drucker-Prager elastoplasticity for sand
animation", SIGGRAPH 2016.
"""

from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.lame import lame_functions
from physreal_core.simulation.constitutive.law_types import adjoint_struct, law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.constitutive.log_strain import log_strain


@cache
def hencky(scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(stress, stress_adjoint)` over `scalar`; det F > 0, stress [Pa]."""
    t = law_types(scalar)
    vec3, mat33 = t.vec3, t.mat33
    two = scalar(2.0)
    algebra, lame, strain = linear_algebra(scalar), lame_functions(scalar), log_strain(scalar)
    symmetric, identity_times = algebra.symmetric, algebra.identity_times
    principal, strain_adjoint = strain.principal, strain.adjoint
    shear_modulus, lame_lambda, lame_adjoint = lame.shear_modulus, lame.lame_lambda, lame.adjoint
    StressAdjoint = adjoint_struct(scalar)

    @wp.func
    def principal_stress(eps: vec3, E: scalar, nu: scalar):
        volumetric = lame_lambda(E, nu) * (eps[0] + eps[1] + eps[2])
        return (two * shear_modulus(E, nu)) * eps + vec3(volumetric, volumetric, volumetric)

    @wp.func
    def stress(F: mat33, E: scalar, nu: scalar):
        p = principal(F)
        return p.Q * wp.diag(principal_stress(p.eps, E, nu)) * wp.transpose(p.Q)

    @wp.func
    def stress_adjoint(F: mat33, E: scalar, nu: scalar, tau_bar: mat33):
        p = principal(F)
        bar = wp.transpose(p.Q) * symmetric(tau_bar) * p.Q  # in the principal frame
        volume_strain = p.eps[0] + p.eps[1] + p.eps[2]
        trace_bar = wp.trace(bar)
        material = lame_adjoint(E, nu, two * wp.dot(wp.get_diag(bar), p.eps), trace_bar * volume_strain)
        eps_bar = (two * shear_modulus(E, nu)) * bar + identity_times(lame_lambda(E, nu) * trace_bar)
        out = StressAdjoint()
        out.tau = p.Q * wp.diag(principal_stress(p.eps, E, nu)) * wp.transpose(p.Q)
        out.F = strain_adjoint(F, p, eps_bar)
        out.E = material[0]
        out.nu = material[1]
        return out

    return stress, stress_adjoint
