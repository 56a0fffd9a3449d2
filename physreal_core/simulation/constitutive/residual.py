"""Neural residuals beside the expert laws (paper, "Hybrid Expert-Neural Constitutive Model"), as Warp functions.

Elastic: delta tau = beta_e n(tau_exp) R S R^T, with S = s / sqrt(1 + |s|^2), s the network's symmetric output on
psi(F) and the latent code, and n = sqrt(|tau|^2 + e^2) - e, e = 1e-4 E: smooth at zero stress and never above
|tau_exp|.
Plastic: delta F = beta_p (dt / frame dt) |F_exp| r(C) R S, with r in [0, 1) growing from zero with the strain C - I
of the trial F, so that an unstrained particle does not flow. S symmetric keeps the rotation R of F, as the experts
do.
Both are objective, bounded (|delta tau| <= beta_e |tau_exp|, |delta F| <= beta_p |F_exp| per frame), exactly zero
with zero output weights, and differentiable wherever det F > 0.
"""

import math
from dataclasses import dataclass
from functools import cache

import warp as wp

from physreal_core.simulation.constitutive.law_types import law_types
from physreal_core.simulation.constitutive.linear_algebra import linear_algebra
from physreal_core.simulation.constitutive.residual_config import (
    OUTPUTS,
    ResidualConfig,
    initial_weights,
    split_weights,
)
from physreal_core.simulation.constitutive.residual_features import feature_functions
from physreal_core.simulation.constitutive.residual_network import network_functions

__all__ = ["ResidualConfig", "ResidualFunctions", "initial_weights", "residual_functions", "split_weights"]

SMALL_STRESS = 1e-4
"""Stress over Young's modulus below which the elastic residual fades quadratically instead of linearly."""
SMALL_STRAIN = 1e-3
"""Green strain below which the plastic residual fades quadratically instead of linearly."""


@dataclass(frozen=True)
class ResidualFunctions:
    """Warp functions of both residuals over one scalar type, to be called on one particle inside a kernel.

    Attributes:
        stress: `(F, tau_exp, E, particle, latent, weights) -> delta_tau` (mat33, symmetric for symmetric tau_exp).
        stress_adjoint: `(F, tau_exp, E, particle, latent, weights, delta_tau_bar, latent_bar, weights_bar, row)
            -> struct(F, tau_exp, E)`.
        plastic: `(F_trial, F_exp, share, particle, latent, weights) -> delta_F`, with share = substep dt / frame dt.
        plastic_adjoint: `(F_trial, F_exp, share, particle, latent, weights, delta_F_bar, latent_bar, weights_bar, row)
            -> struct(F_trial, F_exp)`.

    Arrays: latent [N, L] (any width where L = 0), contiguous weights [W], and latent_bar [N, L], weights_bar [rows, W],
    to which the adjoints add. All particles share the weights: more than one row (row = particle % rows, rows summed
    afterwards) keeps GPU threads from queueing for one address; one row is enough on one CPU thread.

    In a kernel, forward then backward::

        tau_exp = stress(F[p], E[p], nu[p])
        tau[p] = tau_exp + residual_stress(F[p], tau_exp, E[p], p, latent, weights)

        r = residual_stress_adjoint(F[p], tau_exp, E[p], p, latent, weights, tau_bar, latent_bar, weights_bar, p % rows)
        e = stress_adjoint(F[p], E[p], nu[p], tau_bar + r.tau_exp)
        F_bar[p] += r.F + e.F
        E_bar[p] += r.E + e.E

        F_exp = return_map(F_trial, E[p], nu[p], y[p], dt)
        F_new = F_exp + residual_plastic(F_trial, F_exp, share, p, latent, weights)

        r = residual_plastic_adjoint(
            F_trial, F_exp, share, p, latent, weights, F_new_bar, latent_bar, weights_bar, p % rows
        )
        e = return_map_adjoint(F_trial, E[p], nu[p], y[p], dt, F_new_bar + r.F_exp)
        F_trial_bar = r.F_trial + e.F
    """

    stress: wp.Function
    stress_adjoint: wp.Function
    plastic: wp.Function
    plastic_adjoint: wp.Function


