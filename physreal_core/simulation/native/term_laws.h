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
        const S *x, *v, *rate, *mass, *values;
        S *x_bar, *v_bar, *rate_bar, *mass_bar, *value_bars, *number_bars;
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

    void average_rate(Index p, const S* rate, const Mat3<V>& C, S* next) const {
        if (!has(term::viscosity)) return;
        const S kept = frame_.remembered;
        put(next, 0, p, kept * matrix(rate, 0, p) + (1 - kept) * symmetric(C));
    }

    // C_bar with what goes to it of the rate's adjoint, of which the rest stays.
    Mat3<V> average_rate_adjoint(Index p, const Mat3<V>& C_bar, S* rate_bar) const {
        if (!has(term::viscosity)) return C_bar;
        const S kept = frame_.remembered;
        const Mat3<V> bar = matrix(rate_bar, 0, p);
        put(rate_bar, 0, p, kept * bar);
        return C_bar + (1 - kept) * symmetric(bar);
    }

private:
    // A block of particles as the laws see it, see term.h.
    class At {
        const TermLaws& laws_;
        const Arrays& a_;
        Index p_;

        void add_to(S* rows, int r, V value) const { laws_.put(rows, r, p_, laws_.row_of(rows, r, p_) + value); }
        void add_to(S* rows, int r, const Vec3<V>& value) const {
            for (int d = 0; d < 3; d++) add_to(rows, r + d, value[d]);
        }

    public:
        At(const TermLaws& laws, const Arrays& arrays, Index p) : laws_(laws), a_(arrays), p_(p) {}

        Vec3<V> x() const { return laws_.vector(a_.x, 0, p_); }
        Vec3<V> v() const { return laws_.vector(a_.v, 0, p_); }
        V mass() const { return laws_.row_of(a_.mass, 0, p_); }
        Mat3<V> rate() const { return laws_.matrix(a_.rate, 0, p_); }
        V value(int r) const { return laws_.row_of(a_.values, r, p_); }
        Vec3<V> vector(int r) const { return laws_.vector(a_.values, r, p_); }
        S number(int n) const { return laws_.frame_.numbers[n]; }

        void add_x(const Vec3<V>& bar) { add_to(a_.x_bar, 0, bar); }
        void add_v(const Vec3<V>& bar) { add_to(a_.v_bar, 0, bar); }
        void add_mass(V bar) { add_to(a_.mass_bar, 0, bar); }
        void add_rate(const Mat3<V>& bar) {
            for (int i = 0; i < 9; i++) add_to(a_.rate_bar, i, bar.m[i]);
        }
        template <class T>
        void add(int r, const T& bar) {
            add_to(a_.value_bars, r, bar);
        }
        void add_number(int n, V bar) { a_.number_bars[n] += sum(bar); }
    };
};

}  // namespace physreal
