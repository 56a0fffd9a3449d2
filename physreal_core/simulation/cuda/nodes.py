"""Node phases on the boxes of all rollouts at once: velocities from momenta, and on the way back both adjoints in one.

Every rollout has `nodes` rows of storage, of which its box takes the first. Slots count from the frame's first one,
`first[0]`, so that one CUDA graph serves every frame that is kept.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.cuda.report import COLUMNS, FAILURES, LEAST, NOT_FAILED
from physreal_core.simulation.plain.friction import sliding_functions
from physreal_core.simulation.plain.grid import FREE, node_functions
from physreal_core.simulation.scalars import kernel_module, scalar_types


@functools.cache
def node_kernels(dtype: str, slides: bool, tilts: bool) -> SimpleNamespace:
    """Structs `Nodes`, `NodeBars` and kernels `start`, `update`, `turn` over one scalar type.

    Args:
        dtype: "float32" or "float64".
        slides: whether friction depends on speed, as the term friction_law says.
        tilts: whether the adjoint of gravity is asked for, as the term gravity does.
    """
    types = scalar_types(dtype)
    scalar, vec3, vec4 = types.scalar, types.vec3, types.vec4
    module = kernel_module(f"cuda_nodes{'_sliding' if slides else ''}{'_tilted' if tilts else ''}", dtype)
    functions, sliding = node_functions(dtype), sliding_functions(dtype)
    kind_of, kind_now = functions.kind_of, functions.kind_now
    coulomb, coulomb_adjoint = functions.velocity_of, functions.velocity_adjoint
    slide, slide_adjoint = sliding.velocity_of, sliding.velocity_adjoint

    @wp.struct
    class Nodes:
        """What the node phases read besides momenta."""

        nodes: wp.int32
        offset: vec3
        cell: scalar
        gravity: wp.array(dtype=vec3)  # [rollouts]
        mass_floor: scalar
        has_ground: wp.int32
        clamp_lower: wp.array(dtype=vec3)
        clamp_upper: wp.array(dtype=vec3)
        timing: wp.array(dtype=scalar)
        friction: wp.array(dtype=scalar)  # [rollouts]
        friction_law: wp.array2d(dtype=scalar)  # [rollouts, 3]
        box: wp.array2d(dtype=wp.int32)  # [rollouts, 6]

    @wp.func
    def used(model: Nodes, n: int, rollout: int):
        """Whether a row of storage belongs to the rollout's box."""
        return n - rollout * model.nodes < model.box[rollout, 3] * model.box[rollout, 4] * model.box[rollout, 5]

    @wp.func
    def kind_at(model: Nodes, n: int, rollout: int, momentum: wp.array2d(dtype=vec4), slot: int):
        """Of node n in a substep, whose (momentum, mass) are a slot."""
        kind = FREE
        if momentum[slot, n][3] > model.mass_floor and (model.has_ground != 0 or model.clamp_lower.shape[0] > 0):
            own, place = n - rollout * model.nodes, model.box[rollout]
            kind = kind_of(own, model.offset, model.cell, place, model.has_ground, model.clamp_lower, model.clamp_upper)
            kind = kind_now(kind, momentum, slot, n)
        return kind

    @wp.func
    def velocity_of(model: Nodes, p: vec4, kind: int, rollout: int):
        dt = model.timing[0]
        g = model.gravity[rollout]
        mu = model.friction[rollout]
        if slides:
            v = slide(p, kind, dt, g, model.mass_floor, mu, model.friction_law[rollout])
        else:
            v = coulomb(p, kind, dt, g, model.mass_floor, mu)
        return v

    @wp.struct
    class NodeBars:
        """Adjoints of what nodes of a rollout share, [nodes of all rollouts]; empty without the term."""

        friction: wp.array(dtype=scalar)
        gravity: wp.array(dtype=vec3)
        friction_law: wp.array(dtype=vec3)

    @wp.func
    def velocity_adjoint(model: Nodes, bars: NodeBars, n: int, p: vec4, kind: int, rollout: int, velocity_bar: vec4):
        """Adjoint of (momentum, mass); adds to the bars of node n."""
        dt = model.timing[0]
        g = model.gravity[rollout]
        mu = model.friction[rollout]
        if slides:
            back = slide_adjoint(p, kind, dt, g, model.mass_floor, mu, model.friction_law[rollout], velocity_bar)
            bars.friction_law[n] = bars.friction_law[n] + back.law
        else:
            back = coulomb_adjoint(p, kind, dt, g, model.mass_floor, mu, velocity_bar)
        bars.friction[n] = bars.friction[n] + back.friction
        if tilts:  # gravity acts on the velocity as momentum / mass does, dt times
            bars.gravity[n] = bars.gravity[n] + (dt * p[3]) * vec3(back.momentum[0], back.momentum[1], back.momentum[2])
        return back.momentum

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
        kind = kind_at(model, n, rollout, momentum, first[0] + slot)
        velocity_out[n] = velocity_of(model, momentum[first[0] + slot, n], kind, rollout)
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
        bars: NodeBars,
        # Data out:
        velocity_out: wp.array(dtype=vec4),
    ):
        n = wp.tid()
        rollout = n / model.nodes
        if not used(model, n, rollout):
            return
        if arriving != 0:
            p = momentum_in[first[0] + slot, n]
            kind = kind_at(model, n, rollout, momentum_in, first[0] + slot)
            bar[slot % 2, n] = velocity_adjoint(model, bars, n, p, kind, rollout, bar[slot % 2, n])
        if leaving != 0:
            kind0 = kind_at(model, n, rollout, momentum_in, first[0] + slot - 1)
            velocity_out[n] = velocity_of(model, momentum_in[first[0] + slot - 1, n], kind0, rollout)
            bar[(slot + 1) % 2, n] = vec4()

    return SimpleNamespace(Nodes=Nodes, NodeBars=NodeBars, start=start, update=update, turn=turn)