@cache
def residual_functions(config: ResidualConfig, scalar: type) -> ResidualFunctions:
    """Both residuals of `config` over `scalar` (`wp.float32` or `wp.float64`)."""
    return ResidualFunctions(*_stress_functions(config, scalar), *_plastic_functions(config, scalar))


@dataclass(frozen=True)
class _Direction:
    """Warp functions for the bounded symmetric output; Mandel's scaling makes |S| the vector's own norm."""

    bounded: wp.Function
    bounded_adjoint: wp.Function
    matrix: wp.Function
    matrix_adjoint: wp.Function


@cache
def _direction(scalar: type) -> _Direction:
    mat33 = law_types(scalar).mat33
    one, root = scalar(1.0), scalar(math.sqrt(0.5))
    Outputs = wp.types.vector(OUTPUTS, scalar)

    @wp.func
    def bounded(s: Outputs):
        return s / wp.sqrt(one + wp.dot(s, s))

    @wp.func
    def bounded_adjoint(s: Outputs, b_bar: Outputs):
        scale = one / wp.sqrt(one + wp.dot(s, s))
        b = scale * s
        return scale * (b_bar - wp.dot(b, b_bar) * b)

    @wp.func
    def matrix(b: Outputs):
        m01, m02, m12 = root * b[3], root * b[4], root * b[5]
        return mat33(b[0], m01, m02, m01, b[1], m12, m02, m12, b[2])

    @wp.func
    def matrix_adjoint(M: mat33):
        b = Outputs()
        b[0] = M[0, 0]
        b[1] = M[1, 1]
        b[2] = M[2, 2]
        b[3] = root * (M[0, 1] + M[1, 0])
        b[4] = root * (M[0, 2] + M[2, 0])
        b[5] = root * (M[1, 2] + M[2, 1])
        return b

    return _Direction(bounded, bounded_adjoint, matrix, matrix_adjoint)


def _stress_functions(config: ResidualConfig, scalar: type) -> tuple[wp.Function, wp.Function]:
    mat33 = law_types(scalar).mat33
    one, two = scalar(1.0), scalar(2.0)
    beta, small_stress = scalar(config.beta_elastic), scalar(SMALL_STRESS)
    algebra, features, network = linear_algebra(scalar), feature_functions(scalar), network_functions(config, scalar)
    polar_rotation, symmetric = algebra.polar_rotation, algebra.symmetric
    strains_of, strains_adjoint = features.forward, features.adjoint
    outputs_of, outputs_adjoint = network.forward, network.adjoint
    direction = _direction(scalar)
    bounded, bounded_adjoint = direction.bounded, direction.bounded_adjoint
    matrix, matrix_adjoint = direction.matrix, direction.matrix_adjoint

    @wp.struct
    class StressResidualAdjoint:
        F: mat33
        tau_exp: mat33
        E: scalar

    @wp.func
    def stress(
        F: mat33,
        tau_exp: mat33,
        E: scalar,
        particle: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
    ):
        R = polar_rotation(F)
        S = matrix(bounded(outputs_of(strains_of(F, R), particle, latent, weights)))
        e = small_stress * E
        square = wp.ddot(tau_exp, tau_exp)
        size = square / (wp.sqrt(square + e * e) + e)  # sqrt(square + e^2) - e without cancellation
        return (beta * size) * R * S * wp.transpose(R)

    @wp.func
    def stress_adjoint(
        F: mat33,
        tau_exp: mat33,
        E: scalar,
        particle: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        delta_tau_bar: mat33,
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
        row: int,
    ):
        R = polar_rotation(F)
        strains = strains_of(F, R)
        outputs = outputs_of(strains, particle, latent, weights)
        S = matrix(bounded(outputs))
        e = small_stress * E
        square = wp.ddot(tau_exp, tau_exp)
        root = wp.sqrt(square + e * e)
        size = square / (root + e)
        bar = symmetric(delta_tau_bar)
        bar_R = bar * R
        S_bar = wp.transpose(R) * bar_R
        outputs_bar = bounded_adjoint(outputs, matrix_adjoint((beta * size) * S_bar))
        strains_bar = outputs_adjoint(strains, particle, latent, weights, outputs_bar, latent_bar, weights_bar, row)
        size_bar = beta * wp.ddot(S, S_bar)
        out = StressResidualAdjoint()
        out.F = strains_adjoint(F, R, strains_bar, (two * beta * size) * bar_R * S)
        out.tau_exp = (size_bar / root) * tau_exp
        out.E = size_bar * small_stress * (e / root - one)
        return out

    return stress, stress_adjoint


