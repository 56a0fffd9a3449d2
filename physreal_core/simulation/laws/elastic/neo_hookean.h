// Compressible neo-Hookean elasticity: tau = mu (b - I) + lambda log J I, with b = F F^T.
//
// Source: Bonet and Wood, "Nonlinear Continuum Mechanics for Finite Element Analysis", 2nd ed. 2008, ch. 6, with energy
// mu/2 (tr b - 3) - mu log J + lambda/2 (log J)^2 per undeformed volume.
#pragma once

#include "adjoint.h"
#include "lame.h"

namespace physreal {

template <class V>
class NeoHookean {
    using S = Scalar<V>;
    Lame<V> lame_;
    Mat3<V> F_, C_;
    V J_, log_J_;

public:
    Mat3<V> tau;  // Kirchhoff stress [Pa]; NaN on the diagonal where det F <= 0

    NeoHookean(const Mat3<V>& F, V E, V nu) : lame_(E, nu), F_(F), C_(cofactor(F)), J_(determinant(F, C_)) {
        log_J_ = log(J_ * one_where_positive(J_));
        tau = symmetric_product(lame_.mu * F, transpose(F));
        for (int i = 0; i < 3; ++i) tau(i, i) += lame_.lambda * log_J_ - lame_.mu;
    }

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const Mat3<V> bar = symmetric(tau_bar);  // tau is symmetric, so the rest of its adjoint has no effect
        const Mat3<V> bar_F = bar * F_;
        const V trace_bar = trace(bar);
        const LameAdjoint<V> material = lame_.adjoint(dot(bar_F, F_) - trace_bar, trace_bar * log_J_);
        const Mat3<V> F_bar = S(2) * lame_.mu * bar_F + (lame_.lambda * trace_bar / J_) * C_;
        return {F_bar, material.E, material.nu};
    }
};

}  // namespace physreal
