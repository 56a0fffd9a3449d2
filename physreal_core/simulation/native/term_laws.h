// The optional laws in use (Frame::terms) of a thread's particles: forces and stresses beside the others, and adjoints
// that add to the laws' rows and sums.
#pragma once
#include "rows.h"

namespace physreal {

template <class S>
class TermLaws : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Rows::first_, Rows::frame_, Rows::last_, Rows::matrix, Rows::put, Rows::row_of, Rows::vector;

public:
    // Rows of the state, of the particles' masses and of the laws' parameters (row::), and their adjoints; the numbers'
    // adjoints.
    struct Arrays {
        const S *x, *v, *rate, *branches, *mass, *values;
        S *x_bar, *v_bar, *rate_bar, *branches_bar, *mass_bar, *value_bars, *number_bars;
    };

    TermLaws(const Frame<S>& frame, Index thread) : Rows(frame, thread) {}

    bool has(Index terms) const { return (frame_.terms & terms) != 0; }

    // Writes load + the terms' forces into frame.force.
    void forces(const Arrays& arrays, const S* load) const {
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> force = vector(load, 0, p);
            const At at(*this, arrays, p);
            ForceTerms::each(frame_.terms, [&](auto law) { force = force + law.force(at); });
            put(frame_.force, 0, p, force);
        }
    }

    // The forces' adjoint stands in frame.force_bar.
    void forces_adjoint(const Arrays& arrays) const {
        for (Index p = first_; p < last_; p += LANES) {
            const Vec3<V> f_bar = vector(frame_.force_bar, 0, p);
            At at(*this, arrays, p);
            ForceTerms::each(frame_.terms, [&](auto law) { law.adjoint(at, f_bar); });
        }
    }

    // tau with the terms' stresses.
    Mat3<V> stress(const Arrays& arrays, Index p, const Mat3<V>& F, Mat3<V> tau) const {
        const At at(*this, arrays, p);
        StressTerms::each(frame_.terms, [&](auto law) { tau += law.stress(at, F); });
        return tau;
    }

    void stress_adjoint(const Arrays& arrays, Index p, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) const {
        const Mat3<V> T = symmetric(tau_bar);
        At at(*this, arrays, p);
        StressTerms::each(frame_.terms, [&](auto law) { law.adjoint(at, F, T, F_bar); });
    }

    // --- the mean rate of deformation, that of the last substeps with weights that fade
    // -------------------------------

    void average_rate(Index p, const S* rate, const Mat3<V>& L, S* next) const {
        if (!has(term::viscosity)) return;
        const S kept = frame_.remembered;
        put(next, 0, p, kept * matrix(rate, 0, p) + (1 - kept) * symmetric(L));
    }

    // The adjoint of L by the rate's, of which the rest stays.
    Mat3<V> average_rate_adjoint(Index p, S* rate_bar) const {
        if (!has(term::viscosity)) return {};
        const S kept = frame_.remembered;
        const Mat3<V> bar = matrix(rate_bar, 0, p);
        put(rate_bar, 0, p, kept * bar);
        return (1 - kept) * symmetric(bar);
    }

    // --- the strains of Maxwell branches, of which the state has rows from `branches` on
    // -------------------------------

    // step: dt grad v.
    void advance_branches(Index p, const S* branches, const Mat3<V>& step, S* next) const {
        if (!has(BranchTerms::TERMS)) return;
        const BranchStep<V> of_step(step);
        each_branch([&](int r, int time) {
            put(next, r, p, of_step.advance(matrix(branches, r, p), kept_half(frame_.dt, frame_.numbers[time])));
        });
    }

    // branches_bar goes from after the substep to before it; adds to that of the step and to the times'.
    void advance_branches_adjoint(Index p, const S* branches, const Mat3<V>& step, S* branches_bar, S* number_bars,
                                  Mat3<V>& step_bar) const {
        if (!has(BranchTerms::TERMS)) return;
        const BranchStep<V> of_step(step);
        each_branch([&](int r, int time) {
            const S kept = kept_half(frame_.dt, frame_.numbers[time]);
            V kept_bar = {};
            const Mat3<V> A = matrix(branches, r, p), next_bar = matrix(branches_bar, r, p);
            put(branches_bar, r, p, of_step.adjoint(A, kept, next_bar, step_bar, kept_bar));
            number_bars[time] += kept_half_slope(frame_.dt, frame_.numbers[time]) * sum(kept_bar);
        });
    }

private:
    // Calls use(first row of the branch, place of its time among the numbers) for the branches in use.
    template <class Use>
    void each_branch(Use use) const {
        int r = 0;
        BranchTerms::each(frame_.terms, [&](auto law) {
            for (int k = 0; k < law.COUNT; k++, r += 9) use(r, law.TIMES + k);
        });
    }

    // A block of particles as the laws see it, see term.h.
    class At {
        const TermLaws& laws_;
        const Arrays& a_;
        Index p_;

        void add_to(S* rows, int r, V value) const { laws_.put(rows, r, p_, laws_.row_of(rows, r, p_) + value); }
        void add_to(S* rows, int r, const Vec3<V>& value) const {
            for (int d = 0; d < 3; d++) add_to(rows, r + d, value[d]);
        }

        int branch_row(Index term, int k) const { return 9 * (branches_before(laws_.frame_.terms, term) + k); }

    public:
        At(const TermLaws& laws, const Arrays& arrays, Index p) : laws_(laws), a_(arrays), p_(p) {}

        Vec3<V> x() const { return laws_.vector(a_.x, 0, p_); }
        Vec3<V> v() const { return laws_.vector(a_.v, 0, p_); }
        V mass() const { return laws_.row_of(a_.mass, 0, p_); }
        Mat3<V> rate() const { return laws_.matrix(a_.rate, 0, p_); }
        Mat3<V> branch(Index term, int k) const { return laws_.matrix(a_.branches, branch_row(term, k), p_); }
        V value(int r) const { return laws_.row_of(a_.values, r, p_); }
        Vec3<V> vector(int r) const { return laws_.vector(a_.values, r, p_); }
        S number(int n) const { return laws_.frame_.numbers[n]; }
        DistanceField<S> solids() const { return distance_field(laws_.frame_); }

        void add_x(const Vec3<V>& bar) { add_to(a_.x_bar, 0, bar); }
        void add_v(const Vec3<V>& bar) { add_to(a_.v_bar, 0, bar); }
        void add_mass(V bar) { add_to(a_.mass_bar, 0, bar); }
        void add_rate(const Mat3<V>& bar) {
            for (int i = 0; i < 9; i++) add_to(a_.rate_bar, i, bar.m[i]);
        }
        void add_branch(Index term, int k, const Mat3<V>& bar) {
            for (int i = 0; i < 9; i++) add_to(a_.branches_bar, branch_row(term, k) + i, bar.m[i]);
        }
        template <class T>
        void add(int r, const T& bar) {
            add_to(a_.value_bars, r, bar);
        }
        void add_number(int n, V bar) { a_.number_bars[n] += sum(bar); }
    };
};

}  // namespace physreal
