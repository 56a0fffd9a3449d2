"""Grip phase (paper, eq. interaction_force, and a dashpot along the same line), with the adjoint.

Per bond of particle x and controller point a, with r = x - a, l = |r|, d = r / l:
    f = -w (k_f (l / l0 - 1) + c_f (v - da/dt) . d) d
Controller points are interpolated linearly over the substeps of a frame.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def bond_functions(dtype: str) -> SimpleNamespace:
    """Warp struct `Bonds` and functions `bonds_force`, `bonds_adjoint`, `points_adjoint` of one particle over one type."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    one = scalar(1.0)

    @wp.struct
    class Bonds:
        """What all bonds share, and per bond its controller point, weight and rest length [m]."""

        controller: wp.array(dtype=wp.int32)
        weight: wp.array(dtype=scalar)
        rest_length: wp.array(dtype=scalar)
        softening: scalar

    @wp.func
    def bonds_force(
        bonds: Bonds,
        begin: int,
        end: int,
        stiffness: scalar,
        damping: scalar,
        timing: wp.array(dtype=scalar),
        substep: int,
        points: wp.array2d(dtype=vec3),
        x: vec3,
        v: vec3,
        force: vec3,
    ):
        """`force` and the pull of bonds begin .. end - 1."""
        total = force
        for e in range(begin, end):
            a0 = points[0, bonds.controller[e]]
            travel = points[1, bonds.controller[e]] - a0
            r = x - a0 - (scalar(substep) * timing[1]) * travel
            length = wp.sqrt(wp.dot(r, r) + bonds.softening)
            d = r / length
            rate = wp.dot(v - travel * timing[2], d)
            total -= (bonds.weight[e] * (stiffness * (length / bonds.rest_length[e] - one) + damping * rate)) * d
        return total

    @wp.struct
    class BondsAdjoint:
        x: vec3
        v: vec3
        stiffness: scalar
        damping: scalar

    @wp.func
    def bonds_adjoint(
        bonds: Bonds,
        begin: int,
        end: int,
        stiffness: scalar,
        damping: scalar,
        timing: wp.array(dtype=scalar),
        substep: int,
        points: wp.array2d(dtype=vec3),
        x: vec3,
        v: vec3,
        force_bar: vec3,
    ):
        """Adjoints of position, velocity, stiffness and damping in `bonds_force`."""
        out = BondsAdjoint()
        for e in range(begin, end):
            weight = bonds.weight[e]
            a0 = points[0, bonds.controller[e]]
            travel = points[1, bonds.controller[e]] - a0
            r = x - a0 - (scalar(substep) * timing[1]) * travel
            length = wp.sqrt(wp.dot(r, r) + bonds.softening)
            d = r / length
            relative = v - travel * timing[2]
            rate = wp.dot(relative, d)
            strain = length / bonds.rest_length[e] - one
            pull = weight * (stiffness * strain + damping * rate)
            along = wp.dot(force_bar, d)
            # f = -pull d, with pull and d both functions of r
            friction = weight * damping * along
            d_bar = -pull * force_bar - friction * relative
            out.x += (d_bar - wp.dot(d_bar, d) * d) / length
            out.x -= (weight * stiffness * along / bonds.rest_length[e]) * d
            out.v -= friction * d
            out.stiffness -= weight * strain * along
            out.damping -= weight * rate * along
        return out

    @wp.func
    def points_adjoint(
        bonds: Bonds,
        begin: int,
        end: int,
        stiffness: scalar,
        damping: scalar,
        timing: wp.array(dtype=scalar),
        substep: int,
        points: wp.array2d(dtype=vec3),
        x: vec3,
        v: vec3,
        force_bar: vec3,
        points_bar: wp.array2d(dtype=vec3),
    ):
        """Add the adjoint of the controller points at both ends of the frame in `bonds_force`."""
        time = scalar(substep) * timing[1]
        for e in range(begin, end):
            bar = bonds_adjoint(bonds, e, e + 1, stiffness, damping, timing, substep, points, x, v, force_bar)
            # a bond knows x - a0 - time (a1 - a0) and v - rate (a1 - a0) only
            travel_bar = -time * bar.x - timing[2] * bar.v
            wp.atomic_add(points_bar, 0, bonds.controller[e], -bar.x - travel_bar)
            wp.atomic_add(points_bar, 1, bonds.controller[e], travel_bar)

    return SimpleNamespace(
        Bonds=Bonds, bonds_force=bonds_force, bonds_adjoint=bonds_adjoint, points_adjoint=points_adjoint
    )