def _plastic_functions(config: ResidualConfig, scalar: type) -> tuple[wp.Function, wp.Function]:
    mat33 = law_types(scalar).mat33
    quarter, half, one = scalar(0.25), scalar(0.5), scalar(1.0)
    beta, small = scalar(config.beta_plastic), scalar(SMALL_STRAIN)
    algebra, features, network = linear_algebra(scalar), feature_functions(scalar), network_functions(config, scalar)
    polar_rotation, identity_times = algebra.polar_rotation, algebra.identity_times
    strains_of, strains_adjoint = features.forward, features.adjoint
    outputs_of, outputs_adjoint = network.forward, network.adjoint
    direction = _direction(scalar)
    bounded, bounded_adjoint = direction.bounded, direction.bounded_adjoint
    matrix, matrix_adjoint = direction.matrix, direction.matrix_adjoint

    @wp.struct
    class PlasticResidualAdjoint:
        F_trial: mat33
        F_exp: mat33

    @wp.func
    def strain_size(square: scalar):
        """Smooth norm of the Green strain from its square."""
        return square / (wp.sqrt(square + small * small) + small)

    @wp.func
    def plastic(
        F_trial: mat33,
        F_exp: mat33,
        share: scalar,
        particle: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
    ):
        R = polar_rotation(F_trial)
        S = matrix(bounded(outputs_of(strains_of(F_trial, R), particle, latent, weights)))
        G = wp.transpose(F_trial) * F_trial - identity_times(one)
        n = strain_size(quarter * wp.ddot(G, G))
        rate = beta * share * wp.sqrt(wp.ddot(F_exp, F_exp)) * n / wp.sqrt(one + n * n)
        return rate * R * S

    @wp.func
    def plastic_adjoint(
        F_trial: mat33,
        F_exp: mat33,
        share: scalar,
        particle: int,
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        delta_F_bar: mat33,
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
        row: int,
    ):
        R = polar_rotation(F_trial)
        strains = strains_of(F_trial, R)
        outputs = outputs_of(strains, particle, latent, weights)
        S = matrix(bounded(outputs))
        G = wp.transpose(F_trial) * F_trial - identity_times(one)
        square = quarter * wp.ddot(G, G)
        n = strain_size(square)
        growth = n / wp.sqrt(one + n * n)
        size = wp.sqrt(wp.ddot(F_exp, F_exp))
        rate = beta * share * size * growth
        S_bar = wp.transpose(R) * delta_F_bar
        outputs_bar = bounded_adjoint(outputs, matrix_adjoint(rate * S_bar))
        strains_bar = outputs_adjoint(strains, particle, latent, weights, outputs_bar, latent_bar, weights_bar, row)
        rate_bar = beta * share * wp.ddot(S, S_bar)
        growth_bar = rate_bar * size
        square_bar = half * growth_bar * (one - growth * growth) * wp.sqrt(one - growth * growth)
        square_bar = square_bar / wp.sqrt(square + small * small)
        out = PlasticResidualAdjoint()
        out.F_trial = strains_adjoint(F_trial, R, strains_bar, rate * delta_F_bar * S) + square_bar * F_trial * G
        out.F_exp = (rate_bar * growth / size) * F_exp
        return out

    return plastic, plastic_adjoint
