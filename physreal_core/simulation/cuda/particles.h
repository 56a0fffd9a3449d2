// Particle phases fused: grid to particle, plastic flow, stress, grip and particle to grid in one kernel; and their
// adjoint.
//
// Between two launches lies one node phase. A launch that opens a frame only scatters (LEAVING), one that closes it
// only gathers (ARRIVING); the adjoint's launch at a state takes the adjoints of the momenta that this state scattered
// (ARRIVING), then scatters those of the velocities it was gathered from (LEAVING). Slots count from the frame's first
// one, `first[0]`, so that one CUDA graph serves every frame.
#pragma once
#include "grip.h"
#include "material.h"
#include "report.h"
#include "transfers.h"

namespace physreal {

// INPUTS: whether masses and forces have adjoints; TERMS: bits of the optional laws in use; LED: whether the controller
// points have.
template <class S, bool INPUTS, Index TERMS, bool GRIPPED, bool LED, class Material>
class ParticleOfRollout {
    const Frame<S>& f_;
    const int p_, rollout_;  // number among all, and its rollout
    const int* box_;
    const S dt_, per_metre_;  // cells per metre
    Material material_;
    static constexpr bool VISCOUS = TERMS & term::viscosity, FLOWS = Material::flows;
    static constexpr int BRANCHES = branches_of(TERMS);

public:
    ParticleOfRollout(const Frame<S>& f, int p)
        : f_(f),
          p_(p),
          rollout_(p / int(f.particles)),
          box_(f.box + 6 * rollout_),
          dt_(f.timing[0]),
          per_metre_(1 / f.cell),
          material_(material_arrays<INPUTS>(f, f.timing[0], f.timing[1],
                                            f.network_elastic + rollout_ * f.weights_elastic,
                                            f.network_plastic + rollout_ * f.weights_plastic,
                                            f.network_elastic_bar + weight_row() * f.weights_elastic,
                                            f.network_plastic_bar + weight_row() * f.weights_plastic, (S*)nullptr)) {}

    // substep: of the state that is scattered or checked. `slot_next` may be `slot`.
    template <bool ARRIVING, bool LEAVING>
    void forward(int substep, int slot, int slot_next, int grid_slot, int keep) {
        const Index now = place_in(slot), after = place_in(slot_next);
        Vec3<S> x = get3(f_.x, now), v;
        Mat3<S> F = get9(f_.F, now), C, rate = rate_at(now);
        if constexpr (ARRIVING) {
            const Place<S> at = place(x);
            if (!at.inside) {
                put(f_.x, after, x);
                return;
            }
            const Derivatives<S> moved(grid(f_.velocity, 0), at);
            v = three(moved.value);
            C = per_metre_ * moved.offset_moments(at);
            x = x + dt_ * v;
            const Mat3<S> gradient = moved.gradient();
            F += (dt_ * per_metre_) * (gradient * F);
            if constexpr (FLOWS) F = material_.flow(p_, F);
            put(f_.x, after, x);
            put(f_.F, after, F);
            if (keep || !LEAVING) {
                put(f_.v, after, v);
                put(f_.C, after, C);
            }
            if constexpr (VISCOUS) {
                rate = remembered() * rate + (1 - remembered()) * symmetric(C);
                put(f_.rate, after, rate);
            }
            if constexpr (BRANCHES > 0) advance_branches(now, after, (dt_ * per_metre_) * gradient);
        } else {
            v = get3(f_.v, now);
            C = get9(f_.C, now);
        }
        if constexpr (LEAVING)
            scatter_momentum(substep, grid_slot, after, x, v, F, C, rate);
        else
            check(substep, x, v, F);
    }

