"""Particle phases fused: grid to particle, plastic flow, stress, grip and particle to grid in one kernel.

Between two launches lies one node phase. A kernel that opens a frame only scatters (`leaving`), one that closes it only
gathers (`arriving`). Slots count from the frame's first one, `first[0]`, so that one CUDA graph serves every frame.
"""

import functools

import warp as wp

from physreal_core.simulation.constitutive import ResidualConfig
from physreal_core.simulation.cuda.adder import lane_adder
from physreal_core.simulation.cuda.laws import law_functions
from physreal_core.simulation.cuda.material import flow_functions, stress_functions
from physreal_core.simulation.cuda.report import COLUMNS, FAILURES, raise_to
from physreal_core.simulation.cuda.structs import particle_structs
from physreal_core.simulation.plain.grip import bond_functions
from physreal_core.simulation.plain.lattice import lattice_functions
from physreal_core.simulation.plain.stress_terms import stress_term_functions
from physreal_core.simulation.plain.transfer_functions import transfer_functions
from physreal_core.simulation.plain.transfers import NOT_FINITE, OUTSIDE
from physreal_core.simulation.scalars import scalar_types

Law = tuple[str, ResidualConfig | None]
"""Name of an expert and its residual."""


@functools.cache
def forward_kernel(
    module: wp.Module,
    elastic: Law,
    plastic: Law,
    gripped: bool,
    laws: tuple[str, ...],
    dtype: str,
    arriving: bool,
    leaving: bool,
) -> wp.Kernel:
    """The kernel from the nodes' velocities of one substep to the momenta of the next, or one of its halves.

    Args:
        module: where it is compiled.
        elastic, plastic: the laws.
        gripped: whether there are bonds.
        laws: the optional ones in use, see `laws_in_use`.
        dtype: "float32" or "float64".
        arriving: whether it gathers and flows.
        leaving: whether it scatters; if not, it checks the state and reports on it.
    """
    types, lattice = scalar_types(dtype), lattice_functions(dtype)
    scalar, vec3, vec4, mat33 = types.scalar, types.vec3, types.vec4, types.mat33
    structs, transfer = particle_structs(dtype), transfer_functions(dtype, lane_adder(dtype))
    Model, States = structs.Model, structs.States
    relative, inside, base_cell, fraction = lattice.relative, lattice.inside, lattice.base_cell, lattice.fraction
    node, weights, weight_slopes = lattice.node, lattice.weights, lattice.weight_slopes
    scatter, derivatives, three, gradient = transfer.scatter, transfer.derivatives, transfer.three, transfer.gradient
    offset_moments, momentum_field = transfer.offset_moments, transfer.momentum_field
    stress, flow = stress_functions(*elastic, dtype).stress, flow_functions(*plastic, dtype).flow
    bonds_force = bond_functions(dtype).bonds_force
    optional, viscous = law_functions(laws, dtype), "viscosity" in laws
    laws_force, laws_stress = optional.force, optional.stress
    average_rate = stress_term_functions(dtype).average_rate

    @wp.func
    def fail(model: Model, report: wp.array(dtype=wp.int64), rollout: int, kind: int, substep: int, p: int):
        key = wp.int64(substep) * wp.int64(model.particles) + wp.int64(model.place[p])
        wp.atomic_min(report, COLUMNS * rollout + kind, key)

    @wp.func
    def look(report: wp.array(dtype=wp.int64), rollout: int, x: vec3, ahead: vec3, speed: scalar):
        entry = COLUMNS * rollout + FAILURES
        low = wp.min(x, ahead)
        high = wp.max(x, ahead)
        for axis in range(3):
            raise_to(report, entry + axis, rollout, -wp.float64(low[axis]))
            raise_to(report, entry + 3 + axis, rollout, wp.float64(high[axis]))
        raise_to(report, entry + 6, rollout, wp.float64(speed))

    @wp.kernel(module=module)
    def forward(
        substep: wp.int32,  # of the state that is scattered or checked
        slot: wp.int32,
        slot_next: wp.int32,
        grid_slot: wp.int32,
        keep: wp.int32,
        # Model:
        model: Model,
        first: wp.array(dtype=wp.int32),
        # Data in:
        velocity_in: wp.array(dtype=vec4),
        # Data in and out: `slot_next` may be `slot`
        states: States,
        # Data out:
        momentum_out: wp.array2d(dtype=vec4),
        report_out: wp.array(dtype=wp.int64),
    ):
        p = wp.tid()
        rollout = p / model.particles
        row = rollout * model.nodes
        box = model.box[rollout]
        dt = model.timing[0]
        now = first[0] + slot
        after = first[0] + slot_next
        x = states.x[now, p]
        F = states.F[now, p]
        v = vec3()
        C = mat33()
        rate = mat33()
        if viscous:
            rate = states.rate[now, p]
        if arriving:
            r0 = relative(x, model.offset, model.cells_per_metre, box)
            if not inside(r0, box):
                states.x[after, p] = x
                return
            base0 = base_cell(r0)
            f0 = fraction(r0, base0)
            field = derivatives(velocity_in, box, row + node(base0, box), weights(f0), weight_slopes(f0))
            v = three(field.value)
            C = model.cells_per_metre * offset_moments(field, f0)
            x += dt * v
            F = flow(
                F + (dt * model.cells_per_metre) * (gradient(field) * F), model.E[p], model.nu[p], model.plastic[p], model.timing, p,
                model.latent_plastic, model.weights_plastic[rollout],
            )  # fmt: skip
            states.x[after, p] = x
            states.F[after, p] = F
            if keep != 0 or not leaving:
                states.v[after, p] = v
                states.C[after, p] = C
            if viscous:
                rate = average_rate(model.timing[3], rate, C)
                states.rate[after, p] = rate
        else:
            v = states.v[now, p]
            C = states.C[now, p]
        r = relative(x, model.offset, model.cells_per_metre, box)
        if leaving:
            m = model.mass[p]
            tau = stress(F, model.E[p], model.nu[p], p, model.latent_elastic, model.weights_elastic[rollout])
            tau = laws_stress(model.laws, p, F, rate, tau)
            if keep != 0:
                states.tau[after, p] = tau
            force = laws_force(model.laws, p, rollout, m, x, v, model.load[p])
            if gripped:
                force = bonds_force(
                    model.bonds, model.bond_begin[p], model.bond_end[p], model.grip[rollout, 0],
                    model.grip[rollout, 1], model.timing, substep, model.controllers[rollout], x, v, force,
                )  # fmt: skip
            momentum = m * v + dt * force
            size = wp.dot(momentum, momentum) + wp.ddot(C, C) + wp.ddot(tau, tau)
            if not inside(r, box) or not wp.isfinite(size):
                kind = OUTSIDE
                if not wp.isfinite(wp.dot(r, r) + size):
                    kind = NOT_FINITE
                fail(model, report_out, rollout, kind, substep, p)
                return
            base = base_cell(r)
            f = fraction(r, base)
            n = row + node(base, box)
            given = momentum_field(m, momentum, model.volume[p], C, tau, dt, model.cells_per_metre, f)
            scatter(
                momentum_out[first[0] + grid_slot], box, n, weights(f), weight_slopes(f), given.q, given.A, given.B
            )  # fmt: skip
        else:
            look(report_out, rollout, x, x + v / model.timing[2], wp.length(v))
            if not wp.isfinite(wp.dot(r, r) + wp.dot(v, v) + wp.ddot(F, F)):
                fail(model, report_out, rollout, NOT_FINITE, substep, p)
            elif not inside(r, box):
                fail(model, report_out, rollout, OUTSIDE, substep, p)

    return forward
