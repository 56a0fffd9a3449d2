"""Forces on particles from what is around them: drag, adhesion to the ground, an obstacle; with the adjoints.

The laws are stated in `term_laws`. Every kernel adds to what is there, one thread per particle.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import kernel_module, scalar_types
from physreal_core.simulation.term_laws import OBSTACLE_SOFTENING


@functools.cache
def obstacle_functions(dtype: str) -> SimpleNamespace:
    """Warp function `contact`: where and how deep a position is in a capsule, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    zero, one = scalar(0.0), scalar(1.0)
    softening = scalar(OBSTACLE_SOFTENING**2)

    @wp.struct
    class Contact:
        """From centre to particle, its place along the half axis (-1 to 1), outwards (a unit vector), and how far."""

        arm: vec3
        axis: vec3
        along: scalar
        beside: int
        inverse_square: scalar
        outwards: vec3
        length: scalar
        depth: scalar

    @wp.func
    def contact(x: vec3, capsule: wp.array(dtype=scalar)):
        c = Contact()
        c.axis = vec3(capsule[3], capsule[4], capsule[5])
        c.arm = x - vec3(capsule[0], capsule[1], capsule[2])
        square = wp.dot(c.axis, c.axis)
        if square > zero:
            c.inverse_square = one / square
        free = c.inverse_square * wp.dot(c.arm, c.axis)
        c.along = wp.clamp(free, -one, one)
        if wp.abs(free) < one:
            c.beside = 1
        out = c.arm - c.along * c.axis
        c.length = wp.sqrt(wp.dot(out, out) + softening)
        c.outwards = out / c.length
        c.depth = wp.max(capsule[6] - c.length, zero)
        return c

    return SimpleNamespace(contact=contact)


@functools.cache
def particle_force_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `only_loads`, and `drag`, `adhesion`, `obstacle`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    module = kernel_module("particle_forces", dtype)
    contact = obstacle_functions(dtype).contact
    zero, one, two = scalar(0.0), scalar(1.0), scalar(2.0)

    @wp.kernel(module=module)
    def only_loads(
        slot: wp.int32,
        # Model:
        load: wp.array(dtype=vec3),
        # Data out:
        force_out: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        force_out[p] = load[p]

    @wp.kernel(module=module)
    def drag(
        slot: wp.int32,
        # Model:
        linear: wp.array(dtype=scalar),
        quadratic: wp.array(dtype=scalar),
        # Data in:
        v_in: wp.array2d(dtype=vec3),
        # Data in and out:
        force: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        v = v_in[slot, p]
        force[p] = force[p] - (linear[p] + quadratic[p] * wp.length(v)) * v

    @wp.kernel(module=module)
    def drag_adjoint(
        slot: wp.int32,
        # Model:
        linear: wp.array(dtype=scalar),
        quadratic: wp.array(dtype=scalar),
        # Data in:
        v_in: wp.array2d(dtype=vec3),
        force_bar_in: wp.array(dtype=vec3),
        # Data in and out:
        v_bar: wp.array(dtype=vec3),
        linear_bar: wp.array(dtype=scalar),
        quadratic_bar: wp.array(dtype=scalar),
    ):
        p = wp.tid()
        v = v_in[slot, p]
        f_bar = force_bar_in[p]
        speed = wp.length(v)
        along = wp.dot(v, f_bar)
        turning = zero
        if speed > zero:
            turning = quadratic[p] * along / speed
        v_bar[p] = v_bar[p] - (linear[p] + quadratic[p] * speed) * f_bar - turning * v
        linear_bar[p] = linear_bar[p] - along
        quadratic_bar[p] = quadratic_bar[p] - speed * along

    @wp.kernel(module=module)
    def adhesion(
        slot: wp.int32,
        # Model:
        peak: wp.array(dtype=scalar),
        reach: wp.array(dtype=scalar),
        start: wp.array(dtype=vec3),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        # Data in and out:
        force: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        u = wp.max((x_in[slot, p][2] - start[p][2]) / reach[0], zero)
        force[p] = force[p] - vec3(zero, zero, peak[p] * u * wp.exp(one - u))

    @wp.kernel(module=module)
    def adhesion_adjoint(
        slot: wp.int32,
        # Model:
        peak: wp.array(dtype=scalar),
        reach: wp.array(dtype=scalar),
        start: wp.array(dtype=vec3),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        force_bar_in: wp.array(dtype=vec3),
        # Data in and out:
        x_bar: wp.array(dtype=vec3),
        peak_bar: wp.array(dtype=scalar),
        reach_bar: wp.array(dtype=scalar),
        start_bar: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        u = (x_in[slot, p][2] - start[p][2]) / reach[0]
        if u > zero:
            f_bar = force_bar_in[p][2]
            fade = wp.exp(one - u)
            u_bar = peak[p] * (u - one) * fade * f_bar
            lift = vec3(zero, zero, u_bar / reach[0])
            x_bar[p] = x_bar[p] + lift
            start_bar[p] = start_bar[p] - lift
            peak_bar[p] = peak_bar[p] - u * fade * f_bar
            reach_bar[p] = reach_bar[p] - u * u_bar / reach[0]

    @wp.kernel(module=module)
    def obstacle(
        slot: wp.int32,
        # Model:
        capsule: wp.array(dtype=scalar),
        mass: wp.array(dtype=scalar),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        # Data in and out:
        force: wp.array(dtype=vec3),
    ):
        p = wp.tid()
        at = contact(x_in[slot, p], capsule)
        force[p] = force[p] + (mass[p] * capsule[7] * at.depth) * at.outwards

    @wp.kernel(module=module)
    def obstacle_adjoint(
        slot: wp.int32,
        # Model:
        capsule: wp.array(dtype=scalar),
        mass: wp.array(dtype=scalar),
        # Data in:
        x_in: wp.array2d(dtype=vec3),
        force_bar_in: wp.array(dtype=vec3),
        # Data in and out:
        x_bar: wp.array(dtype=vec3),
        mass_bar: wp.array(dtype=scalar),
        capsule_bar: wp.array2d(dtype=scalar),
    ):
        p = wp.tid()
        at = contact(x_in[slot, p], capsule)
        if at.depth > zero:
            f_bar = force_bar_in[p]
            work = wp.dot(at.outwards, f_bar)
            stiffness = mass[p] * capsule[7]
            turning = stiffness * at.depth / at.length
            out_bar = turning * f_bar - (turning * work + stiffness * work) * at.outwards
            along_bar = zero
            if at.beside != 0:
                along_bar = -at.inverse_square * wp.dot(at.axis, out_bar)
            moved = out_bar + along_bar * at.axis
            turned = along_bar * (at.arm - two * at.along * at.axis) - at.along * out_bar
            x_bar[p] = x_bar[p] + moved
            mass_bar[p] = mass_bar[p] + capsule[7] * at.depth * work
            for d in range(3):
                capsule_bar[p, d] = capsule_bar[p, d] - moved[d]
                capsule_bar[p, 3 + d] = capsule_bar[p, 3 + d] + turned[d]
            capsule_bar[p, 6] = capsule_bar[p, 6] + stiffness * work
            capsule_bar[p, 7] = capsule_bar[p, 7] + mass[p] * at.depth * work

    return SimpleNamespace(
        only_loads=only_loads,
        drag=drag,
        drag_adjoint=drag_adjoint,
        adhesion=adhesion,
        adhesion_adjoint=adhesion_adjoint,
        obstacle=obstacle,
        obstacle_adjoint=obstacle_adjoint,
    )