    template <bool ARRIVING, bool LEAVING>
    void backward(int slot) {
        const Index now = place_in(slot);
        Vec3<S> x_bar = get3(f_.x_bar, p_), v_bar;
        Mat3<S> F_bar = get9(f_.F_bar, p_), C_bar, rate_bar = {};
        if constexpr (VISCOUS) rate_bar = get9(f_.rate_bar, p_);
        if constexpr (ARRIVING) {
            const Place<S> at = place(get3(f_.x, now));
            if (!at.inside) return;
            momentum_adjoint(slot, now, at, x_bar, v_bar, F_bar, C_bar, rate_bar);
        } else {
            v_bar = get3(f_.v_bar, p_);
            C_bar = get9(f_.C_bar, p_);
        }
        if constexpr (LEAVING) {
            const Index before = place_in(slot - 1);
            const Place<S> at = place(get3(f_.x, before));
            if (!at.inside) return;
            if constexpr (VISCOUS) {
                C_bar += (1 - remembered()) * symmetric(rate_bar);
                rate_bar = remembered() * rate_bar;
            }
            velocity_adjoint(slot, before, at, x_bar, v_bar, F_bar, C_bar);
        } else {
            put(f_.v_bar, p_, v_bar);
            put(f_.C_bar, p_, C_bar);
        }
        if constexpr (VISCOUS) put(f_.rate_bar, p_, rate_bar);
        put(f_.x_bar, p_, x_bar);
        put(f_.F_bar, p_, F_bar);
    }

private:
    // One row of a network's weights' adjoint to a warp, which sums its shares.
    Index weight_row() const { return rollout_ * f_.weight_rows + p_ / 32 % f_.weight_rows; }
    Index place_in(int slot) const { return Index(f_.first[0] + slot) * f_.stride + p_; }
    S constant(int row) const { return f_.constants[row * f_.stride + p_]; }
    S remembered() const { return f_.timing[3]; }
    Mat3<S> rate_at(Index now) const {
        if constexpr (VISCOUS) return get9(f_.rate, now);
        return {};
    }
    Place<S> place(const Vec3<S>& x) const { return Place<S>(x, f_.offset, per_metre_, box_); }
    // The rollout's first node in a slot of grids.
    Vec4<S>* grid(S* grids, int slot) const {
        return reinterpret_cast<Vec4<S>*>(grids) + (Index(slot) * f_.rollouts + rollout_) * f_.nodes;
    }

    static Vec3<S> get3(const S* from, Index i) {
        from += 3 * i;
        return {{from[0], from[1], from[2]}};
    }
    static Mat3<S> get9(const S* from, Index i) {
        Mat3<S> M;
        for (int e = 0; e < 9; ++e) M.m[e] = from[9 * i + e];
        return M;
    }
    static void put(S* to, Index i, const Vec3<S>& value) {
        for (int d = 0; d < 3; ++d) to[3 * i + d] = value[d];
    }
    static void put(S* to, Index i, const Mat3<S>& value) {
        for (int e = 0; e < 9; ++e) to[9 * i + e] = value.m[e];
    }
    static bool finite(S sum) { return sum - sum == 0; }

    // --- strains of Maxwell branches

    // Among the branches of all, of the k-th of a term's of the particle whose state is at a place.
    static Index branch_place(Index place, Index term, int k) {
        return place * BRANCHES + branches_before(TERMS, term) + k;
    }

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

    Grip<S> grip(int substep) const {
        return {f_.grip_controller,        f_.grip_weight,
                f_.grip_rest_length,       f_.controllers + 6 * rollout_ * f_.controller_points,
                f_.controller_points,      f_.grip_stiffness[rollout_],
                f_.grip_damping[rollout_], f_.grip_softening,
                S(substep) * f_.timing[1], f_.timing[2]};
    }

    // The particle as the optional laws see it, see term.h; adjoints of the state stay here.
    struct At {
        const ParticleOfRollout& o;
        const Index place_;  // of its state
        const Vec3<S> x_, v_;
        const Mat3<S> rate_;
        Vec3<S> x_bar = {}, v_bar = {};
        Mat3<S> rate_bar = {};
        S mass_bar = 0;

        Vec3<S> x() const { return x_; }
        Vec3<S> v() const { return v_; }
        S mass() const { return o.constant(constant::mass); }
        Mat3<S> rate() const { return rate_; }
        Mat3<S> branch(Index term, int k) const { return get9(o.f_.branches, branch_place(place_, term, k)); }
        S value(int r) const { return o.constant(constant::COUNT + r); }
        Vec3<S> vector(int r) const { return {{value(r), value(r + 1), value(r + 2)}}; }
        S number(int n) const { return o.f_.numbers[o.rollout_ * number::COUNT + n]; }

