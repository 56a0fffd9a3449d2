// Particle phases fused: grid to particle, plastic flow, stress, grip and particle to grid in one kernel; and their
// adjoint.
//
// Between two launches lies one node phase. A launch that opens a frame only scatters (LEAVING), one that closes it
// only gathers (ARRIVING); the adjoint's launch at a state takes the adjoints of the forces that this state scattered
// (ARRIVING), then scatters those of the velocities it was gathered from (LEAVING). Places on the grid are those of the
// body at rest, all the time.
#pragma once
#include "contacts.h"
#include "forces.h"
#include "material.h"
#include "shape.h"
#include "transfers.h"

namespace physreal {

// INPUTS, TERMS, HAND, LED: as of ParticleForces; SHAPED: whether the body's own shape may differ from that on the grid
// (shape.h); TOUCHES: whether the body touches itself.
template <class S, bool INPUTS, Index TERMS, bool SHAPED, int HAND, bool LED, bool TOUCHES, class Material>
class ParticleOfRollout : ParticleForces<S, INPUTS, TERMS, HAND, LED> {
    using Forces = ParticleForces<S, INPUTS, TERMS, HAND, LED>;
    using typename Forces::At;
    using Forces::add_inputs, Forces::branch_place, Forces::BRANCHES, Forces::constant, Forces::dt_, Forces::f_,
        Forces::fail, Forces::finite, Forces::force, Forces::force_adjoint, Forces::get3, Forces::get9, Forces::own_,
        Forces::p_, Forces::place_in, Forces::put, Forces::rollout_, Forces::touching, Forces::touching_adjoint;
    const S per_metre_;  // cells per metre
    Material material_;
    static constexpr bool VISCOUS = TERMS & term::viscosity, FLOWS = Material::flows;

public:
    ParticleOfRollout(const Frame<S>& f, int rollout, int own)
        : Forces(f, rollout, own),
          per_metre_(1 / f.cell),
          material_(material_arrays<INPUTS>(f, f.timing[0], f.timing[1],
                                            f.network_elastic + rollout_ * f.weights_elastic,
                                            f.network_plastic + rollout_ * f.weights_plastic,
                                            f.network_elastic_bar + weight_row() * f.weights_elastic,
                                            f.network_plastic_bar + weight_row() * f.weights_plastic, (S*)nullptr)) {}

    // Mass and volume to the nodes.
    void give_mass() const {
        const Vec3<S> q = {{constant(constant::mass), constant(constant::volume), 0}};
        leave(Field<S>(q, S(0), {}));
    }

    // substep: of the state that is scattered or checked. `slot_next` may be `slot`.
    template <bool ARRIVING, bool LEAVING>
    void forward(int substep, int slot, int slot_next, int keep) {
        const Index now = place_in(slot), after = place_in(slot_next);
        Vec3<S> x = get3(f_.x, now), v;
        Mat3<S> F = get9(f_.F, now), B = shape_at(now), rate = rate_at(now);
        if constexpr (ARRIVING) {
            const Derivatives<S> moved(grid(f_.velocity), place());
            v = three(moved.value);
            x = x + dt_ * v;
            const ShapeOnGrid<SHAPED, S> on_grid(F, B);
            const Mat3<S> change = on_grid.change((dt_ * per_metre_) * moved.gradient());
            if constexpr (VISCOUS || BRANCHES > 0) {
                const Mat3<S> step = on_grid.step(change);
                if constexpr (VISCOUS) {
                    rate = remembered() * rate + (1 - remembered()) * symmetric((1 / dt_) * step);
                    put(f_.rate, after, rate);
                }
                if constexpr (BRANCHES > 0) advance_branches(now, after, step);
            }
            F += change;
            if constexpr (FLOWS) {
                const Mat3<S> trial = F;
                F = material_.flow(p_, trial);
                B = shape_after_flow(B, trial, F);
            }
            put(f_.x, after, x);
            if constexpr (TOUCHES) sums().follow(p_, x);
            put(f_.F, after, F);
            if constexpr (SHAPED) put(f_.shape, after, B);
            if (keep || !LEAVING) put(f_.v, after, v);
        } else {
            v = get3(f_.v, now);
        }
        if constexpr (LEAVING)
            scatter_forces(substep, after, x, v, F, B, rate);
        else if (!finite(dot(x, x) + dot(v, v) + dot(F, F)))
            fail(substep);
    }

