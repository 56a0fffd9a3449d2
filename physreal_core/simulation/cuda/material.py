"""Stress and plastic flow of one particle as Warp functions of one form, whatever the laws and residuals in use.

`stress(F, E, nu, p, latent, weights)`, its adjoint, `flow(trial, E, nu, y, timing, p, latent, weights)` and its adjoint:
the expert law plus, if configured, its neural residual, as in `plain.material`. Arrays of a residual that is not in use
are ignored.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.constitutive import (
    ResidualConfig,
    elastic_functions,
    plastic_functions,
    residual_functions,
)
from physreal_core.simulation.plain.material import identity_functions
from physreal_core.simulation.scalars import scalar_types


@functools.cache
def stress_functions(law: str, residual: ResidualConfig | None, dtype: str) -> SimpleNamespace:
    """Warp functions `stress` and `stress_adjoint` over one scalar type."""
    types = scalar_types(dtype)
    scalar, mat33 = types.scalar, types.mat33
    expert, expert_adjoint = elastic_functions(law, scalar)
    has_residual = residual is not None
    functions = residual_functions(residual or ResidualConfig(), scalar)
    neural, neural_adjoint = functions.stress, functions.stress_adjoint

    @wp.func
    def stress(
        F: mat33, E: scalar, nu: scalar, p: int, latent: wp.array2d(dtype=scalar), weights: wp.array(dtype=scalar)
    ):
        tau = expert(F, E, nu)
        if has_residual:
            tau += neural(F, tau, E, p, latent, weights)
        return tau

    @wp.func
    def stress_adjoint(
        F: mat33,
        E: scalar,
        nu: scalar,
        p: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        tau_bar: mat33,
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
        row: int,
    ):
        expert_bar = tau_bar
        if has_residual:
            r = neural_adjoint(F, expert(F, E, nu), E, p, latent, weights, tau_bar, latent_bar, weights_bar, row)
            expert_bar += r.tau_exp
        bar = expert_adjoint(F, E, nu, expert_bar)
        if has_residual:
            bar.F += r.F
            bar.E += r.E
        return bar

    return SimpleNamespace(stress=stress, stress_adjoint=stress_adjoint)


@functools.cache
def flow_functions(law: str, residual: ResidualConfig | None, dtype: str) -> SimpleNamespace:
    """Warp functions `flow` and `flow_adjoint` over one scalar type; the identity without law and residual."""
    types = scalar_types(dtype)
    scalar, vec2, mat33 = types.scalar, types.vec2, types.mat33
    return_map, return_map_adjoint = plastic_functions(law, scalar) or identity_functions(dtype)
    has_residual = residual is not None
    functions = residual_functions(residual or ResidualConfig(), scalar)
    neural, neural_adjoint = functions.plastic, functions.plastic_adjoint

    @wp.func
    def flow(
        trial: mat33,
        E: scalar,
        nu: scalar,
        y: vec2,
        timing: wp.array(dtype=scalar),
        p: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
    ):
        F = return_map(trial, E, nu, y, timing[0])
        if has_residual:
            F += neural(trial, F, timing[1], p, latent, weights)
        return F

    @wp.func
    def flow_adjoint(
        trial: mat33,
        E: scalar,
        nu: scalar,
        y: vec2,
        timing: wp.array(dtype=scalar),
        p: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        F_bar: mat33,
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
        row: int,
    ):
        expert_bar = F_bar
        if has_residual:
            expert = return_map(trial, E, nu, y, timing[0])
            r = neural_adjoint(trial, expert, timing[1], p, latent, weights, F_bar, latent_bar, weights_bar, row)
            expert_bar += r.F_exp
        bar = return_map_adjoint(trial, E, nu, y, timing[0], expert_bar)
        if has_residual:
            bar.F += r.F_trial
        return bar

    return SimpleNamespace(flow=flow, flow_adjoint=flow_adjoint)
