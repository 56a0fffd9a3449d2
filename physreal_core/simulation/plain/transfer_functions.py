"""The transfers of one particle (see `transfers`) as Warp functions, for the plain kernels and for the fused ones.

All of them take the particle's place in the box of nodes: `first`, the storage index of its base node; `f`, its distance
from there in cells; `w` and `dw`, the weights and their derivatives.
"""

import functools
from dataclasses import dataclass
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import scalar_types


@dataclass(frozen=True)
class Adder:
    """How a particle's share comes to a node, as Warp functions.

    Attributes:
        lanes: `() -> int`: mask of the threads that scatter together.
        run: `(first, lanes) -> int`: which of them share the base node `first`.
        add: `(grid, n, value, lanes, run)`: grid[n] += value.
    """

    lanes: wp.Function
    run: wp.Function
    add: wp.Function


@functools.cache
def single_adder(dtype: str) -> Adder:
    """Every particle adds its own shares."""
    vec4 = scalar_types(dtype).vec4

    @wp.func
    def no_lanes():
        return 0

    @wp.func
    def no_run(first: int, lanes: int):
        return 0

    @wp.func
    def add(grid: wp.array(dtype=vec4), n: int, value: vec4, lanes: int, run: int):
        grid[n] += value

    return Adder(no_lanes, no_run, add)


@functools.cache
def transfer_functions(dtype: str, adder: Adder) -> SimpleNamespace:
    """Warp functions `affine_momentum`, `scatter`, `scatter_adjoint`, `gather`, `gather_adjoint` over one type."""
    types = scalar_types(dtype)
    scalar, vec3, vec4, mat33 = types.scalar, types.vec3, types.vec4, types.mat33
    zero, one, two, four = scalar(0.0), scalar(1.0), scalar(2.0), scalar(4.0)
    lanes_of, run_of, add = adder.lanes, adder.run, adder.add

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

    @wp.func
    def scatter(
        momentum_out: wp.array(dtype=vec4), box: wp.array(dtype=wp.int32), first: int, w: mat33, q: vec4, A: mat33
    ):
        """Add w_i (q + A o_i) to the 27 nodes."""
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        lanes = lanes_of()
        run = run_of(first, lanes)
        qi = q
        for i in range(3):
            q0 = qi
            for j in range(3):
                q1 = q0 + az
                wij = w[i, 0] * w[j, 1]
                n = first + (i * box[4] + j) * box[5]
                add(momentum_out, n, (wij * w[0, 2]) * q0, lanes, run)
                add(momentum_out, n + 1, (wij * w[1, 2]) * q1, lanes, run)
                add(momentum_out, n + 2, (wij * w[2, 2]) * (q1 + az), lanes, run)
                q0 += ay
            qi += ax

    @wp.struct
    class Gathered:
        v: vec3
        C: mat33

    @wp.func
    def gather(
        velocity_in: wp.array(dtype=vec4),
        box: wp.array(dtype=wp.int32),
        first: int,
        f: vec3,
        w: mat33,
        cells_per_metre: scalar,
    ):
        """The grid's velocity and affine velocity at the particle."""
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
        out = Gathered()
        out.v = vec3(V[0], V[1], V[2])
        out.C = (four * cells_per_metre) * wp.matrix_from_cols(
            vec3(BX[0], BX[1], BX[2]) - f[0] * out.v,
            vec3(BY[0], BY[1], BY[2]) - f[1] * out.v,
            vec3(BZ[0], BZ[1], BZ[2]) - f[2] * out.v,
        )
        return out

    @wp.func
    def gather_adjoint(
        velocity_in: wp.array(dtype=vec4),
        velocity_bar_out: wp.array(dtype=vec4),
        box: wp.array(dtype=wp.int32),
        first: int,
        w: mat33,
        dw: mat33,
        q: vec4,
        A: mat33,
    ):
        """Add w_i (q + A o_i) to the nodes' adjoints; returns the sum of v_i . (q + A o_i) dw_i."""
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        lanes = lanes_of()
        run = run_of(first, lanes)
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
                add(velocity_bar_out, n, (wij * w[0, 2]) * q0, lanes, run)
                add(velocity_bar_out, n + 1, (wij * w[1, 2]) * q1, lanes, run)
                add(velocity_bar_out, n + 2, (wij * w[2, 2]) * q2, lanes, run)
                q0 += ay
            slope += vec3(dw[i, 0] * sum, w[i, 0] * sum_y, w[i, 0] * sum_z)
            qi += ax
        return slope

    @wp.struct
    class ScatterAdjoint:
        slope: vec3
        q: vec3
        mass: scalar
        A: mat33

    @wp.func
    def scatter_adjoint(
        momentum_bar_in: wp.array(dtype=vec4),
        box: wp.array(dtype=wp.int32),
        first: int,
        f: vec3,
        w: mat33,
        dw: mat33,
        q: vec4,
        A: mat33,
    ):
        """Adjoints of q, its mass and A in `scatter`, and the sum of p_bar_i . (q + A o_i) dw_i."""
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
        out = ScatterAdjoint()
        out.slope = slope
        out.q = vec3(V[0], V[1], V[2])
        out.mass = V[3]
        out.A = wp.matrix_from_cols(
            vec3(BX[0], BX[1], BX[2]) - f[0] * out.q,
            vec3(BY[0], BY[1], BY[2]) - f[1] * out.q,
            vec3(BZ[0], BZ[1], BZ[2]) - f[2] * out.q,
        )
        return out

    return SimpleNamespace(
        affine_momentum=affine_momentum,
        scatter=scatter,
        scatter_adjoint=scatter_adjoint,
        gather=gather,
        gather_adjoint=gather_adjoint,
    )
