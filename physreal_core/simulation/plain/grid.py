"""Node phase: momentum to velocity, gravity, clamps, Coulomb contact with the ground, and the adjoint of it.

Contact acts, after all forces, on the nodes of the lattice layer k = 0 and below, and on those next to the plane, k = 1, where the
body touches it (`simulation.touch`). With v the free velocity of such a node and v_z < 0, the plane takes out the normal impulse
m |v_z|, the tangential velocity loses at most mu_f |v_z| and sticks where that is more than it has. Nodes that leave the plane
(v_z >= 0) are free.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import kernel_module, scalar_types
from physreal_core.simulation.touch import TOUCHING

FREE, HELD, GROUND = wp.constant(0), wp.constant(1), wp.constant(2)
NEXT_TO_GROUND = wp.constant(3)
"""GROUND in a substep in which the body touches the plane there, else FREE."""


@functools.cache
def node_functions(dtype: str) -> SimpleNamespace:
    """Warp functions of one node over one scalar type: `kind_of`, `kind_now`, `velocity_of`, `slide` in it, and both adjoints."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    zero, one, touching = scalar(0.0), scalar(1.0), scalar(TOUCHING)

    @wp.func
    def kind_of(
        n: int,
        offset: vec3,
        cell: scalar,
        box: wp.array(dtype=wp.int32),
        has_ground: int,
        clamp_lower: wp.array(dtype=vec3),
        clamp_upper: wp.array(dtype=vec3),
    ):
        """Whether node n of the box is free, held by a clamp, on the ground or next to it."""
        k = n % box[5] + box[2]
        j = (n / box[5]) % box[4] + box[1]
        i = n / (box[4] * box[5]) + box[0]
        position = offset + cell * vec3(scalar(i), scalar(j), scalar(k))
        kind = FREE
        if has_ground != 0 and k < 1:
            kind = GROUND
        if has_ground != 0 and k == 1 and k > box[2]:  # a box that begins here has nothing below
            kind = NEXT_TO_GROUND
        for c in range(clamp_lower.shape[0]):
            low = position - clamp_lower[c]
            high = clamp_upper[c] - position
            if wp.min(low) >= zero and wp.min(high) >= zero:
                kind = HELD
        return kind

    @wp.func
    def kind_now(kind: int, momentum: wp.array2d(dtype=vec4), slot: int, n: int):
        """Of node n in a substep, whose (momentum, mass) are a slot; n - 1 is the node below it."""
        now = kind
        if kind == NEXT_TO_GROUND:
            now = FREE
            if momentum[slot, n - 1][3] > touching * momentum[slot, n][3]:
                now = GROUND
        return now

    @wp.func
    def slide(v: vec3, lost: scalar):
        """The part of v along the plane, by `lost` slower; zero where that is more than it has."""
        speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
        kept = zero
        if speed > lost:
            kept = one - lost / speed
        return vec3(kept * v[0], kept * v[1], zero)

    @wp.struct
    class SlideAdjoint:
        along_plane: vec3
        lost: scalar

    @wp.func
    def slide_adjoint(v: vec3, lost: scalar, b: vec3):
        """Adjoints of v and of what it loses in `slide`, whose result's is b."""
        out = SlideAdjoint()
        speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
        if speed > lost:
            tx = v[0] / speed
            ty = v[1] / speed
            along = b[0] * tx + b[1] * ty
            ratio = lost / speed
            out.along_plane = vec3(b[0] - ratio * (b[0] - along * tx), b[1] - ratio * (b[1] - along * ty), zero)
            out.lost = -along
        return out

    @wp.func
    def velocity_of(p: vec4, kind: int, dt: scalar, gravity: vec3, mass_floor: scalar, friction: scalar):
        """Velocity of a node of momentum and mass p; zero where there is no mass."""
        v = vec3()
        if p[3] > mass_floor and kind != HELD:
            v = vec3(p[0], p[1], p[2]) / p[3] + dt * gravity
            if kind == GROUND and v[2] < zero:
                v = slide(v, -friction * v[2])
        return vec4(v[0], v[1], v[2], zero)

    @wp.struct
    class NodeAdjoint:
        momentum: vec4
        friction: scalar

    @wp.func
    def velocity_adjoint(
        p: vec4, kind: int, dt: scalar, gravity: vec3, mass_floor: scalar, friction: scalar, velocity_bar: vec4
    ):
        """Adjoints of (momentum, mass) and of the friction coefficient in `velocity_of`."""
        out = NodeAdjoint()
        if p[3] > mass_floor and kind != HELD:
            b = vec3(velocity_bar[0], velocity_bar[1], velocity_bar[2])
            free = vec3(p[0], p[1], p[2]) / p[3]
            v = free + dt * gravity
            if kind == GROUND and v[2] < zero:
                slid = slide_adjoint(v, -friction * v[2], b)
                out.friction = -v[2] * slid.lost
                b = vec3(slid.along_plane[0], slid.along_plane[1], -friction * slid.lost)
            inverse_mass = one / p[3]
            out.momentum = inverse_mass * vec4(b[0], b[1], b[2], -wp.dot(b, free))
        return out

    return SimpleNamespace(
        kind_of=kind_of,
        kind_now=kind_now,
        velocity_of=velocity_of,
        velocity_adjoint=velocity_adjoint,
        slide=slide,
        slide_adjoint=slide_adjoint,
    )


