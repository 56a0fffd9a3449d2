"""Node phases on the boxes of all rollouts at once: velocities from momenta, and on the way back both adjoints in one.

Every rollout has `nodes` rows of storage, of which its box takes the first. Slots count from the frame's first one,
`first[0]`, so that one CUDA graph serves every frame that is kept.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.cuda.report import COLUMNS, FAILURES, LEAST, NOT_FAILED
from physreal_core.simulation.plain.grid import FREE, node_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def node_kernels(dtype: str) -> SimpleNamespace:
    """Struct `Nodes` and kernels `start`, `update`, `turn` over one scalar type."""
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    module = kernel_module("cuda_nodes", dtype)
    functions = node_functions(dtype)
    kind_of, velocity_of, velocity_adjoint = functions.kind_of, functions.velocity_of, functions.velocity_adjoint

    @wp.struct
    class Nodes:
        """What the node phases read besides momenta."""

        nodes: wp.int32
        offset: vec3
        cell: scalar
        gravity: vec3
        mass_floor: scalar
        has_ground: wp.int32
        clamp_lower: wp.array(dtype=vec3)
        clamp_upper: wp.array(dtype=vec3)
        timing: wp.array(dtype=scalar)
        friction: wp.array(dtype=scalar)  # [rollouts]
        box: wp.array2d(dtype=wp.int32)  # [rollouts, 6]

    @wp.func
    def used(model: Nodes, n: int, rollout: int):
        """Whether a row of storage belongs to the rollout's box."""
        return n - rollout * model.nodes < model.box[rollout, 3] * model.box[rollout, 4] * model.box[rollout, 5]

    @wp.func
    def kind_at(model: Nodes, n: int, rollout: int, p: vec4):
        kind = FREE
        if p[3] > model.mass_floor and (model.has_ground != 0 or model.clamp_lower.shape[0] > 0):
            kind = kind_of(
                n - rollout * model.nodes, model.offset, model.cell, model.box[rollout], model.has_ground,
                model.clamp_lower, model.clamp_upper,
            )  # fmt: skip
        return kind

    @wp.kernel(module=module)
    def start(
        first: wp.array(dtype=wp.int32),
        # Data out:
        momentum_out: wp.array2d(dtype=vec4),
        report_out: wp.array(dtype=wp.int64),
    ):
        n = wp.tid()
        momentum_out[first[0], n] = vec4()
        if n < report_out.shape[0]:
            report_out[n] = LEAST
            if n % COLUMNS < FAILURES:
                report_out[n] = NOT_FAILED

    @wp.kernel(module=module)
    def update(
        slot: wp.int32,
        cleared_slot: wp.int32,
        # Model:
        model: Nodes,
        first: wp.array(dtype=wp.int32),
        # Data in and out:
        momentum: wp.array2d(dtype=vec4),
        # Data out:
        velocity_out: wp.array(dtype=vec4),
    ):
        n = wp.tid()
        rollout = n / model.nodes
        if not used(model, n, rollout):
            return
        p = momentum[first[0] + slot, n]
        kind = kind_at(model, n, rollout, p)
        velocity_out[n] = velocity_of(
            p, kind, model.timing[0], model.gravity, model.mass_floor, model.friction[rollout]
        )
        momentum[first[0] + cleared_slot, n] = vec4()

    @wp.kernel(module=module)
    def turn(
        slot: wp.int32,  # the substep whose momenta's adjoint is asked for; the velocities are those of the one before
        arriving: wp.int32,
        leaving: wp.int32,
        # Model:
        model: Nodes,
        first: wp.array(dtype=wp.int32),
        # Data in:
        momentum_in: wp.array2d(dtype=vec4),
        # Data in and out: adjoint of the nodes' velocity becomes that of (momentum, mass); rows by turns
        bar: wp.array2d(dtype=vec4),
        friction_bar: wp.array(dtype=scalar),
        # Data out:
        velocity_out: wp.array(dtype=vec4),
    ):
        n = wp.tid()
        rollout = n / model.nodes
        if not used(model, n, rollout):
            return
        friction = model.friction[rollout]
        if arriving != 0:
            p = momentum_in[first[0] + slot, n]
            kind = kind_at(model, n, rollout, p)
            back = velocity_adjoint(
                p, kind, model.timing[0], model.gravity, model.mass_floor, friction, bar[slot % 2, n]
            )
            bar[slot % 2, n] = back.momentum
            friction_bar[n] = friction_bar[n] + back.friction
        if leaving != 0:
            p0 = momentum_in[first[0] + slot - 1, n]
            kind0 = kind_at(model, n, rollout, p0)
            velocity_out[n] = velocity_of(p0, kind0, model.timing[0], model.gravity, model.mass_floor, friction)
            bar[(slot + 1) % 2, n] = vec4()

    return SimpleNamespace(Nodes=Nodes, start=start, update=update, turn=turn)
