// A particle of a rollout: its rows, and the forces on it (loads, optional laws, grip) with their adjoint.
//
// Slots count from the frame's first one, `first[0]`, so that one CUDA graph serves every frame.
#pragma once
#include "grip.h"
#include "tool.h"
#include "report.h"
#include "vec4.h"

namespace physreal {

// to += value, from many threads.
template <class S>
inline void add_atomically(S* to, S value) {
#if defined(__CUDA_ARCH__)
    atomicAdd(to, value);
#else
    *to += value;
#endif
}

// Bits of what the hand does.
namespace hand {
enum : int { grips = 1, pushes = 2 };
}

// INPUTS: whether masses and forces have adjoints; TERMS: bits of the optional laws in use; HAND: bits of what the hand does; LED: whether the controller
// points have adjoints.
template <class S, bool INPUTS, Index TERMS, int HAND, bool LED>
class ParticleForces {
protected:
    const Frame<S>& f_;
    const int own_, p_, rollout_;  // number in its rollout, number among all, and the rollout
    const S dt_;
    static constexpr int BRANCHES = branches_of(TERMS);

    ParticleForces(const Frame<S>& f, int rollout, int own)
        : f_(f), own_(own), p_(rollout * int(f.particles) + own), rollout_(rollout), dt_(f.timing[0]) {}

    Index place_in(int slot) const { return Index(f_.first[0] + slot) * f_.stride + p_; }
    S constant(int row) const { return f_.constants[row * f_.stride + p_]; }

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

    void fail(int substep) const { lower_to(f_.report + rollout_, Index(substep) * f_.particles + f_.caller[p_]); }

    // How fully the particle touches the ground, from 0 to 1; z: its height.
    S touching(S z) const { return max(min((constant(constant::touch_height) - z) * f_.touch_slope, S(1)), S(0)); }
    // Of x_bar's z, with touch_bar the adjoint of the touching volume.
    S touching_adjoint(S z, S touch_bar) const {
        const S touch = touching(z);
        return touch > 0 && touch < 1 ? -f_.touch_slope * constant(constant::volume) * touch_bar : S(0);
    }

    // Among the Maxwell branches of all, of the k-th of a term's of the particle whose state is at a place.
    static Index branch_place(Index place, Index term, int k) {
        return place * BRANCHES + branches_before(TERMS, term) + k;
    }

    // The particle as the optional laws see it, see term.h; adjoints of the state stay here.
    struct At {
        const ParticleForces& o;
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
        DistanceField<S> solids() const { return distance_field(o.f_); }

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

    Vec3<S> force(int substep, const At& at) const {
        Vec3<S> force = {{constant(constant::load), constant(constant::load + 1), constant(constant::load + 2)}};
        ForceTerms::each(TERMS, [&](auto law) { force = force + law.force(at); });
        if constexpr (HAND & hand::grips)
            force = grip(substep).force(f_.bond_begin[p_], f_.bond_end[p_], at.x_, at.v_, force);
        if constexpr (HAND & hand::pushes) force = tool(substep).force(at.x_, at.v_, at.mass(), reach(), force);
        return force;
    }

    // Adjoints of the state grow in `at`.
    void force_adjoint(int substep, At& at, const Vec3<S>& f_bar) const {
        if constexpr (HAND & hand::grips) grip_adjoint(substep, at, f_bar);
        if constexpr (HAND & hand::pushes) tool_adjoint(substep, at, f_bar);
        ForceTerms::each(TERMS, [&](auto law) { law.adjoint(at, f_bar); });
    }

    // Of masses and constant forces.
    void add_inputs(S mass_bar, const Vec3<S>& f_bar) const {
        if constexpr (INPUTS) {
            S* bars = f_.bars + bar::COUNT * f_.stride + p_;
            bars[input::mass * f_.stride] += mass_bar;
            for (int d = 0; d < 3; ++d) bars[(input::load + d) * f_.stride] += f_bar[d];
        }
    }

private:
    S reach() const { return constant(constant::reach); }
    const S* points() const { return f_.controllers + 12 * rollout_ * f_.controller_points; }
    // In no fixed order: only the adjoint of the controller points takes part.
    auto point_adder() const {
        S* bars = f_.controllers_bar + 12 * rollout_ * f_.controller_points;
        return [this, bars](int place, int controller, int axis, S value) {
            if constexpr (LED) add_atomically(bars + 3 * (place * f_.controller_points + controller) + axis, value);
        };
    }

    Grip<S> grip(int substep) const {
        return {f_.grip_controller,
                f_.grip_weight,
                f_.grip_rest_length + rollout_ * f_.bonds,
                points(),
                f_.controller_points,
                f_.grip_stiffness[rollout_],
                f_.grip_damping[rollout_],
                f_.grip_softening,
                S(substep) * f_.timing[1],
                f_.timing[2]};
    }
    Tool<S> tool(int substep) const {
        return {f_.capsule_ends,
                f_.capsule_radius,
                f_.capsules,
                points(),
                f_.controller_points,
                f_.tool_stiffness[rollout_],
                f_.tool_friction[rollout_],
                S(substep) * f_.timing[1],
                f_.timing[2]};
    }

    void grip_adjoint(int substep, At& at, const Vec3<S>& f_bar) const {
        const auto add_length = [&](Index bond, S value) { f_.rest_length_bar[rollout_ * f_.bonds + bond] += value; };
        const auto back = grip(substep).adjoint(f_.bond_begin[p_], f_.bond_end[p_], at.x_, at.v_, f_bar, point_adder(),
                                                add_length);
        at.add_x(back.x);
        at.add_v(back.v);
        f_.particle_sums[particle_sum::grip_stiffness * f_.stride + p_] += back.stiffness;
        f_.particle_sums[particle_sum::grip_damping * f_.stride + p_] += back.damping;
    }

    void tool_adjoint(int substep, At& at, const Vec3<S>& f_bar) const {
        const auto back = tool(substep).adjoint(at.x_, at.v_, at.mass(), reach(), f_bar, point_adder());
        at.add_x(back.x);
        at.add_v(back.v);
        at.add_mass(back.mass);
        f_.particle_sums[particle_sum::tool_stiffness * f_.stride + p_] += back.stiffness;
        f_.particle_sums[particle_sum::tool_friction * f_.stride + p_] += back.friction;
    }
};

}  // namespace physreal
