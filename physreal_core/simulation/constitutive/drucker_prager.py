"""Drucker-Prager plasticity with cohesion: |dev tau| + alpha tr(tau) <= k in the Hencky stress, flow without dilatancy.

y = (friction angle phi [rad], cohesion c [Pa]), alpha = sqrt(2/3) 2 sin phi / (3 - sin phi) and k = sqrt(2/3) 6 c cos
phi / (3 - sin phi): the cone through the outer (triaxial compression) edges of Mohr-Coulomb's.
Beyond the tip tr(tau) = k / alpha = 3 c cot phi the strain goes to the tip: the material opens without resistance.
Source: Klar et al., "Drucker-Prager elastoplasticity for sand animation", SIGGRAPH 2016 (their case c = 0; cohesion
shifts the cone along the hydrostatic axis). Their volume correction is left out, since it needs a state variable.
"""

import math
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.lame import lame_functions
from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.return_map import return_structs


@cache
def drucker_prager(scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(radial, radial_adjoint)` over `scalar`, for `return_functions`; 0 <= phi < pi/2, c >= 0."""
    vec2 = law_types(scalar).vec2
    zero, one, two, three, six = scalar(0.0), scalar(1.0), scalar(2.0), scalar(3.0), scalar(6.0)
    root = scalar(math.sqrt(2.0 / 3.0))
    lame, structs = lame_functions(scalar), return_structs(scalar)
    shear_modulus, lame_adjoint = lame.shear_modulus, lame.adjoint
    Radial, RadialAdjoint = structs.Radial, structs.RadialAdjoint

    @wp.func
    def cone(y: vec2):
        """(alpha, k)."""
        sine = wp.sin(y[0])
        return vec2(root * two * sine / (three - sine), root * six * y[1] * wp.cos(y[0]) / (three - sine))

    @wp.func
    def cone_adjoint(y: vec2, alpha_bar: scalar, k_bar: scalar):
        sine, cosine = wp.sin(y[0]), wp.cos(y[0])
        d = three - sine
        angle_bar = root * six * (alpha_bar * cosine + k_bar * y[1] * (one - three * sine)) / (d * d)
        return vec2(angle_bar, k_bar * root * six * cosine / d)

    @wp.func
    def radial(q: scalar, t: scalar, E: scalar, nu: scalar, y: vec2, dt: scalar):
        two_mu = two * shear_modulus(E, nu)
        ak = cone(y)
        slope = ak[0] * E / (one - two * nu)  # alpha (3 lambda + 2 mu)
        strength = ak[1] - slope * t  # what |dev tau| may reach at this trace
        out = Radial()
        out.yields = two_mu * q > strength
        out.q = strength / two_mu
        out.t = t
        if strength < zero:
            out.q = zero
            out.t = ak[1] / slope
        return out

    @wp.func
    def radial_adjoint(
        q: scalar, t: scalar, E: scalar, nu: scalar, y: vec2, dt: scalar, q_new_bar: scalar, t_new_bar: scalar
    ):
        two_mu = two * shear_modulus(E, nu)
        bulk = E / (one - two * nu)  # 3 lambda + 2 mu
        ak = cone(y)
        slope = ak[0] * bulk
        strength = ak[1] - slope * t
        out = RadialAdjoint()
        k_bar = q_new_bar / two_mu
        slope_bar = -k_bar * t
        two_mu_bar = -k_bar * strength / two_mu
        out.t = t_new_bar - k_bar * slope
        if strength < zero:
            k_bar = t_new_bar / slope
            slope_bar = -k_bar * ak[1] / slope
            two_mu_bar = zero
            out.t = zero
        bulk_bar = slope_bar * ak[0]
        material = lame_adjoint(E, nu, two * (two_mu_bar + bulk_bar), three * bulk_bar)
        out.E = material[0]
        out.nu = material[1]
        out.y = cone_adjoint(y, slope_bar * bulk, k_bar)
        return out

    return radial, radial_adjoint
