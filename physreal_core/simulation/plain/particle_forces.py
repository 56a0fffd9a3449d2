"""Forces on particles from what is around them: drag, adhesion to the ground, an obstacle; with the adjoints.

The laws are stated in `term_laws`: as Warp functions of one particle, for the plain kernels and for the fused ones, and as
kernels that add to what is there, one thread per particle.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import kernel_module, scalar_types
from physreal_core.simulation.term_laws import OBSTACLE_SOFTENING


@functools.cache
def particle_force_functions(dtype: str) -> SimpleNamespace:
    """Warp functions `drag`, `adhesion`, `obstacle`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    zero, one, two = scalar(0.0), scalar(1.0), scalar(2.0)
    softening = scalar(OBSTACLE_SOFTENING**2)

    @wp.func
    def drag(linear: scalar, quadratic: scalar, v: vec3):
        return -(linear + quadratic * wp.length(v)) * v

    @wp.struct
    class DragAdjoint:
        v: vec3
        linear: scalar
        quadratic: scalar

    @wp.func
    def drag_adjoint(linear: scalar, quadratic: scalar, v: vec3, force_bar: vec3):
        out = DragAdjoint()
        speed = wp.length(v)
        along = wp.dot(v, force_bar)
        turning = zero
        if speed > zero:
            turning = quadratic * along / speed
        out.v = -(linear + quadratic * speed) * force_bar - turning * v
        out.linear = -along
        out.quadratic = -speed * along
        return out

    @wp.func
    def adhesion(peak: scalar, reach: scalar, start: vec3, x: vec3):
        u = wp.max((x[2] - start[2]) / reach, zero)
        return vec3(zero, zero, -peak * u * wp.exp(one - u))

    @wp.struct
    class AdhesionAdjoint:
        """`lift` is the adjoint of the position, and minus that of the start."""

        lift: vec3
        peak: scalar
        reach: scalar

    @wp.func
    def adhesion_adjoint(peak: scalar, reach: scalar, start: vec3, x: vec3, force_bar: vec3):
        out = AdhesionAdjoint()
        u = (x[2] - start[2]) / reach
        if u > zero:
            fade = wp.exp(one - u)
            u_bar = peak * (u - one) * fade * force_bar[2]
            out.lift = vec3(zero, zero, u_bar / reach)
            out.peak = -u * fade * force_bar[2]
            out.reach = -u * u_bar / reach
        return out

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

    @wp.func
    def obstacle(capsule: wp.array(dtype=scalar), mass: scalar, x: vec3):
        at = contact(x, capsule)
        return (mass * capsule[7] * at.depth) * at.outwards

    @wp.struct
    class ObstacleAdjoint:
        """`x` is the adjoint of the position, and minus that of the centre."""

        x: vec3
        mass: scalar
        axis: vec3
        radius: scalar
        stiffness: scalar

    @wp.func
    def obstacle_adjoint(capsule: wp.array(dtype=scalar), mass: scalar, x: vec3, force_bar: vec3):
        adjoint = ObstacleAdjoint()
        at = contact(x, capsule)
        if at.depth > zero:
            work = wp.dot(at.outwards, force_bar)
            stiffness = mass * capsule[7]
            turning = stiffness * at.depth / at.length
            out_bar = turning * force_bar - (turning * work + stiffness * work) * at.outwards
            along_bar = zero
            if at.beside != 0:
                along_bar = -at.inverse_square * wp.dot(at.axis, out_bar)
            adjoint.x = out_bar + along_bar * at.axis
            adjoint.axis = along_bar * (at.arm - two * at.along * at.axis) - at.along * out_bar
            adjoint.mass = capsule[7] * at.depth * work
            adjoint.radius = stiffness * work
            adjoint.stiffness = mass * at.depth * work
        return adjoint

    return SimpleNamespace(
        drag=drag,
        drag_adjoint=drag_adjoint,
        adhesion=adhesion,
        adhesion_adjoint=adhesion_adjoint,
        obstacle=obstacle,
        obstacle_adjoint=obstacle_adjoint,
    )


@functools.cache
def particle_force_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `only_loads`, and `drag`, `adhesion`, `obstacle`, each with `..._adjoint`, over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    module = kernel_module("particle_forces", dtype)
    laws = particle_force_functions(dtype)
    drag_of, drag_adjoint_of = laws.drag, laws.drag_adjoint
    adhesion_of, adhesion_adjoint_of = laws.adhesion, laws.adhesion_adjoint
    obstacle_of, obstacle_adjoint_of = laws.obstacle, laws.obstacle_adjoint

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
        force[p] = force[p] + drag_of(linear[p], quadratic[p], v_in[slot, p])

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
        bar = drag_adjoint_of(linear[p], quadratic[p], v_in[slot, p], force_bar_in[p])
        v_bar[p] = v_bar[p] + bar.v
        linear_bar[p] = linear_bar[p] + bar.linear
        quadratic_bar[p] = quadratic_bar[p] + bar.quadratic

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
        force[p] = force[p] + adhesion_of(peak[p], reach[0], start[p], x_in[slot, p])

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
        bar = adhesion_adjoint_of(peak[p], reach[0], start[p], x_in[slot, p], force_bar_in[p])
        x_bar[p] = x_bar[p] + bar.lift
        start_bar[p] = start_bar[p] - bar.lift
        peak_bar[p] = peak_bar[p] + bar.peak
        reach_bar[p] = reach_bar[p] + bar.reach

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
        force[p] = force[p] + obstacle_of(capsule, mass[p], x_in[slot, p])

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
        bar = obstacle_adjoint_of(capsule, mass[p], x_in[slot, p], force_bar_in[p])
        x_bar[p] = x_bar[p] + bar.x
        mass_bar[p] = mass_bar[p] + bar.mass
        for d in range(3):
            capsule_bar[p, d] = capsule_bar[p, d] - bar.x[d]
            capsule_bar[p, 3 + d] = capsule_bar[p, 3 + d] + bar.axis[d]
        capsule_bar[p, 6] = capsule_bar[p, 6] + bar.radius
        capsule_bar[p, 7] = capsule_bar[p, 7] + bar.stiffness

    return SimpleNamespace(
        only_loads=only_loads,
        drag=drag,
        drag_adjoint=drag_adjoint,
        adhesion=adhesion,
        adhesion_adjoint=adhesion_adjoint,
        obstacle=obstacle,
        obstacle_adjoint=obstacle_adjoint,
    )
