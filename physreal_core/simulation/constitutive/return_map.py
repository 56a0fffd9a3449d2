"""The shared half of every plastic expert: an isotropic return map in log strain, F_new = exp(delta eps) F_trial.

With eps = log V of the trial F = V R, split into its deviator of norm q and its trace t, an isotropic law only has to
say where (q, t) goes; direction of the deviator, principal frame and rotation R stay. Inside the yield surface F is
returned untouched. At the surface the map has a kink: values join, derivatives jump, and exactly on it the elastic
side's hold.
Exponential return in log strain: Simo, CMAME 99 (1992).
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.constitutive.log_strain import log_strain


@dataclass(frozen=True)
class ReturnStructs:
    """Structs over one scalar type.

    Attributes:
        Radial: `yields` (bool), and where the law puts deviator norm and trace, `q` and `t`.
        RadialAdjoint: adjoints of trial `q` and `t`, of `E`, `nu` and the law's two parameters `y` (vec2).
        ReturnAdjoint: adjoints of `F` (mat33), `E`, `nu`, `y`: what `return_map_adjoint` returns.
    """

    Radial: type
    RadialAdjoint: type
    ReturnAdjoint: type


@cache
def return_structs(scalar: type) -> ReturnStructs:
    """The structs over `scalar`."""
    t = law_types(scalar)
    vec2, mat33 = t.vec2, t.mat33

    @wp.struct
    class Radial:
        yields: bool
        q: scalar
        t: scalar

    @wp.struct
    class RadialAdjoint:
        q: scalar
        t: scalar
        E: scalar
        nu: scalar
        y: vec2

    @wp.struct
    class ReturnAdjoint:
        F: mat33
        E: scalar
        nu: scalar
        y: vec2

    return ReturnStructs(Radial, RadialAdjoint, ReturnAdjoint)


RadialLaw = Callable[[type], tuple[wp.Function, wp.Function]]


@cache
def return_functions(law: RadialLaw, scalar: type) -> tuple[wp.Function, wp.Function]:
    """`(return_map, return_map_adjoint)` of a radial law.

    Args:
        law: `law(scalar) -> (radial, radial_adjoint)` with
            `radial(q, t, E, nu, y: vec2, dt) -> Radial` and
            `radial_adjoint(q, t, E, nu, y, dt, q_new_bar, t_new_bar) -> RadialAdjoint`, called only when it yields.
        scalar: `wp.float32` or `wp.float64`.
    """
    types = law_types(scalar)
    vec2, vec3, mat33 = types.vec2, types.vec3, types.mat33
    zero, one, third = scalar(0.0), scalar(1.0), scalar(1.0 / 3.0)
    algebra, strain, structs = linear_algebra(scalar), log_strain(scalar), return_structs(scalar)
    identity_times = algebra.identity_times
    principal, strain_adjoint, exponential_adjoint = strain.principal, strain.adjoint, strain.exponential_adjoint
    ReturnAdjoint = structs.ReturnAdjoint
    radial, radial_adjoint = law(scalar)

    @wp.func
    def ratio(a: scalar, b: scalar):
        value = zero
        if b > zero:
            value = a / b
        return value

    @wp.func
    def exponential(Q: mat33, eps: vec3):
        return Q * wp.diag(vec3(wp.exp(eps[0]), wp.exp(eps[1]), wp.exp(eps[2]))) * wp.transpose(Q)

    @wp.func
    def return_map(F_trial: mat33, E: scalar, nu: scalar, y: vec2, dt: scalar):
        p = principal(F_trial)
        t = p.eps[0] + p.eps[1] + p.eps[2]
        mean = third * t
        deviator = p.eps - vec3(mean, mean, mean)
        q = wp.length(deviator)
        new = radial(q, t, E, nu, y, dt)
        F = F_trial
        if new.yields:
            change = third * (new.t - t)
            delta = (ratio(new.q, q) - one) * deviator + vec3(change, change, change)
            F = exponential(p.Q, delta) * F_trial
        return F

    @wp.func
    def return_map_adjoint(F_trial: mat33, E: scalar, nu: scalar, y: vec2, dt: scalar, F_bar: mat33):
        p = principal(F_trial)
        t = p.eps[0] + p.eps[1] + p.eps[2]
        mean = third * t
        deviator = p.eps - vec3(mean, mean, mean)
        q = wp.length(deviator)
        new = radial(q, t, E, nu, y, dt)
        out = ReturnAdjoint()
        out.F = F_bar
        if new.yields:
            scale = ratio(new.q, q)
            change = third * (new.t - t)
            delta = (scale - one) * deviator + vec3(change, change, change)
            H_bar = wp.transpose(p.Q) * F_bar * wp.transpose(F_trial) * p.Q  # in the principal frame, as what follows
            delta_bar = exponential_adjoint(delta, H_bar)
            scale_bar = wp.dot(wp.get_diag(delta_bar), deviator)
            t_bar = third * wp.trace(delta_bar)
            back = radial_adjoint(q, t, E, nu, y, dt, ratio(scale_bar, q), t_bar)
            q_bar = back.q - ratio(scale_bar * scale, q)
            deviator_bar = (scale - one) * delta_bar + wp.diag(ratio(q_bar, q) * deviator)
            eps_bar = deviator_bar + identity_times(back.t - t_bar - third * wp.trace(deviator_bar))
            out.F = exponential(p.Q, delta) * F_bar + strain_adjoint(F_trial, p, eps_bar)
            out.E = back.E
            out.nu = back.nu
            out.y = back.y
        return out

    return return_map, return_map_adjoint
