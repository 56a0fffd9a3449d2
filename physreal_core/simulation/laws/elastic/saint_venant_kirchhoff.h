// St. Venant-Kirchhoff elasticity: tau = mu (b^2 - b) + lambda/2 (tr b - 3) b, with b = F F^T.
//
// Source: Bonet and Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis", 2nd ed. 2008, ch. 6: S = 2 mu E +
// lambda tr(E) I in Green's strain E = (F^T F - I) / 2, energy mu E:E + lambda/2 (tr E)^2 per undeformed volume, and
// tau = F S F^T. Pressed below a stretch of 1/sqrt(3) a bar gives way, so this law is for moderate strain.
#pragma once

#include "adjoint.h"
#include "lame.h"

namespace physreal {

template <class V>
class SaintVenantKirchhoff {
    using S = Scalar<V>;
    Lame<V> lame_;
    Mat3<V> F_, b_;
    V tr_E_;

public:
    Mat3<V> tau;  // Kirchhoff stress [Pa]; NaN where det F <= 0

    SaintVenantKirchhoff(const Mat3<V>& F, V E, V nu)
        : lame_(E, nu), F_(F), b_(symmetric_product(one_where_positive(determinant(F)) * F, transpose(F))) {
        tr_E_ = S(0.5) * (trace(b_) - S(3));
        tau = symmetric_product(lame_.mu * b_, b_) + (lame_.lambda * tr_E_ - lame_.mu) * b_;
    }

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const Mat3<V> bar = symmetric(tau_bar);  // tau is symmetric, so the rest of its adjoint has no effect
        const Mat3<V> bar_b = bar * b_;
        const V along = trace(bar_b);
        const LameAdjoint<V> material = lame_.adjoint(dot(bar_b, b_) - along, along * tr_E_);
        Mat3<V> b_bar = lame_.mu * (bar_b + transpose(bar_b)) + (lame_.lambda * tr_E_ - lame_.mu) * bar;
        for (int i = 0; i < 3; ++i) b_bar(i, i) += S(0.5) * lame_.lambda * along;
        return {S(2) * (b_bar * F_), material.E, material.nu};
    }
};

}  // namespace physreal
