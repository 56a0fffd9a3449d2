// The neural residual of a thin body: a correction of an element's expert stress, which it keeps the direction of.
//
// What the element resists stretching with is multiplied by 1 + beta o / sqrt(1 + o^2), and so is what it resists bending with. Each o is
// linear in the element's invariants (1, tr E, |E|^2, |K|^2), E the strain along the body and K the curvature, with coefficients that a
// network makes of its latent code (residual.py). So the correction is objective, bounded by beta times the expert's stress, and exactly zero
// with zero coefficients. It has no energy in general.
#pragma once
#include "elements.h"

namespace physreal {

// At places of an element. Of its STIFFNESS numbers the first STRETCHING are those of stretching, the rest of bending.
template <template <class, class> class Element, class V>
class ThinResidual {
    using S = Scalar<V>;
    using Plain = Element<V, V>;
    static constexpr int STIFFNESS = Plain::STIFFNESS, CORNERS = Plain::CORNERS, GROUPS = 2;
    const Plain element_;
    V features_[1 + INVARIANTS], factor_[GROUPS], slope_[GROUPS];

    static constexpr int group_of(int row) { return row < Plain::STRETCHING ? 0 : 1; }

public:
    static constexpr int ROWS = GROUPS * (1 + INVARIANTS);

    ThinResidual(const Vec3<V> (&x)[CORNERS], const V (&constants)[Plain::CONSTANTS], const V (&coefficients)[ROWS], S beta)
        : element_(x, constants) {
        V invariants[INVARIANTS];
        element_.invariants(invariants);
        features_[0] = splat<V>(S(1));
        for (int j = 0; j < INVARIANTS; ++j) features_[1 + j] = invariants[j];
        for (int g = 0; g < GROUPS; ++g) {
            V o = coefficients[g * (1 + INVARIANTS)];
            for (int j = 1; j <= INVARIANTS; ++j) o = o + coefficients[g * (1 + INVARIANTS) + j] * features_[j];
            const V shrink = S(1) / sqrt(S(1) + o * o);
            factor_[g] = S(1) + beta * o * shrink;
            slope_[g] = beta * shrink * shrink * shrink;
        }
    }

    void scale(const V (&stiffness)[STIFFNESS], V (&scaled)[STIFFNESS]) const {
        for (int r = 0; r < STIFFNESS; ++r) scaled[r] = factor_[group_of(r)] * stiffness[r];
    }

    // In: in `bar` the adjoint of the scaled stiffness; out: that of the stiffness. Adds to those of x and of the coefficients.
    void adjoint(const V (&stiffness)[STIFFNESS], const V (&coefficients)[ROWS], V (&bar)[STIFFNESS], Vec3<V> (&x_bar)[CORNERS],
                 V (&coefficients_bar)[ROWS]) const {
        V o_bar[GROUPS] = {}, invariants_bar[INVARIANTS] = {};
        for (int r = 0; r < STIFFNESS; ++r) {
            o_bar[group_of(r)] += stiffness[r] * bar[r];
            bar[r] = factor_[group_of(r)] * bar[r];
        }
        for (int g = 0; g < GROUPS; ++g) {
            const V own = slope_[g] * o_bar[g];
            for (int j = 0; j <= INVARIANTS; ++j) {
                const int row = g * (1 + INVARIANTS) + j;
                coefficients_bar[row] += own * features_[j];
                if (j > 0) invariants_bar[j - 1] += own * coefficients[row];
            }
        }
        element_.invariants_adjoint(invariants_bar, x_bar);
    }
};

}  // namespace physreal
