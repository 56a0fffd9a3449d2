"""Von Mises plasticity with Perzyna viscosity: |dev tau| <= sqrt(2/3) sigma_y, with dev tau = 2 mu dev eps (Hencky).

y = (yield stress sigma_y in uniaxial tension [Pa], viscosity eta [Pa s]). Above the surface the deviatoric log strain
flows at (|dev tau| - sqrt(2/3) sigma_y) / eta, integrated implicitly: a step keeps (eta/dt) / (2 mu + eta/dt) of the
excess over the surface, so that the material does not depend on dt. eta = 0 is perfect plasticity, the radial return.
Sources: Simo and Hughes, "Computational Inelasticity", 1998 (radial return; Perzyna); in log strain: Simo, CMAME 99
(1992).
There is no hardening: it would need the accumulated plastic strain as a state variable that the particles do not
carry.
"""

import math
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.lame import lame_functions
from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.return_map import return_structs


@cache
def von_mises(scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(radial, radial_adjoint)` over `scalar`, for `return_functions`."""
    vec2 = law_types(scalar).vec2
    one, two, root = scalar(1.0), scalar(2.0), scalar(math.sqrt(2.0 / 3.0))
    lame, structs = lame_functions(scalar), return_structs(scalar)
    shear_modulus, lame_adjoint = lame.shear_modulus, lame.adjoint
    Radial, RadialAdjoint = structs.Radial, structs.RadialAdjoint

    @wp.func
    def radial(q: scalar, t: scalar, E: scalar, nu: scalar, y: vec2, dt: scalar):
        two_mu = two * shear_modulus(E, nu)
        radius = root * y[0] / two_mu
        out = Radial()
        out.yields = q > radius
        out.q = q - (q - radius) * two_mu / (two_mu + y[1] / dt)
        out.t = t
        return out

    @wp.func
    def radial_adjoint(
        q: scalar, t: scalar, E: scalar, nu: scalar, y: vec2, dt: scalar, q_new_bar: scalar, t_new_bar: scalar
    ):
        two_mu = two * shear_modulus(E, nu)
        stiffness = two_mu + y[1] / dt
        fraction = two_mu / stiffness
        radius = root * y[0] / two_mu
        excess = q - radius
        radius_bar = q_new_bar * fraction
        two_mu_bar = -radius_bar * radius / two_mu - q_new_bar * excess * (one - fraction) / stiffness
        material = lame_adjoint(E, nu, two * two_mu_bar, scalar(0.0))
        out = RadialAdjoint()
        out.q = q_new_bar * (one - fraction)
        out.t = t_new_bar
        out.E = material[0]
        out.nu = material[1]
        out.y = vec2(radius_bar * root / two_mu, q_new_bar * excess * fraction / (stiffness * dt))
        return out

    return radial, radial_adjoint
