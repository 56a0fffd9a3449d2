"""MPM transfers with APIC (Jiang et al. 2015): particles to grid, grid to particles, and adjoints.

One particle scatters to its 27 nodes w_i (m v + m C (x_i - x_p) + dt f) - dt V tau grad w_i. F follows the gradient of the
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
    scatter, derivatives, three, gradient = (
        functions.scatter,
        functions.derivatives,
        functions.three,
        functions.gradient,
    )
    offset_moments, slope = functions.offset_moments, functions.slope
    momentum_field, velocity_bar_field = functions.momentum_field, functions.velocity_bar_field
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
        momentum = m * v_in[slot, p] + dt * force_in[p]
        size = (
            wp.dot(momentum, momentum)
            + wp.ddot(C_in[slot, p], C_in[slot, p])
            + wp.ddot(tau_in[slot, p], tau_in[slot, p])
        )
        if not inside(r, box) or not wp.isfinite(size):
            kind = OUTSIDE
            if not wp.isfinite(wp.dot(r, r) + size):
                kind = NOT_FINITE
            wp.atomic_min(status_out, kind, wp.int64(substep) * wp.int64(mass.shape[0]) + wp.int64(p))
            return
        base = base_cell(r)
        f = fraction(r, base)
        given = momentum_field(m, momentum, volume[p], C_in[slot, p], tau_in[slot, p], dt, cells_per_metre, f)
        first = node(base, box)
        scatter(momentum_out[grid_slot], box, first, weights(f), weight_slopes(f), given.q, given.A, given.B)

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
        C[slot_next, p] = cells_per_metre * offset_moments(field, f)
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
        bar = velocity_bar_field(v_bar_in[p] + dt * x_bar[p], C_bar_in[p], L_bar, cells_per_metre, f)
        scatter(velocity_bar_out, box, first, w, dw, bar.q, bar.A, bar.B)
        x_bar[p] = x_bar[p] + cells_per_metre * slope(field, bar, f)
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
        push = m * v_in[slot, p] + dt * force_in[p]
        field = derivatives(momentum_bar_in, box, node(base, box), weights(f), weight_slopes(f))
        q_bar = three(field.value)
        apic_bar = offset_moments(field, f)
        carried = wp.dot(v_in[slot, p], q_bar) + wp.ddot(C_in[slot, p], apic_bar) / (four * cells_per_metre)
        mass_bar[p] = mass_bar[p] + field.value[3] + carried
        force_bar = dt * q_bar
        force_bar_out[p] = force_bar
        load_bar[p] = load_bar[p] + force_bar
        given = momentum_field(m, push, volume[p], C_in[slot, p], tau_in[slot, p], dt, cells_per_metre, f)
        x_bar[p] = x_bar[p] + cells_per_metre * slope(field, given, f)
        v_bar_out[p] = m * q_bar
        C_bar_out[p] = (m / (four * cells_per_metre)) * apic_bar
        tau_bar_out[p] = (-dt * volume[p] * cells_per_metre) * gradient(field)

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
