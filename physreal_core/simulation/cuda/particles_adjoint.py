"""Adjoint of the fused particle phases: of particle to grid, grip and stress, then of plastic flow and grid to particle.

The launch at a state takes the adjoints of the momenta that this state scattered (`arriving`) and scatters those of the
velocities it was gathered from (`leaving`); at the ends of a frame one half falls away.
"""

import functools

import warp as wp

from physreal_core.simulation.cuda.adder import lane_adder
from physreal_core.simulation.cuda.laws import law_functions
from physreal_core.simulation.cuda.material import flow_functions, stress_functions
from physreal_core.simulation.cuda.particles import Law
from physreal_core.simulation.cuda.structs import particle_structs
from physreal_core.simulation.plain.grip import bond_functions
from physreal_core.simulation.plain.lattice import lattice_functions
from physreal_core.simulation.plain.stress_terms import stress_term_functions
from physreal_core.simulation.plain.transfer_functions import transfer_functions
from physreal_core.simulation.scalars import scalar_types


@functools.cache
def backward_kernel(
    module: wp.Module,
    elastic: Law,
    plastic: Law,
    gripped: bool,
    laws: tuple[str, ...],
    inputs: tuple[str, ...],
    dtype: str,
    arriving: bool,
    leaving: bool,
) -> wp.Kernel:
    """Adjoint of `particles.forward_kernel`; arguments as there, the halves as the backward pass meets them.

    `inputs` names what else has an adjoint that is summed up: density, force, controllers.
    """
    types, lattice = scalar_types(dtype), lattice_functions(dtype)
    scalar, vec2, vec3, vec4, mat33 = types.scalar, types.vec2, types.vec3, types.vec4, types.mat33
    structs, transfer = particle_structs(dtype), transfer_functions(dtype, lane_adder(dtype))
    Model, States, Bars = structs.Model, structs.States, structs.Bars
    relative, inside, base_cell, fraction = lattice.relative, lattice.inside, lattice.base_cell, lattice.fraction
    node, weights, weight_slopes = lattice.node, lattice.weights, lattice.weight_slopes
    scatter, derivatives, three, gradient = transfer.scatter, transfer.derivatives, transfer.three, transfer.gradient
    offset_moments, slope = transfer.offset_moments, transfer.slope
    momentum_field, velocity_bar_field = transfer.momentum_field, transfer.velocity_bar_field
    stress_adjoint = stress_functions(*elastic, dtype).stress_adjoint
    flow_adjoint = flow_functions(*plastic, dtype).flow_adjoint
    flows = plastic != ("identity", None)
    bonds = bond_functions(dtype)
    bonds_force, bonds_adjoint, points_adjoint = bonds.bonds_force, bonds.bonds_adjoint, bonds.points_adjoint
    optional, viscous = law_functions(laws, dtype), "viscosity" in laws
    has_laws, weighed, pushed = bool(laws), "density" in inputs, "force" in inputs
    led = gripped and "controllers" in inputs
    laws_force, laws_force_adjoint = optional.force, optional.force_adjoint
    laws_stress_adjoint = optional.stress_adjoint
    average_rate_adjoint = stress_term_functions(dtype).average_rate_adjoint
    four = scalar(4.0)

    @wp.kernel(module=module)
    def backward(
        slot: wp.int32,  # of the state, and its substep
        # Model:
        model: Model,
        first: wp.array(dtype=wp.int32),
        # Data in:
        velocity_in: wp.array(dtype=vec4),
        states: States,
        # Data in and out: nodes' adjoints, of momenta in row slot % 2, of velocities in the other
        node_bar: wp.array2d(dtype=vec4),
        bars: Bars,
    ):
        p = wp.tid()
        rollout = p / model.particles
        row = rollout * model.nodes
        box = model.box[rollout]
        dt = model.timing[0]
        cells_per_metre = model.cells_per_metre
        weight_row = rollout * bars.weight_rows + p / 32 % bars.weight_rows  # one to a warp, which sums its shares
        at = first[0] + slot
        E = model.E[p]
        nu = model.nu[p]
        E_bar = bars.E[p]
        nu_bar = bars.nu[p]
        x_bar = bars.x[p]
        F_bar = bars.F[p]
        v_bar = vec3()
        C_bar = mat33()
        rate = mat33()
        rate_bar = mat33()
        if viscous:
            rate = states.rate[at, p]
            rate_bar = bars.laws.rate[p]
        v = states.v[at, p]
        C = states.C[at, p]
        if arriving:
            x = states.x[at, p]
            r = relative(x, model.offset, cells_per_metre, box)
            if not inside(r, box):
                return
            base = base_cell(r)
            f = fraction(r, base)
            m = model.mass[p]
            volume = model.volume[p]
            force = laws_force(model.laws, p, rollout, m, x, v, model.load[p])
            if gripped:
                force = bonds_force(
                    model.bonds, model.bond_begin[p], model.bond_end[p], model.grip[rollout, 0],
                    model.grip[rollout, 1], model.timing, slot, model.controllers[rollout], x, v, force,
                )  # fmt: skip
            push = m * v + dt * force
            field = derivatives(node_bar[slot % 2], box, row + node(base, box), weights(f), weight_slopes(f))
            q_bar = three(field.value)
            apic_bar = offset_moments(field, f)
            given = momentum_field(m, push, volume, C, states.tau[at, p], dt, cells_per_metre, f)
            x_bar += cells_per_metre * slope(field, given, f)
            v_bar = m * q_bar
            C_bar = (m / (four * cells_per_metre)) * apic_bar
            tau_bar = (-dt * volume * cells_per_metre) * gradient(field)
            if gripped:
                pull = bonds_adjoint(
                    model.bonds, model.bond_begin[p], model.bond_end[p], model.grip[rollout, 0],
                    model.grip[rollout, 1], model.timing, slot, model.controllers[rollout], x, v, dt * q_bar,
                )  # fmt: skip
                x_bar += pull.x
                v_bar += pull.v
                if led:
                    points_adjoint(
                        model.bonds, model.bond_begin[p], model.bond_end[p], model.grip[rollout, 0],
                        model.grip[rollout, 1], model.timing, slot, model.controllers[rollout], x, v, dt * q_bar,
                        bars.controllers[rollout],
                    )  # fmt: skip
                bars.grip[p] = bars.grip[p] + vec2(pull.stiffness, pull.damping)
            mass_bar = field.value[3] + wp.dot(v, q_bar) + wp.ddot(C, apic_bar) / (four * cells_per_metre)
            if has_laws:
                acted = laws_force_adjoint(model.laws, bars.laws, p, rollout, m, x, v, dt * q_bar)
                x_bar += acted.x
                v_bar += acted.v
                mass_bar += acted.mass
                strained = laws_stress_adjoint(model.laws, bars.laws, p, states.F[at, p], rate, tau_bar)
                F_bar += strained.F
                rate_bar += strained.rate
            if weighed:
                bars.mass[p] = bars.mass[p] + mass_bar
            if pushed:
                bars.load[p] = bars.load[p] + dt * q_bar
            s = stress_adjoint(
                states.F[at, p], E, nu, p, model.latent_elastic, model.weights_elastic[rollout], tau_bar,
                bars.latent_elastic, bars.weights_elastic, weight_row,
            )  # fmt: skip
            F_bar += s.F
            E_bar += s.E
            nu_bar += s.nu
        else:
            v_bar = bars.v[p]
            C_bar = bars.C[p]
        if leaving:
            F0 = states.F[at - 1, p]
            r0 = relative(states.x[at - 1, p], model.offset, cells_per_metre, box)
            if not inside(r0, box):
                return
            if viscous:
                C_bar += average_rate_adjoint(model.timing[3], rate_bar)
                rate_bar = model.timing[3] * rate_bar
            base0 = base_cell(r0)
            f0 = fraction(r0, base0)
            first0 = row + node(base0, box)
            w0 = weights(f0)
            dw0 = weight_slopes(f0)
            moved = derivatives(velocity_in, box, first0, w0, dw0)
            L = cells_per_metre * gradient(moved)
            if flows:
                back = flow_adjoint(
                    F0 + dt * (L * F0), E, nu, model.plastic[p], model.timing, p, model.latent_plastic,
                    model.weights_plastic[rollout], F_bar, bars.latent_plastic, bars.weights_plastic, weight_row,
                )  # fmt: skip
                F_bar = back.F
                E_bar += back.E
                nu_bar += back.nu
                bars.plastic[p] = bars.plastic[p] + back.y
            u = velocity_bar_field(
                v_bar + dt * x_bar, C_bar, dt * F_bar * wp.transpose(F0), cells_per_metre, f0
            )  # fmt: skip
            scatter(node_bar[(slot + 1) % 2], box, first0, w0, dw0, u.q, u.A, u.B)
            x_bar += cells_per_metre * slope(moved, u, f0)
            F_bar += dt * wp.transpose(L) * F_bar
        else:
            bars.v[p] = v_bar
            bars.C[p] = C_bar
        if viscous:
            bars.laws.rate[p] = rate_bar
        bars.x[p] = x_bar
        bars.F[p] = F_bar
        bars.E[p] = E_bar
        bars.nu[p] = nu_bar

    return backward