        void add_x(const Vec3<S>& bar) { x_bar = x_bar + bar; }
        void add_v(const Vec3<S>& bar) { v_bar = v_bar + bar; }
        void add_mass(S bar) { mass_bar += bar; }
        void add_rate(const Mat3<S>& bar) { rate_bar += bar; }
        void add_branch(Index term, int k, const Mat3<S>& bar) {
            const Index at = branch_place(o.p_, term, k);
            put(o.f_.branches_bar, at, get9(o.f_.branches_bar, at) + bar);
        }
        void add(int r, S bar) { o.f_.bars[(bar::COUNT + input::COUNT + r) * o.f_.stride + o.p_] += bar; }
        void add(int r, const Vec3<S>& bar) {
            for (int d = 0; d < 3; ++d) add(r + d, bar[d]);
        }
        void add_number(int n, S bar) { o.f_.particle_sums[(particle_sum::numbers + n) * o.f_.stride + o.p_] += bar; }
    };

    // m v + dt f.
    Vec3<S> pushed_momentum(int substep, const At& at) const {
        Vec3<S> force = {{constant(constant::load), constant(constant::load + 1), constant(constant::load + 2)}};
        ForceTerms::each(TERMS, [&](auto law) { force = force + law.force(at); });
        if constexpr (GRIPPED) force = grip(substep).force(f_.bond_begin[p_], f_.bond_end[p_], at.x_, at.v_, force);
        return at.mass() * at.v_ + dt_ * force;
    }

    // APIC's m (v + C o) w, and - dt V tau grad w.
    Field<S> momentum_field(const Vec3<S>& momentum, const Mat3<S>& C, const Mat3<S>& tau, const Place<S>& at) const {
        const S mass = constant(constant::mass), volume = constant(constant::volume);
        return Field<S>(momentum, mass, (mass / (4 * per_metre_)) * C, (-dt_ * volume * per_metre_) * tau, at);
    }

    void scatter_momentum(int substep, int grid_slot, Index now, const Vec3<S>& x, const Vec3<S>& v, const Mat3<S>& F,
                          const Mat3<S>& C, const Mat3<S>& rate) {
        const At at = {*this, now, x, v, rate};
        Mat3<S> tau = material_.stress(p_, F).tau;
        StressTerms::each(TERMS, [&](auto law) { tau += law.stress(at, F); });
        const Vec3<S> momentum = pushed_momentum(substep, at);
        const Place<S> to = place(x);
        const S size = dot(momentum, momentum) + dot(C, C) + dot(tau, tau);
        if (!to.inside || !finite(size)) {
            fail(finite(dot(x, x) + size) ? OUTSIDE : NOT_FINITE, substep);
            return;
        }
        momentum_field(momentum, C, tau, to).scatter(grid(f_.momentum, f_.first[0] + grid_slot), to);
    }

    // --- the frame's end

    void fail(int kind, int substep) const {
        lower_to(f_.report + REPORT_COLUMNS * rollout_ + kind, Index(substep) * f_.particles + f_.caller[p_]);
    }

    void check(int substep, const Vec3<S>& x, const Vec3<S>& v, const Mat3<S>& F) const {
        Index* entries = f_.report + REPORT_COLUMNS * rollout_ + REPORT_FAILURES;
        for (int d = 0; d < 3; ++d) {
            const S ahead = x[d] + v[d] / f_.timing[2];
            raise_to(entries + d, rollout_, -double(min(x[d], ahead)));
            raise_to(entries + 3 + d, rollout_, double(max(x[d], ahead)));
        }
        raise_to(entries + 6, rollout_, double(sqrt(dot(v, v))));
        if (!finite(dot(x, x) + dot(v, v) + dot(F, F)))
            fail(NOT_FINITE, substep);
        else if (!place(x).inside)
            fail(OUTSIDE, substep);
    }

    // --- adjoints

