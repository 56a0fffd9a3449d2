"""Node phase with friction that depends on the speed of sliding, mu(s) of `term_laws`, and its adjoint (see `grid`)."""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.plain.grid import GROUND, HELD, node_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def friction_functions(dtype: str) -> wp.Function:
    """Warp function `coefficient_at` over one scalar type: mu(s), and its derivatives."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    zero = scalar(0.0)

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

    return coefficient_at


@functools.cache
def friction_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `update_nodes`, `update_nodes_adjoint` over one scalar type; as those of `grid`, with the law's numbers."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    module = kernel_module("friction", dtype)
    functions = node_functions(dtype)
    slide, slide_adjoint = functions.slide, functions.slide_adjoint
    coefficient_at = friction_functions(dtype)
    zero, one = scalar(0.0), scalar(1.0)

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
        v = vec3()
        if p[3] > mass_floor and kind[n] != HELD:
            v = vec3(p[0], p[1], p[2]) / p[3] + timing[0] * gravity[0]
            if kind[n] == GROUND and v[2] < zero:
                v = slide(v, -coefficient_at(friction[0], law, v).value * v[2])
        velocity_out[n] = vec4(v[0], v[1], v[2], zero)
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
        bar = vec4()
        if p[3] > mass_floor and kind[n] != HELD:
            b = vec3(node_bar[n][0], node_bar[n][1], node_bar[n][2])
            free = vec3(p[0], p[1], p[2]) / p[3]
            v = free + timing[0] * gravity[0]
            if kind[n] == GROUND and v[2] < zero:
                mu = coefficient_at(friction[0], law, v)
                slid = slide_adjoint(v, -mu.value * v[2], b)
                mu_bar = -v[2] * slid.lost
                speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
                faster = zero
                if speed > zero:
                    faster = mu_bar * mu.by_speed / speed
                b = slid.along_plane + vec3(faster * v[0], faster * v[1], -mu.value * slid.lost)
                friction_bar[n] = friction_bar[n] + mu_bar * mu.by_dynamic
                law_bar[n] = law_bar[n] + mu_bar * mu.by_law
            gravity_bar[n] = gravity_bar[n] + timing[0] * b
            inverse_mass = one / p[3]
            bar = inverse_mass * vec4(b[0], b[1], b[2], -wp.dot(b, free))
        node_bar[n] = bar

    return SimpleNamespace(update_nodes=update_nodes, update_nodes_adjoint=update_nodes_adjoint)
