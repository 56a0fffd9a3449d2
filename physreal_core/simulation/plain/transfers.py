"""MPM transfers with APIC (Jiang et al. 2015): particles to grid, grid to particles, and adjoints.

One particle scatters to its 27 nodes w_i (m v + dt f) + (m C dx^2 / 4 - dt V tau) grad w_i. F follows the gradient of the
velocity field in which the particles move, L = sum_i v_i grad w_i. MLS-MPM (Hu et al. 2018) puts APIC's C = (4 / dx^2)
sum_i w_i v_i (x_i - x_p) in its place, which differs where the field is curved: the body then deforms otherwise than F
says, and a swinging cantilever sags ever further. States are [slot, particle].
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.lattice import lattice_functions
from physreal_core.simulation.plain.transfer_functions import single_adder, transfer_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types

OUTSIDE, NOT_FINITE = wp.constant(0), wp.constant(1)  # entries of `status`: first substep * N + particle


@functools.cache
def transfer_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `p2g`, `g2p`, `g2p_adjoint`, `p2g_adjoint`, `check_state` over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3, vec4, mat33 = types.scalar, types.vec3, types.vec4, types.mat33
    module = kernel_module("transfers", dtype)
    lattice = lattice_functions(dtype)
    relative, inside, base_cell, fraction = lattice.relative, lattice.inside, lattice.base_cell, lattice.fraction
    node, weights, weight_slopes = lattice.node, lattice.weights, lattice.weight_slopes
    functions = transfer_functions(dtype, single_adder(dtype))
    affine_momentum, scatter, scatter_curved = functions.affine_momentum, functions.scatter, functions.scatter_curved
    derivatives, three, gradient = functions.derivatives, functions.three, functions.gradient
    affine_velocity, velocity_adjoint, slope = functions.affine_velocity, functions.velocity_adjoint, functions.slope
    four = scalar(4.0)

    @wp.kernel(module=module)
    def p2g(
        substep: wp.int32,
        slot: wp.int32,
        grid_slot: wp.int32,
        # Model:
        mass: wp.array(dtype=scalar),
        volume: wp.array(dtype=scalar),
        offset: vec3,
        cells_per_metre: scalar,
        timing: wp.array(dtype=scalar),
        box: wp.array(dtype=wp.int32),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        C_in: wp.array2d(dtype=mat33),
        tau_in: wp.array2d(dtype=mat33),
        force_in: wp.array(dtype=vec3),
        # Data out:
        momentum_out: wp.array2d(dtype=vec4),
        status_out: wp.array(dtype=wp.int64),
    ):
        p = wp.tid()
        dt = timing[0]
        m = mass[p]
        r = relative(x_in[slot, p], offset, cells_per_metre, box)
        A = affine_momentum(m, volume[p], C_in[slot, p], tau_in[slot, p], dt, cells_per_metre)
        momentum = m * v_in[slot, p] + dt * force_in[p]
        if not inside(r, box) or not wp.isfinite(wp.dot(momentum, momentum) + wp.ddot(A, A)):
            kind = OUTSIDE
            if not wp.isfinite(wp.dot(r, r) + wp.dot(momentum, momentum) + wp.ddot(A, A)):
                kind = NOT_FINITE
            wp.atomic_min(status_out, kind, wp.int64(substep) * wp.int64(mass.shape[0]) + wp.int64(p))
            return
        base = base_cell(r)
        f = fraction(r, base)
        q = vec4(momentum[0], momentum[1], momentum[2], m)
        scatter(momentum_out[grid_slot], box, node(base, box), weights(f), weight_slopes(f), q, A)

    @wp.kernel(module=module)
    def g2p(
        slot: wp.int32,
        slot_next: wp.int32,
        # Model:
        offset: vec3,
        cells_per_metre: scalar,
        timing: wp.array(dtype=scalar),
        box: wp.array(dtype=wp.int32),
        # Data in:
        velocity_in: wp.array(dtype=vec4),
        # Data in and out: `slot_next` may be `slot`
        x: wp.array2d(dtype=vec3),
        v: wp.array2d(dtype=vec3),
        F: wp.array2d(dtype=mat33),
        C: wp.array2d(dtype=mat33),
        L: wp.array2d(dtype=mat33),
    ):
        p = wp.tid()
        dt = timing[0]
        position = x[slot, p]
        r = relative(position, offset, cells_per_metre, box)
        if not inside(r, box):
            return
        base = base_cell(r)
        f = fraction(r, base)
        field = derivatives(velocity_in, box, node(base, box), weights(f), weight_slopes(f))
        rate = cells_per_metre * gradient(field)
        F0 = F[slot, p]
        x[slot_next, p] = position + dt * three(field.value)
        v[slot_next, p] = three(field.value)
        C[slot_next, p] = affine_velocity(field, f, cells_per_metre)
        L[slot_next, p] = rate
        F[slot_next, p] = F0 + dt * (rate * F0)

    @wp.kernel(module=module)
    def g2p_adjoint(
        slot: wp.int32,
        slot_next: wp.int32,
        # Model:
        offset: vec3,
        cells_per_metre: scalar,
        timing: wp.array(dtype=scalar),
        box: wp.array(dtype=wp.int32),
        # Data in:
        velocity_in: wp.array(dtype=vec4),
        x_in: wp.array2d(dtype=vec3),
        F_in: wp.array2d(dtype=mat33),
        L_in: wp.array2d(dtype=mat33),
        v_bar_in: wp.array(dtype=vec3),
        C_bar_in: wp.array(dtype=mat33),
        # Data in and out: adjoints of `slot_next` become partial ones of `slot`
        x_bar: wp.array(dtype=vec3),
        F_bar: wp.array(dtype=mat33),
        # Data out:
        velocity_bar_out: wp.array(dtype=vec4),
    ):
        p = wp.tid()
        dt = timing[0]
        r = relative(x_in[slot, p], offset, cells_per_metre, box)
        if not inside(r, box):
            return
        base = base_cell(r)
        f = fraction(r, base)
        w = weights(f)
        dw = weight_slopes(f)
        first = node(base, box)
        field = derivatives(velocity_in, box, first, w, dw)
        F1_bar = F_bar[p]
        L_bar = dt * F1_bar * wp.transpose(F_in[slot, p])
        bar = velocity_adjoint(field, f, cells_per_metre, v_bar_in[p] + dt * x_bar[p], C_bar_in[p], L_bar)
        scatter_curved(velocity_bar_out, box, first, w, dw, bar.q, bar.A, bar.B)
        x_bar[p] = x_bar[p] + cells_per_metre * bar.slope
        F_bar[p] = F1_bar + dt * wp.transpose(L_in[slot_next, p]) * F1_bar

    @wp.kernel(module=module)
    def p2g_adjoint(
        slot: wp.int32,
        # Model:
        mass: wp.array(dtype=scalar),
        volume: wp.array(dtype=scalar),
        offset: vec3,
        cells_per_metre: scalar,
        timing: wp.array(dtype=scalar),
        box: wp.array(dtype=wp.int32),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        C_in: wp.array2d(dtype=mat33),
        tau_in: wp.array2d(dtype=mat33),
        force_in: wp.array(dtype=vec3),
        momentum_bar_in: wp.array(dtype=vec4),
        # Data in and out:
        x_bar: wp.array(dtype=vec3),
        mass_bar: wp.array(dtype=scalar),
        load_bar: wp.array(dtype=vec3),
        # Data out:
        v_bar_out: wp.array(dtype=vec3),
        C_bar_out: wp.array(dtype=mat33),
        tau_bar_out: wp.array(dtype=mat33),
        force_bar_out: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        dt = timing[0]
        m = mass[p]
        r = relative(x_in[slot, p], offset, cells_per_metre, box)
        if not inside(r, box):
            return
        base = base_cell(r)
        f = fraction(r, base)
        A = affine_momentum(m, volume[p], C_in[slot, p], tau_in[slot, p], dt, cells_per_metre)
        push = m * v_in[slot, p] + dt * force_in[p]
        field = derivatives(momentum_bar_in, box, node(base, box), weights(f), weight_slopes(f))
        q_bar = three(field.value)
        A_bar = gradient(field)
        carried = wp.dot(v_in[slot, p], q_bar) + wp.ddot(C_in[slot, p], A_bar) / (four * cells_per_metre)
        mass_bar[p] = mass_bar[p] + field.value[3] + carried
        force_bar = dt * q_bar
        force_bar_out[p] = force_bar
        load_bar[p] = load_bar[p] + force_bar
        x_bar[p] = x_bar[p] + cells_per_metre * slope(field, vec4(push[0], push[1], push[2], m), A)
        v_bar_out[p] = m * q_bar
        C_bar_out[p] = (m / (four * cells_per_metre)) * A_bar
        tau_bar_out[p] = (-dt * volume[p] * cells_per_metre) * A_bar

    @wp.kernel(module=module)
    def check_state(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        offset: vec3,
        cells_per_metre: scalar,
        box: wp.array(dtype=wp.int32),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        F_in: wp.array2d(dtype=mat33),
        # Data out:
        status_out: wp.array(dtype=wp.int64),
    ):
        p = wp.tid()
        r = relative(x_in[slot, p], offset, cells_per_metre, box)
        v = v_in[slot, p]
        F = F_in[slot, p]
        key = wp.int64(substep) * wp.int64(x_in.shape[1]) + wp.int64(p)
        if not wp.isfinite(wp.dot(r, r) + wp.dot(v, v) + wp.ddot(F, F)):
            wp.atomic_min(status_out, NOT_FINITE, key)
        elif not inside(r, box):
            wp.atomic_min(status_out, OUTSIDE, key)

    return SimpleNamespace(p2g=p2g, g2p=g2p, g2p_adjoint=g2p_adjoint, p2g_adjoint=p2g_adjoint, check_state=check_state)
