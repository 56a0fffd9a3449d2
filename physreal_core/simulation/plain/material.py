"""Material phases: stress from the deformation gradient, plastic flow of the trial deformation gradient, and adjoints.

Each phase is the expert law (paper, C_e and C_p) plus, if configured, its neural residual (N_e and N_p).
"""

import functools
import zlib
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.constitutive import (
    ResidualConfig,
    elastic_functions,
    plastic_functions,
    residual_functions,
)
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def stress_kernels(law: str, residual: ResidualConfig | None, dtype: str) -> SimpleNamespace:
    """Kernels `stress`, `stress_adjoint` over one scalar type; with a residual they take latent codes and weights."""
    return _expert_stress(law, dtype) if residual is None else _hybrid_stress(law, residual, dtype)


@functools.cache
def flow_kernels(law: str, residual: ResidualConfig | None, dtype: str) -> SimpleNamespace | None:
    """Kernels `flow`, `flow_adjoint`; None for the identity without a residual, so that the phase is left out."""
    if residual is not None:
        return _hybrid_flow(law, residual, dtype)
    return None if law == "identity" else _expert_flow(law, dtype)


def _tag(residual: ResidualConfig) -> str:
    return f"residual{zlib.crc32(repr(residual).encode()):08x}"


def _expert_stress(law: str, dtype: str) -> SimpleNamespace:
    types = scalar_types(dtype)
    scalar, mat33 = types.scalar, types.mat33
    module = kernel_module(f"stress_{law}", dtype)
    expert, expert_adjoint = elastic_functions(law, scalar)

    @wp.kernel(module=module)
    def stress(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        # Data out:
        tau_out: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        tau_out[slot, p] = expert(F_in[slot, p], E[p], nu[p])

    @wp.kernel(module=module)
    def stress_adjoint(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        tau_bar_in: wp.array(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
    ):
        p = wp.tid()
        bar = expert_adjoint(F_in[slot, p], E[p], nu[p], tau_bar_in[p])
        F_bar[p] = F_bar[p] + bar.F
        E_bar[p] = E_bar[p] + bar.E
        nu_bar[p] = nu_bar[p] + bar.nu

    return SimpleNamespace(stress=stress, stress_adjoint=stress_adjoint)


def _hybrid_stress(law: str, residual: ResidualConfig, dtype: str) -> SimpleNamespace:
    types = scalar_types(dtype)
    scalar, mat33 = types.scalar, types.mat33
    module = kernel_module(f"stress_{law}_{_tag(residual)}", dtype)
    expert, expert_adjoint = elastic_functions(law, scalar)
    functions = residual_functions(residual, scalar)
    neural, neural_adjoint = functions.stress, functions.stress_adjoint

    @wp.kernel(module=module)
    def stress(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        # Data out:
        tau_out: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        tau = expert(F, E[p], nu[p])
        tau_out[slot, p] = tau + neural(F, tau, E[p], p, latent, weights)

    @wp.kernel(module=module)
    def stress_adjoint(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        tau_bar_in: wp.array(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        tau_bar = tau_bar_in[p]
        tau = expert(F, E[p], nu[p])
        row = p % weights_bar.shape[0]
        r = neural_adjoint(F, tau, E[p], p, latent, weights, tau_bar, latent_bar, weights_bar, row)
        bar = expert_adjoint(F, E[p], nu[p], tau_bar + r.tau_exp)
        F_bar[p] = F_bar[p] + r.F + bar.F
        E_bar[p] = E_bar[p] + r.E + bar.E
        nu_bar[p] = nu_bar[p] + bar.nu

    return SimpleNamespace(stress=stress, stress_adjoint=stress_adjoint)


def _expert_flow(law: str, dtype: str) -> SimpleNamespace:
    types = scalar_types(dtype)
    scalar, vec2, mat33 = types.scalar, types.vec2, types.mat33
    module = kernel_module(f"flow_{law}", dtype)
    return_map, return_map_adjoint = plastic_functions(law, scalar)

    @wp.kernel(module=module)
    def flow(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        plastic: wp.array(dtype=vec2),
        timing: wp.array(dtype=scalar),
        # Data in and out:
        F: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        F[slot, p] = return_map(F[slot, p], E[p], nu[p], plastic[p], timing[0])

    @wp.kernel(module=module)
    def flow_adjoint(
        slot: wp.int32,
        slot_next: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        plastic: wp.array(dtype=vec2),
        timing: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        L_in: wp.array2d(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
        plastic_bar: wp.array(dtype=vec2),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        trial = F + timing[0] * (L_in[slot_next, p] * F)
        bar = return_map_adjoint(trial, E[p], nu[p], plastic[p], timing[0], F_bar[p])
        F_bar[p] = bar.F
        E_bar[p] = E_bar[p] + bar.E
        nu_bar[p] = nu_bar[p] + bar.nu
        plastic_bar[p] = plastic_bar[p] + bar.y

    return SimpleNamespace(flow=flow, flow_adjoint=flow_adjoint)


def _hybrid_flow(law: str, residual: ResidualConfig, dtype: str) -> SimpleNamespace:
    types = scalar_types(dtype)
    scalar, vec2, mat33 = types.scalar, types.vec2, types.mat33
    module = kernel_module(f"flow_{law}_{_tag(residual)}", dtype)
    return_map, return_map_adjoint = plastic_functions(law, scalar) or identity_functions(dtype)
    functions = residual_functions(residual, scalar)
    neural, neural_adjoint = functions.plastic, functions.plastic_adjoint

    @wp.kernel(module=module)
    def flow(
        slot: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        plastic: wp.array(dtype=vec2),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in and out:
        F: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        trial = F[slot, p]
        expert = return_map(trial, E[p], nu[p], plastic[p], timing[0])
        F[slot, p] = expert + neural(trial, expert, timing[1], p, latent, weights)

    @wp.kernel(module=module)
    def flow_adjoint(
        slot: wp.int32,
        slot_next: wp.int32,
        # Model:
        E: wp.array(dtype=scalar),
        nu: wp.array(dtype=scalar),
        plastic: wp.array(dtype=vec2),
        latent: wp.array2d(dtype=scalar),
        weights: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in:
        F_in: wp.array2d(dtype=mat33),
        L_in: wp.array2d(dtype=mat33),
        # Data in and out:
        F_bar: wp.array(dtype=mat33),
        E_bar: wp.array(dtype=scalar),
        nu_bar: wp.array(dtype=scalar),
        plastic_bar: wp.array(dtype=vec2),
        latent_bar: wp.array2d(dtype=scalar),
        weights_bar: wp.array2d(dtype=scalar),
    ):
        p = wp.tid()
        F = F_in[slot, p]
        new_bar = F_bar[p]
        trial = F + timing[0] * (L_in[slot_next, p] * F)
        expert = return_map(trial, E[p], nu[p], plastic[p], timing[0])
        row = p % weights_bar.shape[0]
        r = neural_adjoint(trial, expert, timing[1], p, latent, weights, new_bar, latent_bar, weights_bar, row)
        bar = return_map_adjoint(trial, E[p], nu[p], plastic[p], timing[0], new_bar + r.F_exp)
        F_bar[p] = r.F_trial + bar.F
        E_bar[p] = E_bar[p] + bar.E
        nu_bar[p] = nu_bar[p] + bar.nu
        plastic_bar[p] = plastic_bar[p] + bar.y

    return SimpleNamespace(flow=flow, flow_adjoint=flow_adjoint)


@functools.cache
def identity_functions(dtype: str) -> tuple[wp.Function, wp.Function]:
    """The identity as a return map, for a plastic residual without a plastic expert."""
    types = scalar_types(dtype)
    scalar, vec2, mat33 = types.scalar, types.vec2, types.mat33

    @wp.struct
    class IdentityAdjoint:
        F: mat33
        E: scalar
        nu: scalar
        y: vec2

    @wp.func
    def identity(F: mat33, E: scalar, nu: scalar, y: vec2, dt: scalar):
        return F

    @wp.func
    def identity_adjoint(F: mat33, E: scalar, nu: scalar, y: vec2, dt: scalar, F_bar: mat33):
        out = IdentityAdjoint()
        out.F = F_bar
        return out

    return identity, identity_adjoint
