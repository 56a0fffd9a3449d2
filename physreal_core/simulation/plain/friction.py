"""Node phase with friction that depends on the speed of sliding, mu(s) of `term_laws`, and its adjoint (see `grid`)."""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.grid import GROUND, HELD, node_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def sliding_functions(dtype: str) -> SimpleNamespace:
    """Warp functions `velocity_of`, `velocity_adjoint` over one scalar type; as those of `grid`, with the law's numbers."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    functions = node_functions(dtype)
    slide, slide_adjoint = functions.slide, functions.slide_adjoint
    zero, one = scalar(0.0), scalar(1.0)

    @wp.struct
    class Coefficient:
        """mu(s), and its derivatives by s, by mu_f and by the law's three numbers; all zero where it would be negative."""

        value: scalar
        by_speed: scalar
        by_dynamic: scalar
        by_law: vec3

    @wp.func
    def coefficient_at(dynamic: scalar, law: wp.array(dtype=scalar), v: vec3):
        out = Coefficient()
        speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
        fade = wp.exp(-speed / law[1])
        value = dynamic + law[0] * fade + law[2] * speed
        if value > zero:
            out.value = value
            out.by_speed = law[2] - law[0] * fade / law[1]
            out.by_dynamic = scalar(1.0)
            out.by_law = vec3(fade, law[0] * fade * speed / (law[1] * law[1]), speed)
        return out

    @wp.func
    def velocity_of(
        p: vec4,
        kind: int,
        dt: scalar,
        gravity: vec3,
        mass_floor: scalar,
        dynamic: scalar,
        law: wp.array(dtype=scalar),
    ):
        v = vec3()
        if p[3] > mass_floor and kind != HELD:
            v = vec3(p[0], p[1], p[2]) / p[3] + dt * gravity
            if kind == GROUND and v[2] < zero:
                v = slide(v, -coefficient_at(dynamic, law, v).value * v[2])
        return vec4(v[0], v[1], v[2], zero)

    @wp.struct
    class SlidingAdjoint:
        momentum: vec4
        friction: scalar
        law: vec3

    @wp.func
    def velocity_adjoint(
        p: vec4,
        kind: int,
        dt: scalar,
        gravity: vec3,
        mass_floor: scalar,
        dynamic: scalar,
        law: wp.array(dtype=scalar),
        velocity_bar: vec4,
    ):
        out = SlidingAdjoint()
        if p[3] > mass_floor and kind != HELD:
            b = vec3(velocity_bar[0], velocity_bar[1], velocity_bar[2])
            free = vec3(p[0], p[1], p[2]) / p[3]
            v = free + dt * gravity
            if kind == GROUND and v[2] < zero:
                mu = coefficient_at(dynamic, law, v)
                slid = slide_adjoint(v, -mu.value * v[2], b)
                mu_bar = -v[2] * slid.lost
                speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
                faster = zero
                if speed > zero:
                    faster = mu_bar * mu.by_speed / speed
                b = slid.along_plane + vec3(faster * v[0], faster * v[1], -mu.value * slid.lost)
                out.friction = mu_bar * mu.by_dynamic
                out.law = mu_bar * mu.by_law
            inverse_mass = one / p[3]
            out.momentum = inverse_mass * vec4(b[0], b[1], b[2], -wp.dot(b, free))
        return out

    return SimpleNamespace(velocity_of=velocity_of, velocity_adjoint=velocity_adjoint)


@functools.cache
def friction_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `update_nodes`, `update_nodes_adjoint` over one scalar type; as those of `grid`, with the law's numbers."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    module = kernel_module("friction", dtype)
    functions = sliding_functions(dtype)
    velocity_of, velocity_adjoint = functions.velocity_of, functions.velocity_adjoint
    kind_now = node_functions(dtype).kind_now

    @wp.kernel(module=module)
    def update_nodes(
        grid_slot: wp.int32,
        cleared_slot: wp.int32,
        # Model:
        timing: wp.array(dtype=scalar),
        gravity: wp.array(dtype=vec3),
        mass_floor: scalar,
        kind: wp.array(dtype=wp.int32),
        friction: wp.array(dtype=scalar),
        law: wp.array(dtype=scalar),
        # Data in:
        momentum_in: wp.array2d(dtype=vec4),
        # Data out:
        velocity_out: wp.array(dtype=vec4),
        cleared_out: wp.array2d(dtype=vec4),
    ):
        n = wp.tid()
        p = momentum_in[grid_slot, n]
        now = kind_now(kind[n], momentum_in, grid_slot, n)
        velocity_out[n] = velocity_of(p, now, timing[0], gravity[0], mass_floor, friction[0], law)
        cleared_out[cleared_slot, n] = vec4()

    @wp.kernel(module=module)
    def update_nodes_adjoint(
        grid_slot: wp.int32,
        # Model:
        timing: wp.array(dtype=scalar),
        gravity: wp.array(dtype=vec3),
        mass_floor: scalar,
        kind: wp.array(dtype=wp.int32),
        friction: wp.array(dtype=scalar),
        law: wp.array(dtype=scalar),
        # Data in:
        momentum_in: wp.array2d(dtype=vec4),
        # Data in and out: adjoint of the node's velocity becomes that of its (momentum, mass)
        node_bar: wp.array(dtype=vec4),
        friction_bar: wp.array(dtype=scalar),
        gravity_bar: wp.array(dtype=vec3),
        law_bar: wp.array(dtype=vec3),
    ):
        n = wp.tid()
        p = momentum_in[grid_slot, n]
        now = kind_now(kind[n], momentum_in, grid_slot, n)
        bar = velocity_adjoint(p, now, timing[0], gravity[0], mass_floor, friction[0], law, node_bar[n])
        node_bar[n] = bar.momentum
        # gravity acts on the velocity as momentum / mass does, dt times
        weight = timing[0] * p[3]
        gravity_bar[n] = gravity_bar[n] + weight * vec3(bar.momentum[0], bar.momentum[1], bar.momentum[2])
        friction_bar[n] = friction_bar[n] + bar.friction
        law_bar[n] = law_bar[n] + bar.law

    return SimpleNamespace(update_nodes=update_nodes, update_nodes_adjoint=update_nodes_adjoint)