@functools.cache
def grid_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `mark_nodes`, `update_nodes`, `update_nodes_adjoint` over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    module = kernel_module("grid", dtype)
    functions = node_functions(dtype)
    kind_of, kind_now = functions.kind_of, functions.kind_now
    velocity_of, velocity_adjoint = functions.velocity_of, functions.velocity_adjoint

    @wp.kernel(module=module)
    def mark_nodes(
        # Model:
        offset: vec3,
        cell: scalar,
        box: wp.array(dtype=wp.int32),
        has_ground: wp.int32,
        clamp_lower: wp.array(dtype=vec3),
        clamp_upper: wp.array(dtype=vec3),
        # Data out:
        kind_out: wp.array(dtype=wp.int32),
        momentum_out: wp.array2d(dtype=vec4),
    ):
        n = wp.tid()
        kind_out[n] = kind_of(n, offset, cell, box, has_ground, clamp_lower, clamp_upper)
        momentum_out[0, n] = vec4()

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
        # Data in:
        momentum_in: wp.array2d(dtype=vec4),
        # Data out:
        velocity_out: wp.array(dtype=vec4),
        cleared_out: wp.array2d(dtype=vec4),
    ):
        n = wp.tid()
        p = momentum_in[grid_slot, n]
        now = kind_now(kind[n], momentum_in, grid_slot, n)
        velocity_out[n] = velocity_of(p, now, timing[0], gravity[0], mass_floor, friction[0])
        cleared_out[cleared_slot, n] = vec4()  # the array that the next phase scatters to

    @wp.kernel(module=module)
    def update_nodes_adjoint(
        grid_slot: wp.int32,
        # Model:
        timing: wp.array(dtype=scalar),
        gravity: wp.array(dtype=vec3),
        mass_floor: scalar,
        kind: wp.array(dtype=wp.int32),
        friction: wp.array(dtype=scalar),
        # Data in:
        momentum_in: wp.array2d(dtype=vec4),
        # Data in and out: adjoint of the node's velocity becomes that of its (momentum, mass)
        node_bar: wp.array(dtype=vec4),
        friction_bar: wp.array(dtype=scalar),
        gravity_bar: wp.array(dtype=vec3),
    ):
        n = wp.tid()
        p = momentum_in[grid_slot, n]
        now = kind_now(kind[n], momentum_in, grid_slot, n)
        bar = velocity_adjoint(p, now, timing[0], gravity[0], mass_floor, friction[0], node_bar[n])
        node_bar[n] = bar.momentum
        # gravity acts on the velocity as momentum / mass does, dt times
        weight = timing[0] * p[3]
        gravity_bar[n] = gravity_bar[n] + weight * vec3(bar.momentum[0], bar.momentum[1], bar.momentum[2])
        friction_bar[n] = friction_bar[n] + bar.friction

    return SimpleNamespace(mark_nodes=mark_nodes, update_nodes=update_nodes, update_nodes_adjoint=update_nodes_adjoint)
