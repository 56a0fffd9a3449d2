"""Lame's parameters from Young's and Poisson's: mu = E / (2 (1 + nu)), lambda = E nu / ((1 + nu)(1 - 2 nu))."""

from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types


@dataclass(frozen=True)
class LameFunctions:
    """Warp functions over one scalar type; moduli in Pa.

    Attributes:
        shear_modulus, lame_lambda: `(E, nu) -> mu` and `(E, nu) -> lambda`.
        adjoint: `(E, nu, mu_bar, lambda_bar) -> vec2(E_bar, nu_bar)`.
    """

    shear_modulus: wp.Function
    lame_lambda: wp.Function
    adjoint: wp.Function


@cache
def lame_functions(scalar: type) -> LameFunctions:
    """The functions over `scalar`."""
    vec2 = law_types(scalar).vec2
    half, one, two = scalar(0.5), scalar(1.0), scalar(2.0)

    @wp.func
    def shear_modulus(E: scalar, nu: scalar):
        return half * E / (one + nu)

    @wp.func
    def lame_lambda(E: scalar, nu: scalar):
        return E * nu / ((one + nu) * (one - two * nu))

    @wp.func
    def adjoint(E: scalar, nu: scalar, mu_bar: scalar, lam_bar: scalar):
        plus = one + nu
        minus = one - two * nu
        E_bar = half * mu_bar / plus + lam_bar * nu / (plus * minus)
        # d lambda / d nu = E (1 + 2 nu^2) / ((1 + nu)(1 - 2 nu))^2
        nu_bar = lam_bar * E * (one + two * nu * nu) / (plus * plus * minus * minus) - half * mu_bar * E / (plus * plus)
        return vec2(E_bar, nu_bar)

    return LameFunctions(shear_modulus, lame_lambda, adjoint)
