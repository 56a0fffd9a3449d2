"""MLS-MPM transfers with APIC (Hu et al. 2018; Jiang et al. 2015): particles to grid, grid to particles, and adjoints.

One particle scatters to its 27 nodes w_i (q + A o_i), with o_i the node's offset from the base node in cells,
A = dx (m C - dt V (4 / dx^2) tau) and q = m v + dt f - A r, r the particle's own offset. States are [slot, particle].
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.lattice import lattice_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types

OUTSIDE, NOT_FINITE = (
    wp.constant(0),
    wp.constant(1),
)  # entries of `status`: first substep * N + particle


@functools.cache
def transfer_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `p2g`, `g2p`, `g2p_adjoint`, `p2g_adjoint`, `check_state` over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3, vec4, mat33 = types.scalar, types.vec3, types.vec4, types.mat33
    module = kernel_module("transfers", dtype)
    lattice = lattice_functions(dtype)
    relative, inside, base_cell, fraction = lattice.relative, lattice.inside, lattice.base_cell, lattice.fraction
    node, weights, weight_slopes = lattice.node, lattice.weights, lattice.weight_slopes
    zero, one, two, four = scalar(0.0), scalar(1.0), scalar(2.0), scalar(4.0)

    @wp.func
    def column(A: mat33, d: int):
        return vec4(A[0, d], A[1, d], A[2, d], zero)

    @wp.func
    def affine_momentum(m: scalar, volume: scalar, C: mat33, tau: mat33, dt: scalar, cells_per_metre: scalar):
        return (m / cells_per_metre) * C - (four * dt * volume * cells_per_metre) * tau

    @wp.struct
    class Plane:
        sum: vec4
        moment_y: vec4
        moment_z: vec4

    @wp.func
    def gather_plane(grid: wp.array(dtype=vec4), n: int, row: int, w: mat33):
        """Weighted sum over the 3 x 3 nodes of one x, and its first moments along y and z in cells from the base."""
        a0 = w[0, 2] * grid[n]
        a1 = w[1, 2] * grid[n + 1]
        a2 = w[2, 2] * grid[n + 2]
        b0 = w[0, 2] * grid[n + row]
        b1 = w[1, 2] * grid[n + row + 1]
        b2 = w[2, 2] * grid[n + row + 2]
        c0 = w[0, 2] * grid[n + 2 * row]
        c1 = w[1, 2] * grid[n + 2 * row + 1]
        c2 = w[2, 2] * grid[n + 2 * row + 2]
        b = w[1, 1] * (b0 + b1 + b2)
        c = w[2, 1] * (c0 + c1 + c2)
        out = Plane()
        out.sum = w[0, 1] * (a0 + a1 + a2) + b + c
        out.moment_y = b + two * c
        out.moment_z = w[0, 1] * (a1 + two * a2) + w[1, 1] * (b1 + two * b2) + w[2, 1] * (c1 + two * c2)
        return out

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
        w = weights(f)
        q3 = momentum - A * f
        q = vec4(q3[0], q3[1], q3[2], m)
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        first = node(base, box)
        grid = momentum_out[grid_slot]
        qi = q
        for i in range(3):
            q0 = qi
            for j in range(3):
                q1 = q0 + az
                wij = w[i, 0] * w[j, 1]
                n = first + (i * box[4] + j) * box[5]
                grid[n] += (wij * w[0, 2]) * q0
                grid[n + 1] += (wij * w[1, 2]) * q1
                grid[n + 2] += (wij * w[2, 2]) * (q1 + az)
                q0 += ay
            qi += ax

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
    ):
        p = wp.tid()
        dt = timing[0]
        position = x[slot, p]
        r = relative(position, offset, cells_per_metre, box)
        if not inside(r, box):
            return
        base = base_cell(r)
        f = fraction(r, base)
        w = weights(f)
        first = node(base, box)
        steps = vec3(zero, one, two)
        V = vec4()
        BX = vec4()
        BY = vec4()
        BZ = vec4()
        for i in range(3):
            n = first + i * box[4] * box[5]
            plane = gather_plane(velocity_in, n, box[5], w)
            V += w[i, 0] * plane.sum
            BX += (w[i, 0] * steps[i]) * plane.sum
            BY += w[i, 0] * plane.moment_y
            BZ += w[i, 0] * plane.moment_z
        v1 = vec3(V[0], V[1], V[2])
        C1 = (four * cells_per_metre) * wp.matrix_from_cols(
            vec3(BX[0], BX[1], BX[2]) - f[0] * v1,
            vec3(BY[0], BY[1], BY[2]) - f[1] * v1,
            vec3(BZ[0], BZ[1], BZ[2]) - f[2] * v1,
        )
        F0 = F[slot, p]
        x[slot_next, p] = position + dt * v1
        v[slot_next, p] = v1
        C[slot_next, p] = C1
        F[slot_next, p] = F0 + dt * (C1 * F0)

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
        v_in: wp.array2d(dtype=vec3),
        F_in: wp.array2d(dtype=mat33),
        C_in: wp.array2d(dtype=mat33),
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
        F1_bar = F_bar[p]
        A = (four * cells_per_metre) * (C_bar_in[p] + dt * F1_bar * wp.transpose(F_in[slot, p]))
        q3 = v_bar_in[p] + dt * x_bar[p] - A * f
        q = vec4(q3[0], q3[1], q3[2], zero)
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        slope = vec3()
        qi = q
        for i in range(3):
            q0 = qi
            sum = zero
            sum_y = zero
            sum_z = zero
            for j in range(3):
                q1 = q0 + az
                q2 = q1 + az
                wij = w[i, 0] * w[j, 1]
                n = first + (i * box[4] + j) * box[5]
                z0 = wp.dot(velocity_in[n], q0)
                z1 = wp.dot(velocity_in[n + 1], q1)
                z2 = wp.dot(velocity_in[n + 2], q2)
                z = w[0, 2] * z0 + w[1, 2] * z1 + w[2, 2] * z2
                sum += w[j, 1] * z
                sum_y += dw[j, 1] * z
                sum_z += w[j, 1] * (dw[0, 2] * z0 + dw[1, 2] * z1 + dw[2, 2] * z2)
                velocity_bar_out[n] += (wij * w[0, 2]) * q0
                velocity_bar_out[n + 1] += (wij * w[1, 2]) * q1
                velocity_bar_out[n + 2] += (wij * w[2, 2]) * q2
                q0 += ay
            slope += vec3(dw[i, 0] * sum, w[i, 0] * sum_y, w[i, 0] * sum_z)
            qi += ax
        x_bar[p] = x_bar[p] + cells_per_metre * (slope - wp.transpose(A) * v_in[slot_next, p])
        F_bar[p] = F1_bar + dt * wp.transpose(C_in[slot_next, p]) * F1_bar

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
        # Data out:
        v_bar_out: wp.array(dtype=vec3),
        C_bar_out: wp.array(dtype=mat33),
        tau_bar_out: wp.array(dtype=mat33),
    ):
        p = wp.tid()
        dt = timing[0]
        m = mass[p]
        r = relative(x_in[slot, p], offset, cells_per_metre, box)
        if not inside(r, box):
            return
        base = base_cell(r)
        f = fraction(r, base)
        w = weights(f)
        dw = weight_slopes(f)
        first = node(base, box)
        A = affine_momentum(m, volume[p], C_in[slot, p], tau_in[slot, p], dt, cells_per_metre)
        q3 = m * v_in[slot, p] + dt * force_in[p] - A * f
        q = vec4(q3[0], q3[1], q3[2], m)
        steps = vec3(zero, one, two)
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        V = vec4()
        BX = vec4()
        BY = vec4()
        BZ = vec4()
        slope = vec3()
        qi = q
        for i in range(3):
            q0 = qi
            sum = zero
            sum_y = zero
            sum_z = zero
            P = vec4()
            PY = vec4()
            PZ = vec4()
            for j in range(3):
                n = first + (i * box[4] + j) * box[5]
                g0 = momentum_bar_in[n]
                g1 = momentum_bar_in[n + 1]
                g2 = momentum_bar_in[n + 2]
                q1 = q0 + az
                z0 = wp.dot(g0, q0)
                z1 = wp.dot(g1, q1)
                z2 = wp.dot(g2, q1 + az)
                sum += w[j, 1] * (w[0, 2] * z0 + w[1, 2] * z1 + w[2, 2] * z2)
                sum_y += dw[j, 1] * (w[0, 2] * z0 + w[1, 2] * z1 + w[2, 2] * z2)
                sum_z += w[j, 1] * (dw[0, 2] * z0 + dw[1, 2] * z1 + dw[2, 2] * z2)
                s1 = (w[j, 1] * w[1, 2]) * g1
                s2 = (w[j, 1] * w[2, 2]) * g2
                s = (w[j, 1] * w[0, 2]) * g0 + s1 + s2
                P += s
                PY += steps[j] * s
                PZ += s1 + two * s2
                q0 += ay
            slope += vec3(dw[i, 0] * sum, w[i, 0] * sum_y, w[i, 0] * sum_z)
            V += w[i, 0] * P
            BX += (w[i, 0] * steps[i]) * P
            BY += w[i, 0] * PY
            BZ += w[i, 0] * PZ
            qi += ax
        q_bar = vec3(V[0], V[1], V[2])
        A_bar = wp.matrix_from_cols(
            vec3(BX[0], BX[1], BX[2]) - f[0] * q_bar,
            vec3(BY[0], BY[1], BY[2]) - f[1] * q_bar,
            vec3(BZ[0], BZ[1], BZ[2]) - f[2] * q_bar,
        )
        x_bar[p] = x_bar[p] + cells_per_metre * (slope - wp.transpose(A) * q_bar)
        v_bar_out[p] = m * q_bar
        C_bar_out[p] = (m / cells_per_metre) * A_bar
        tau_bar_out[p] = (-four * dt * volume[p] * cells_per_metre) * A_bar

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
