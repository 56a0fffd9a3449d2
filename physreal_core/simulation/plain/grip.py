"""Grip phase (paper, eq. interaction_force, and a dashpot along the same line), with the adjoint.

Per bond of particle x and controller point a, with r = x - a, l = |r|, d = r / l:
    f = -w (k_f (l / l0 - 1) + c_f (v - da/dt) . d) d
Controller points are interpolated linearly over the substeps of a frame.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def grip_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `grip_force`, `grip_force_adjoint` over one scalar type; one thread per gripped particle."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    module = kernel_module("grip", dtype)
    one = scalar(1.0)

    @wp.kernel(module=module)
    def grip_force(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        gripped: wp.array(dtype=wp.int32),
        first_bond: wp.array(dtype=wp.int32),
        controller: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        rest_length: wp.array(dtype=scalar),
        softening: scalar,
        grip: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in:
        controllers_in: wp.array2d(dtype=vec3),
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        load_in: wp.array(dtype=vec3),
        # Data out:
        force_out: wp.array(dtype=vec3),
    ):
        q = wp.tid()
        p = gripped[q]
        force = load_in[p]
        for e in range(first_bond[q], first_bond[q + 1]):
            a0 = controllers_in[0, controller[e]]
            travel = controllers_in[1, controller[e]] - a0
            r = x_in[slot, p] - a0 - (scalar(substep) * timing[1]) * travel
            length = wp.sqrt(wp.dot(r, r) + softening)
            d = r / length
            rate = wp.dot(v_in[slot, p] - travel * timing[2], d)
            force -= (weight[e] * (grip[0] * (length / rest_length[e] - one) + grip[1] * rate)) * d
        force_out[p] = force

    @wp.kernel(module=module)
    def grip_force_adjoint(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        gripped: wp.array(dtype=wp.int32),
        first_bond: wp.array(dtype=wp.int32),
        controller: wp.array(dtype=wp.int32),
        weight: wp.array(dtype=scalar),
        rest_length: wp.array(dtype=scalar),
        softening: scalar,
        grip: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        mass: wp.array(dtype=scalar),
        # Data in:
        controllers_in: wp.array2d(dtype=vec3),
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        # Data in and out: v_bar = m q_bar on entry, of which the force's adjoint is dt q_bar
        x_bar: wp.array(dtype=vec3),
        v_bar: wp.array(dtype=vec3),
        stiffness_bar: wp.array(dtype=scalar),
        damping_bar: wp.array(dtype=scalar),
    ):
        q = wp.tid()
        p = gripped[q]
        force_bar = (timing[0] / mass[p]) * v_bar[p]
        x_sum = vec3()
        v_sum = vec3()
        stiffness_sum = scalar(0.0)
        damping_sum = scalar(0.0)
        for e in range(first_bond[q], first_bond[q + 1]):
            a0 = controllers_in[0, controller[e]]
            travel = controllers_in[1, controller[e]] - a0
            r = x_in[slot, p] - a0 - (scalar(substep) * timing[1]) * travel
            length = wp.sqrt(wp.dot(r, r) + softening)
            d = r / length
            relative = v_in[slot, p] - travel * timing[2]
            rate = wp.dot(relative, d)
            strain = length / rest_length[e] - one
            pull = weight[e] * (grip[0] * strain + grip[1] * rate)
            along = wp.dot(force_bar, d)
            # f = -pull d, with pull and d both functions of r
            damping = weight[e] * grip[1] * along
            d_bar = -pull * force_bar - damping * relative
            x_sum += (d_bar - wp.dot(d_bar, d) * d) / length
            x_sum -= (weight[e] * grip[0] * along / rest_length[e]) * d
            v_sum -= damping * d
            stiffness_sum -= weight[e] * strain * along
            damping_sum -= weight[e] * rate * along
        x_bar[p] = x_bar[p] + x_sum
        v_bar[p] = v_bar[p] + v_sum
        stiffness_bar[q] = stiffness_bar[q] + stiffness_sum
        damping_bar[q] = damping_bar[q] + damping_sum

    return SimpleNamespace(grip_force=grip_force, grip_force_adjoint=grip_force_adjoint)
