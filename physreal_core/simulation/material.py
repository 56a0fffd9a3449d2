"""Material phases: Kirchhoff stress of every particle from its deformation gradient, and the adjoint of that."""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.constitutive import elastic_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def stress_kernels(law: str, dtype: str) -> SimpleNamespace:
    """Kernels `stress`, `stress_adjoint` of one elastic expert over one scalar type."""
    types = scalar_types(dtype)
    scalar, mat33 = types.scalar, types.mat33
    module = kernel_module(f"stress_{law}", dtype)
    kirchhoff, kirchhoff_adjoint = elastic_functions(law, scalar)

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
        tau_out[slot, p] = kirchhoff(F_in[slot, p], E[p], nu[p])

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
        bar = kirchhoff_adjoint(F_in[slot, p], E[p], nu[p], tau_bar_in[p])
        F_bar[p] = F_bar[p] + bar.F
        E_bar[p] = E_bar[p] + bar.E
        nu_bar[p] = nu_bar[p] + bar.nu

    return SimpleNamespace(stress=stress, stress_adjoint=stress_adjoint)