    template <bool ARRIVING, bool LEAVING>
    void backward(int slot) {
        const Index now = place_in(slot);
        if (!finite(f_.x[3 * now])) {  // of a rollout that has failed
            if constexpr (LEAVING) leave(Field<S>({}, S(0), {}));
            return;
        }
        Vec3<S> x_bar = get3(f_.x_bar, p_), v_bar = {};
        Mat3<S> F_bar = get9(f_.F_bar, p_), B_bar = {}, rate_bar = {};
        if constexpr (SHAPED) B_bar = get9(f_.shape_bar, p_);
        if constexpr (VISCOUS) rate_bar = get9(f_.rate_bar, p_);
        if constexpr (ARRIVING)
            forces_adjoint(slot, now, x_bar, v_bar, F_bar, B_bar, rate_bar);
        else
            v_bar = get3(f_.v_bar, p_);
        if constexpr (TOUCHES && LEAVING) sums().add_bars(p_, own_, slot, x_bar, v_bar);
        if constexpr (LEAVING)
            velocity_adjoint(place_in(slot - 1), x_bar, v_bar, F_bar, B_bar, rate_bar);
        else
            put(f_.v_bar, p_, v_bar);
        if constexpr (SHAPED) put(f_.shape_bar, p_, B_bar);
        if constexpr (VISCOUS) put(f_.rate_bar, p_, rate_bar);
        put(f_.x_bar, p_, x_bar);
        put(f_.F_bar, p_, F_bar);
    }

    // The share in the masses' adjoint, and where the body touches itself what pairs left of the frame's first substep.
    void settle() const {
        if constexpr (TOUCHES)
            if (finite(f_.x[3 * place_in(0)])) {
                Vec3<S> x_bar = get3(f_.x_bar, p_), v_bar = get3(f_.v_bar, p_);
                sums().add_bars(p_, own_, 0, x_bar, v_bar);
                put(f_.x_bar, p_, x_bar);
                put(f_.v_bar, p_, v_bar);
            }
        if constexpr (INPUTS)
            if (finite(f_.x[3 * place_in(0)]))
                f_.bars[(bar::COUNT + input::mass) * f_.stride + p_] +=
                    Derivatives<S>(grid(f_.node_bar), place()).value[3];
    }

private:
    ContactSums<S> sums() const { return {f_, rollout_}; }
    // One row of a network's weights' adjoint to a warp, which sums its shares.
    Index weight_row() const { return rollout_ * f_.weight_rows + p_ / 32 % f_.weight_rows; }
    S remembered() const { return f_.timing[3]; }
    Mat3<S> rate_at(Index now) const {
        if constexpr (VISCOUS) return get9(f_.rate, now);
        return {};
    }
    Mat3<S> shape_at(Index now) const {
        if constexpr (SHAPED) return get9(f_.shape, now);
        return {};
    }
    Place<S> place() const {
        const Vec3<S> x = {{constant(constant::place), constant(constant::place + 1), constant(constant::place + 2)}};
        return Place<S>(x, f_.lowest_node + 3 * own_, f_.offset, per_metre_, f_.count);
    }
    // The rollout's first node.
    const Vec4<S>* grid(const S* grids) const {
        return reinterpret_cast<const Vec4<S>*>(grids) + Index(rollout_) * f_.nodes;
    }
    void leave(const Field<S>& field) const { field.scatter(Parts<S>(f_, rollout_, own_), place()); }

    // --- strains of Maxwell branches

    // Calls use(place of the branch among the particle's, place of its time among the numbers).
    template <class Use>
    static void each_branch(Use use) {
        BranchTerms::each(TERMS, [&](auto law) {
            for (int k = 0; k < law.COUNT; ++k) use(branches_before(TERMS, law.TERM) + k, law.TIMES + k);
        });
    }

    S time_of(int place) const { return f_.numbers[rollout_ * number::COUNT + place]; }

    // step: dt grad v.
    void advance_branches(Index now, Index after, const Mat3<S>& step) const {
        const BranchStep<S> of_step(step);
        each_branch([&](int k, int time) {
            const Mat3<S> A = get9(f_.branches, now * BRANCHES + k);
            put(f_.branches, after * BRANCHES + k, of_step.advance(A, kept_half(dt_, time_of(time))));
        });
    }

    // The branches' adjoints go from after the substep to before it.
    void advance_branches_adjoint(Index before, const Mat3<S>& step, Mat3<S>& step_bar) const {
        const BranchStep<S> of_step(step);
        each_branch([&](int k, int time) {
            const Index own = p_ * Index(BRANCHES) + k;
            const Mat3<S> A = get9(f_.branches, before * BRANCHES + k), next_bar = get9(f_.branches_bar, own);
            S kept_bar = 0;
            put(f_.branches_bar, own, of_step.adjoint(A, kept_half(dt_, time_of(time)), next_bar, step_bar, kept_bar));
            f_.particle_sums[(particle_sum::numbers + time) * f_.stride + p_] +=
                kept_half_slope(dt_, time_of(time)) * kept_bar;
        });
    }

