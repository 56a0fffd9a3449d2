// The optional laws in use (Frame::terms) of a thread's particles: forces and stresses beside the others, and adjoints
// that add to the laws' rows and sums. The twin of plain/laws.py.
#pragma once
#include "../rows.h"
#include "particle_forces.h"
#include "stress_terms.h"

namespace physreal {

template <class S>
class TermLaws : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;

public:
    // values: rows of the laws' parameters (TermRow); bars: those of their adjoints; sums: adjoints of the numbers that
    // all particles share (TermNumber).
    TermLaws(const Frame<S>& frame, Index thread, const S* values, S* bars, S* sums)
        : Rows(frame, thread), values_(values), bars_(bars), sums_(sums) {}

    bool has(Term term) const { return (frame_.terms & term) != 0; }
    bool has_forces() const { return has(DRAG) || has(ADHESION) || has(OBSTACLE); }

    // --- forces
    // -------------------------------------------------------------------------------------------------------

    // Writes load + the terms' forces into frame.force; x and v: rows of the state, mass: a row.
    void forces(const S* x, const S* v, const S* mass, const S* load) {
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> force = vector(load, 0, p);
            if (has(DRAG)) force = force + drag(vector(v, 0, p), value(LINEAR_DRAG, p), value(QUADRATIC_DRAG, p));
            if (has(ADHESION)) force[2] += adhesion(height(x, p), value(PEAK_ADHESION, p), reach());
            if (has(OBSTACLE)) force = force + Obstacle<V>(vector(x, 0, p), row(mass, 0, p), capsule()).force;
            put(frame_.force, 0, p, force);
        }
    }

    // Adds to the rows of the adjoints of x, v and mass; the forces' adjoint stands in frame.force_bar.
    void forces_adjoint(const S* x, const S* v, const S* mass, S* x_bar, S* v_bar, S* mass_bar) {
        for (Index p = first_; p < last_; p += LANES) {
            const Vec3<V> f_bar = vector(frame_.force_bar, 0, p);
            if (has(DRAG)) {
                const auto bar = drag_adjoint(vector(v, 0, p), value(LINEAR_DRAG, p), value(QUADRATIC_DRAG, p), f_bar);
                add(v_bar, 0, p, bar.v);
                add(bars_, LINEAR_DRAG, p, bar.linear);
                add(bars_, QUADRATIC_DRAG, p, bar.quadratic);
            }
            if (has(ADHESION)) {
                const auto bar = adhesion_adjoint(height(x, p), value(PEAK_ADHESION, p), reach(), f_bar[2]);
                add(x_bar, 2, p, bar.height);
                add(bars_, START_HEIGHT, p, -bar.height);
                add(bars_, PEAK_ADHESION, p, bar.peak);
                sums_[ADHESION_RANGE] += sum(bar.reach);
            }
            if (has(OBSTACLE)) {
                const auto bar = Obstacle<V>(vector(x, 0, p), row(mass, 0, p), capsule()).adjoint(f_bar);
                add(x_bar, 0, p, bar.x);
                add(mass_bar, 0, p, bar.mass);
                for (int d = 0; d < 3; d++) {
                    sums_[OBSTACLE_SHAPE + d] += sum(bar.centre[d]);
                    sums_[OBSTACLE_SHAPE + 3 + d] += sum(bar.axis[d]);
                }
                sums_[OBSTACLE_SHAPE + 6] += sum(bar.radius);
                sums_[OBSTACLE_SHAPE + 7] += sum(bar.stiffness);
            }
        }
    }

    // --- stresses
    // -----------------------------------------------------------------------------------------------------

    // tau with the terms' stresses; rate: rows of the mean rate of deformation.
    Mat3<V> stress(Index p, const Mat3<V>& F, const S* rate, Mat3<V> tau) const {
        if (has(VISCOSITY))
            tau += viscous_stress(F, matrix(rate, 0, p), value(SHEAR_VISCOSITY, p), value(VOLUME_VISCOSITY, p));
        if (has(STIFFENING)) tau += Stiffening<V>(F, value(STIFFENING_MODULUS, p)).tau;
        if (has(FIBRES)) tau += fibre_stress(F, value(FIBRE_MODULUS, p), vector(values_, FIBRE_DIRECTION, p));
        return tau;
    }

    // Adds to F_bar and to the rows of the rate's adjoint.
    void stress_adjoint(Index p, const Mat3<V>& F, const S* rate, const Mat3<V>& tau_bar, Mat3<V>& F_bar, S* rate_bar) {
        const Mat3<V> T = symmetric(tau_bar);
        if (has(VISCOSITY)) {
            const auto bar =
                viscous_stress_adjoint(F, matrix(rate, 0, p), value(SHEAR_VISCOSITY, p), value(VOLUME_VISCOSITY, p), T);
            F_bar += bar.F;
            for (int i = 0; i < 9; i++) add(rate_bar, i, p, bar.D.m[i]);
            add(bars_, SHEAR_VISCOSITY, p, bar.shear);
            add(bars_, VOLUME_VISCOSITY, p, bar.bulk);
        }
        if (has(STIFFENING)) {
            const auto bar = Stiffening<V>(F, value(STIFFENING_MODULUS, p)).adjoint(T);
            F_bar += bar.F;
            add(bars_, STIFFENING_MODULUS, p, bar.modulus);
        }
        if (has(FIBRES)) {
            const auto bar = fibre_stress_adjoint(F, value(FIBRE_MODULUS, p), vector(values_, FIBRE_DIRECTION, p), T);
            F_bar += bar.F;
            add(bars_, FIBRE_MODULUS, p, bar.modulus);
            add(bars_, FIBRE_DIRECTION, p, bar.direction);
        }
    }

    // --- the mean rate of deformation, that of the last substeps with weights that fade
    // -----------------------------------------------

    void average_rate(Index p, const S* rate, const Mat3<V>& C, S* next) const {
        if (!has(VISCOSITY)) return;
        const S kept = frame_.remembered;
        put(next, 0, p, kept * matrix(rate, 0, p) + (1 - kept) * symmetric(C));
    }

    // C_bar with what goes to it of the rate's adjoint, of which the rest stays.
    Mat3<V> average_rate_adjoint(Index p, const Mat3<V>& C_bar, S* rate_bar) const {
        if (!has(VISCOSITY)) return C_bar;
        const S kept = frame_.remembered;
        const Mat3<V> bar = matrix(rate_bar, 0, p);
        put(rate_bar, 0, p, kept * bar);
        return C_bar + (1 - kept) * symmetric(bar);
    }

private:
    using Rows::first_, Rows::frame_, Rows::last_, Rows::matrix, Rows::put, Rows::row, Rows::vector;

    const S* values_;
    S *bars_, *sums_;

    V value(int r, Index p) const { return row(values_, r, p); }
    V height(const S* x, Index p) const { return row(x, 2, p) - value(START_HEIGHT, p); }
    V reach() const { return splat<V>(frame_.term_numbers[ADHESION_RANGE]); }
    const S* capsule() const { return frame_.term_numbers + OBSTACLE_SHAPE; }

    void add(S* rows, int r, Index p, V amount) const { put(rows, r, p, row(rows, r, p) + amount); }
    void add(S* rows, int r, Index p, const Vec3<V>& amount) const {
        for (int d = 0; d < 3; d++) add(rows, r + d, p, amount[d]);
    }
};

}  // namespace physreal
