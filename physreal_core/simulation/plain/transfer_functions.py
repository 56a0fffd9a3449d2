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
    """Warp functions of the transfers over one type.

    `scatter` adds a particle's field to its nodes, `derivatives` sums the nodes' values with the weights and their
    derivatives by the particle's position, up to the third; `slope` is the derivative of the product of both by the
    position. The rest turns momenta into fields and sums into velocities. Derivatives are per cell.
    """
    types = scalar_types(dtype)
    scalar, vec3, vec4, mat33 = types.scalar, types.vec3, types.vec4, types.mat33
    zero, half, one, two, four, six = (scalar(c) for c in (0.0, 0.5, 1.0, 2.0, 4.0, 6.0))
    curvature = vec3(one, -two, one)  # second derivatives of the three weights, the same everywhere in a cell
    lanes_of, run_of, add = adder.lanes, adder.run, adder.add

    @wp.func
    def column(A: mat33, d: int):
        return vec4(A[0, d], A[1, d], A[2, d], zero)

    @wp.func
    def scatter(
        grid_out: wp.array(dtype=vec4),
        box: wp.array(dtype=wp.int32),
        first: int,
        w: mat33,
        dw: mat33,
        q: vec4,
        A: mat33,
        B: mat33,
    ):
        """Add w_i q, and the columns of A and B times the weight's first and second derivatives along x, y, z, to the 27 nodes."""
        ax = column(A, 0)
        ay = column(A, 1)
        az = column(A, 2)
        bx = column(B, 0)
        by = column(B, 1)
        bz = column(B, 2)
        lanes = lanes_of()
        run = run_of(first, lanes)
        for i in range(3):
            qi = w[i, 0] * q + dw[i, 0] * ax + curvature[i] * bx
            for j in range(3):
                n = first + (i * box[4] + j) * box[5]
                qj = w[j, 1] * qi + w[i, 0] * (dw[j, 1] * ay + curvature[j] * by)
                wij = w[i, 0] * w[j, 1]
                across = wij * az
                bent = wij * bz
                add(grid_out, n, w[0, 2] * qj + dw[0, 2] * across + bent, lanes, run)
                add(grid_out, n + 1, w[1, 2] * qj + dw[1, 2] * across - two * bent, lanes, run)
                add(grid_out, n + 2, w[2, 2] * qj + dw[2, 2] * across + bent, lanes, run)

    @wp.struct
    class Line:
        value: vec4
        z: vec4
        zz: vec4

    @wp.struct
    class Plane:
        value: vec4
        y: vec4
        z: vec4
        yy: vec4
        yz: vec4
        zz: vec4
        yyz: vec4
        zzy: vec4

    @wp.struct
    class Derivatives:
        """Sums of node values with the weights, and their derivatives by the axes in the name."""

        value: vec4
        x: vec4
        y: vec4
        z: vec4
        xx: vec4
        yy: vec4
        zz: vec4
        xy: vec4
        xz: vec4
        yz: vec4
        xxy: vec4
        xxz: vec4
        yyx: vec4
        yyz: vec4
        zzx: vec4
        zzy: vec4

    @wp.func
    def on_line(grid: wp.array(dtype=vec4), n: int, w: mat33, dw: mat33):
        a = grid[n]
        b = grid[n + 1]
        c = grid[n + 2]
        out = Line()
        out.value = w[0, 2] * a + w[1, 2] * b + w[2, 2] * c
        out.z = dw[0, 2] * a + dw[1, 2] * b + dw[2, 2] * c
        out.zz = a - two * b + c
        return out

    @wp.func
    def on_plane(grid: wp.array(dtype=vec4), n: int, row: int, w: mat33, dw: mat33):
        a = on_line(grid, n, w, dw)
        b = on_line(grid, n + row, w, dw)
        c = on_line(grid, n + 2 * row, w, dw)
        out = Plane()
        out.value = w[0, 1] * a.value + w[1, 1] * b.value + w[2, 1] * c.value
        out.y = dw[0, 1] * a.value + dw[1, 1] * b.value + dw[2, 1] * c.value
        out.z = w[0, 1] * a.z + w[1, 1] * b.z + w[2, 1] * c.z
        out.yy = a.value - two * b.value + c.value
        out.yz = dw[0, 1] * a.z + dw[1, 1] * b.z + dw[2, 1] * c.z
        out.zz = w[0, 1] * a.zz + w[1, 1] * b.zz + w[2, 1] * c.zz
        out.yyz = a.z - two * b.z + c.z
        out.zzy = dw[0, 1] * a.zz + dw[1, 1] * b.zz + dw[2, 1] * c.zz
        return out

    @wp.func
    def derivatives(grid: wp.array(dtype=vec4), box: wp.array(dtype=wp.int32), first: int, w: mat33, dw: mat33):
        """All of them; what a kernel does not use costs it nothing once compiled."""
        out = Derivatives()
        for i in range(3):
            on = on_plane(grid, first + i * box[4] * box[5], box[5], w, dw)
            out.value += w[i, 0] * on.value
            out.y += w[i, 0] * on.y
            out.z += w[i, 0] * on.z
            out.yy += w[i, 0] * on.yy
            out.yz += w[i, 0] * on.yz
            out.zz += w[i, 0] * on.zz
            out.yyz += w[i, 0] * on.yyz
            out.zzy += w[i, 0] * on.zzy
            out.x += dw[i, 0] * on.value
            out.xy += dw[i, 0] * on.y
            out.xz += dw[i, 0] * on.z
            out.yyx += dw[i, 0] * on.yy
            out.zzx += dw[i, 0] * on.zz
            out.xx += curvature[i] * on.value
            out.xxy += curvature[i] * on.y
            out.xxz += curvature[i] * on.z
        return out

    @wp.func
    def three(a: vec4):
        return vec3(a[0], a[1], a[2])

    @wp.func
    def gradient(d: Derivatives):
        """Columns: first derivatives along x, y, z."""
        return wp.matrix_from_cols(three(d.x), three(d.y), three(d.z))

    @wp.func
    def curvatures(d: Derivatives):
        """Columns: second derivatives along x, y, z alone."""
        return wp.matrix_from_cols(three(d.xx), three(d.yy), three(d.zz))

    @wp.func
    def skew(f: vec3):
        """APIC's moment 4 sum_i w_i v_i o_a, with o the offset from the particle, is d_a v + skew_a d_a d_a v."""
        s = f - vec3(one, one, one)
        return vec3(
            s[0] * (half - two * s[0] * s[0]), s[1] * (half - two * s[1] * s[1]), s[2] * (half - two * s[2] * s[2])
        )

    @wp.func
    def skew_slope(f: vec3):
        """Derivative of `skew`."""
        s = f - vec3(one, one, one)
        return vec3(half - six * s[0] * s[0], half - six * s[1] * s[1], half - six * s[2] * s[2])

    @wp.func
    def offset_moments(d: Derivatives, f: vec3):
        """Four times the nodes' values times weight and offset from the particle; of velocities APIC's C, per cell."""
        return gradient(d) + curvatures(d) * wp.diag(skew(f))

    @wp.struct
    class Field:
        """What `scatter` takes, per cell; `apic` is the share of A that is scattered with the nodes' offsets."""

        q: vec4
        A: mat33
        B: mat33
        apic: mat33

    @wp.func
    def field_of(q: vec4, apic: mat33, gradient_share: mat33, f: vec3):
        """sum of w_i q, of 4 w_i (the columns of `apic` times the node's offsets), and of `gradient_share` grad w_i."""
        out = Field()
        out.q = q
        out.A = apic + gradient_share
        out.B = apic * wp.diag(skew(f))
        out.apic = apic
        return out

    @wp.func
    def momentum_field(
        m: scalar, push: vec3, volume: scalar, C: mat33, tau: mat33, dt: scalar, cells_per_metre: scalar, f: vec3
    ):
        """Of a particle with momentum `push`: APIC's m (v + C o_i) w_i, and - dt V tau grad w_i."""
        return field_of(
            vec4(push[0], push[1], push[2], m),
            (m / (four * cells_per_metre)) * C,
            (-dt * volume * cells_per_metre) * tau,
            f,
        )

    @wp.func
    def velocity_bar_field(v_bar: vec3, C_bar: mat33, L_bar: mat33, cells_per_metre: scalar, f: vec3):
        """What adjoints of velocity, affine velocity and velocity gradient give the nodes."""
        return field_of(vec4(v_bar[0], v_bar[1], v_bar[2], zero), cells_per_metre * C_bar, cells_per_metre * L_bar, f)

    @wp.func
    def slope(d: Derivatives, field: Field, f: vec3):
        """Derivative by the position of the products of a scattered field with the nodes' values, `d` being those of these."""
        ax = column(field.A, 0)
        ay = column(field.A, 1)
        az = column(field.A, 2)
        bx = column(field.B, 0)
        by = column(field.B, 1)
        bz = column(field.B, 2)
        by_skew = wp.cw_mul(skew_slope(f), wp.get_diag(wp.transpose(field.apic) * curvatures(d)))
        return by_skew + vec3(
            wp.dot(field.q, d.x) + wp.dot(ax, d.xx) + wp.dot(ay, d.xy) + wp.dot(az, d.xz) + wp.dot(by, d.yyx) + wp.dot(bz, d.zzx),
            wp.dot(field.q, d.y) + wp.dot(ax, d.xy) + wp.dot(ay, d.yy) + wp.dot(az, d.yz) + wp.dot(bx, d.xxy) + wp.dot(bz, d.zzy),
            wp.dot(field.q, d.z) + wp.dot(ax, d.xz) + wp.dot(ay, d.yz) + wp.dot(az, d.zz) + wp.dot(bx, d.xxz) + wp.dot(by, d.yyz),
        )  # fmt: skip

    return SimpleNamespace(
        scatter=scatter,
        derivatives=derivatives,
        three=three,
        gradient=gradient,
        offset_moments=offset_moments,
        momentum_field=momentum_field,
        velocity_bar_field=velocity_bar_field,
        slope=slope,
    )