    // --- forces and stresses

    Mat3<S> stress(const At& at, const Mat3<S>& F, Mat3<S> tau) const {
        StressTerms::each(TERMS, [&](auto law) { tau += law.stress(at, F); });
        return tau;
    }

    // dt f w, and - dt V P grad w with P the stress on the grid's areas.
    void scatter_forces(int substep, Index now, const Vec3<S>& x, const Vec3<S>& v, const Mat3<S>& F,
                        const Mat3<S>& B, const Mat3<S>& rate) {
        const At at = {*this, now, x, v, rate};
        const Mat3<S> P = ShapeOnGrid<SHAPED, S>(F, B).stress(stress(at, F, material_.stress(p_, F).tau));
        Vec3<S> push = dt_ * force(substep, at);
        if constexpr (TOUCHES) push = push + dt_ * sums().take_force(p_);
        const bool sound = finite(dot(x, x) + dot(push, push) + dot(P, P));
        if (!sound) fail(substep);
        const S volume = constant(constant::volume);
        leave(sound ? Field<S>(push, volume * touching(x[2]), (-dt_ * volume * per_metre_) * P) : Field<S>({}, S(0), {}));
    }

    // --- adjoints

    // Of forces and stress: v_bar is set, the others grow.
    void forces_adjoint(int slot, Index now, Vec3<S>& x_bar, Vec3<S>& v_bar, Mat3<S>& F_bar, Mat3<S>& B_bar,
                       Mat3<S>& rate_bar) {
        const Mat3<S> F = get9(f_.F, now);
        At at = {*this, now, get3(f_.x, now), get3(f_.v, now), rate_at(now)};
        const auto expert = material_.stress(p_, F);
        const Derivatives<S> bar(grid(f_.node_bar), place());
        const Vec3<S> f_bar = dt_ * three(bar.value);
        const Mat3<S> P_bar = (-dt_ * constant(constant::volume) * per_metre_) * bar.gradient();
        const Mat3<S> tau_bar =
            ShapeOnGrid<SHAPED, S>(F, shape_at(now)).stress_adjoint(stress(at, F, expert.tau), P_bar, F_bar, B_bar);
        x_bar[2] += touching_adjoint(at.x_[2], bar.value[3]);
        force_adjoint(slot, at, f_bar);
        if constexpr (TOUCHES) sums().keep(p_, slot, f_bar);
        if constexpr ((TERMS & StressTerms::TERMS) != 0) {
            const Mat3<S> T = symmetric(tau_bar);
            StressTerms::each(TERMS, [&](auto law) { law.adjoint(at, F, T, F_bar); });
        }
        x_bar = x_bar + at.x_bar;
        v_bar = at.v_bar;
        rate_bar += at.rate_bar;
        add_inputs(at.mass_bar, f_bar);
        material_.stress_adjoint(p_, expert, F, tau_bar, F_bar);
    }

    // Of plastic flow and grid to particle.
    void velocity_adjoint(Index before, const Vec3<S>& x_bar, const Vec3<S>& v_bar, Mat3<S>& F_bar,
                          Mat3<S>& B_bar, Mat3<S>& rate_bar) {
        const Mat3<S> F = get9(f_.F, before), B = shape_at(before);
        const Mat3<S> dD = (dt_ * per_metre_) * Derivatives<S>(grid(f_.velocity), place()).gradient();
        const ShapeOnGrid<SHAPED, S> on_grid(F, B);
        const Mat3<S> change = on_grid.change(dD);
        Mat3<S> change_bar = F_bar;
        if constexpr (FLOWS) {
            const Mat3<S> trial = F + change;
            change_bar = {};
            shape_after_flow_adjoint(B, trial, material_.flow(p_, trial), B_bar, change_bar, F_bar);
            change_bar += material_.flow_adjoint(p_, trial, F_bar);
        }
        F_bar = change_bar;
        if constexpr (VISCOUS || BRANCHES > 0) {
            Mat3<S> step_bar = {};
            if constexpr (VISCOUS) {
                step_bar += ((1 - remembered()) / dt_) * symmetric(rate_bar);
                rate_bar = remembered() * rate_bar;
            }
            if constexpr (BRANCHES > 0) advance_branches_adjoint(before, on_grid.step(change), step_bar);
            change_bar += on_grid.step_adjoint(change, step_bar, F_bar);
        }
        const Mat3<S> dD_bar = on_grid.change_adjoint(dD, change_bar, B_bar);
        leave(Field<S>(v_bar + dt_ * x_bar, S(0), (dt_ * per_metre_) * dD_bar));
    }
};

}  // namespace physreal