@functools.cache
def grip_kernels(dtype: str) -> SimpleNamespace:
    """Kernels `grip_force` and its two adjoints over one scalar type; one thread per gripped particle."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    module = kernel_module("grip", dtype)
    functions = bond_functions(dtype)
    Bonds, bonds_force, bonds_adjoint = functions.Bonds, functions.bonds_force, functions.bonds_adjoint
    points_adjoint = functions.points_adjoint

    @wp.kernel(module=module)
    def grip_force(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        gripped: wp.array(dtype=wp.int32),
        first_bond: wp.array(dtype=wp.int32),
        bonds: Bonds,
        grip: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in:
        controllers_in: wp.array2d(dtype=vec3),
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        load_in: wp.array(dtype=vec3),
        # Data out:
        force_out: wp.array(dtype=vec3),
    ):
        q = wp.tid()
        p = gripped[q]
        force_out[p] = bonds_force(
            bonds, first_bond[q], first_bond[q + 1], grip[0], grip[1], timing, substep, controllers_in,
            x_in[slot, p], v_in[slot, p], load_in[p],
        )  # fmt: skip

    @wp.kernel(module=module)
    def grip_force_adjoint(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        gripped: wp.array(dtype=wp.int32),
        first_bond: wp.array(dtype=wp.int32),
        bonds: Bonds,
        grip: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in:
        controllers_in: wp.array2d(dtype=vec3),
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        force_bar_in: wp.array(dtype=vec3),
        # Data in and out:
        x_bar: wp.array(dtype=vec3),
        v_bar: wp.array(dtype=vec3),
        stiffness_bar: wp.array(dtype=scalar),
        damping_bar: wp.array(dtype=scalar),
    ):
        q = wp.tid()
        p = gripped[q]
        bar = bonds_adjoint(
            bonds, first_bond[q], first_bond[q + 1], grip[0], grip[1], timing, substep, controllers_in,
            x_in[slot, p], v_in[slot, p], force_bar_in[p],
        )  # fmt: skip
        x_bar[p] = x_bar[p] + bar.x
        v_bar[p] = v_bar[p] + bar.v
        stiffness_bar[q] = stiffness_bar[q] + bar.stiffness
        damping_bar[q] = damping_bar[q] + bar.damping

    @wp.kernel(module=module)
    def controllers_adjoint(
        substep: wp.int32,
        slot: wp.int32,
        # Model:
        gripped: wp.array(dtype=wp.int32),
        first_bond: wp.array(dtype=wp.int32),
        bonds: Bonds,
        grip: wp.array(dtype=scalar),
        timing: wp.array(dtype=scalar),
        # Data in:
        controllers_in: wp.array2d(dtype=vec3),
        x_in: wp.array2d(dtype=vec3),
        v_in: wp.array2d(dtype=vec3),
        force_bar_in: wp.array(dtype=vec3),
        # Data in and out: of the points at both ends of the frame
        controllers_bar: wp.array2d(dtype=vec3),
    ):
        q = wp.tid()
        p = gripped[q]
        points_adjoint(
            bonds, first_bond[q], first_bond[q + 1], grip[0], grip[1], timing, substep, controllers_in,
            x_in[slot, p], v_in[slot, p], force_bar_in[p], controllers_bar,
        )  # fmt: skip

    return SimpleNamespace(
        grip_force=grip_force, grip_force_adjoint=grip_force_adjoint, controllers_adjoint=controllers_adjoint
    )