    // Of particle to grid, grip and stress: v_bar and C_bar are set, the others grow.
    void momentum_adjoint(int slot, Index now, const Place<S>& place, Vec3<S>& x_bar, Vec3<S>& v_bar, Mat3<S>& F_bar,
                          Mat3<S>& C_bar, Mat3<S>& rate_bar) {
        const Mat3<S> F = get9(f_.F, now), C = get9(f_.C, now);
        At at = {*this, now, get3(f_.x, now), get3(f_.v, now), rate_at(now)};
        const auto stress = material_.stress(p_, F);
        Mat3<S> tau = stress.tau;
        StressTerms::each(TERMS, [&](auto law) { tau += law.stress(at, F); });
        const Field<S> given = momentum_field(pushed_momentum(slot, at), C, tau, place);
        const Derivatives<S> field(grid(f_.node_bar, slot % 2), place);
        const Vec3<S> q_bar = three(field.value), f_bar = dt_ * q_bar;
        const Mat3<S> apic_bar = field.offset_moments(place);
        const S mass = at.mass();
        x_bar = x_bar + per_metre_ * field.slope(given, place);
        v_bar = mass * q_bar;
        C_bar = (mass / (4 * per_metre_)) * apic_bar;
        const Mat3<S> tau_bar = (-dt_ * constant(constant::volume) * per_metre_) * field.gradient();
        if constexpr (GRIPPED) grip_adjoint(slot, at, f_bar, x_bar, v_bar);
        ForceTerms::each(TERMS, [&](auto law) { law.adjoint(at, f_bar); });
        if constexpr ((TERMS & StressTerms::TERMS) != 0) {
            const Mat3<S> T = symmetric(tau_bar);
            StressTerms::each(TERMS, [&](auto law) { law.adjoint(at, F, T, F_bar); });
        }
        x_bar = x_bar + at.x_bar;
        v_bar = v_bar + at.v_bar;
        rate_bar += at.rate_bar;
        if constexpr (INPUTS) {
            S* bars = f_.bars + bar::COUNT * f_.stride + p_;
            bars[input::mass * f_.stride] +=
                field.value[3] + dot(at.v_, q_bar) + dot(C, apic_bar) / (4 * per_metre_) + at.mass_bar;
            for (int d = 0; d < 3; ++d) bars[(input::load + d) * f_.stride] += f_bar[d];
        }
        material_.stress_adjoint(p_, stress, F, tau_bar, F_bar);
    }

    void grip_adjoint(int substep, const At& at, const Vec3<S>& f_bar, Vec3<S>& x_bar, Vec3<S>& v_bar) const {
        S* points = f_.controllers_bar + 6 * rollout_ * f_.controller_points;
        const auto add = [&](int end, int controller, int axis, S value) {
            if constexpr (LED) add_atomically(points + 3 * (end * f_.controller_points + controller) + axis, value);
        };
        const auto back = grip(substep).adjoint(f_.bond_begin[p_], f_.bond_end[p_], at.x_, at.v_, f_bar, add);
        x_bar = x_bar + back.x;
        v_bar = v_bar + back.v;
        f_.particle_sums[particle_sum::grip_stiffness * f_.stride + p_] += back.stiffness;
        f_.particle_sums[particle_sum::grip_damping * f_.stride + p_] += back.damping;
    }

    // Of plastic flow and grid to particle.
    void velocity_adjoint(int slot, Index before, const Place<S>& place, Vec3<S>& x_bar, const Vec3<S>& v_bar,
                          Mat3<S>& F_bar, const Mat3<S>& C_bar) {
        const Mat3<S> F = get9(f_.F, before);
        const Derivatives<S> moved(grid(f_.velocity, 0), place);
        const Mat3<S> step = (dt_ * per_metre_) * moved.gradient();
        if constexpr (FLOWS) F_bar = material_.flow_adjoint(p_, F + step * F, F_bar);
        Mat3<S> step_bar = F_bar * transpose(F);
        if constexpr (BRANCHES > 0) advance_branches_adjoint(before, step, step_bar);
        const Field<S> field(v_bar + dt_ * x_bar, S(0), per_metre_ * C_bar, (dt_ * per_metre_) * step_bar, place);
        field.scatter(grid(f_.node_bar, (slot + 1) % 2), place);
        x_bar = x_bar + per_metre_ * moved.slope(field, place);
        F_bar += transpose(step) * F_bar;
    }
};

}  // namespace physreal
