// Fixed corotated elasticity: tau = 2 mu (F - R) F^T + lambda J (J - 1) I.
//
// Source: Stomakhin, Howes, Schroeder, Teran, "Energetically consistent invertible elasticity", SCA 2012, with energy
// mu |F - R|^2 + lambda/2 (J - 1)^2 per undeformed volume and tau = P F^T. The rotation R comes from Newton's polar
// iteration, so that nothing is singular where singular values repeat.
#pragma once

#include "adjoint.h"
#include "lame.h"

namespace physreal {

template <class V>
class FixedCorotated {
    using S = Scalar<V>;
    Lame<V> lame_;
    Mat3<V> F_, C_;
    V J_;

public:
    Mat3<V> R;    // polar rotation of F
    Mat3<V> tau;  // Kirchhoff stress [Pa]; NaN where det F <= 0

    FixedCorotated(const Mat3<V>& F, V E, V nu)
        : lame_(E, nu), F_(F), C_(cofactor(F)), J_(determinant(F, C_)), R(polar_rotation(F)) {
        tau = symmetric_product(S(2) * lame_.mu * (F - R), transpose(F));
        const V volumetric = lame_.lambda * J_ * (J_ - S(1));
        for (int i = 0; i < 3; ++i) tau(i, i) += volumetric;
    }

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const Mat3<V> bar = symmetric(tau_bar);  // tau is symmetric, so the rest of its adjoint has no effect
        const Mat3<V> bar_F = bar * F_, D = F_ - R;
        const V two_mu = S(2) * lame_.mu, trace_bar = trace(bar), volumetric = J_ * (J_ - S(1));
        const LameAdjoint<V> material = lame_.adjoint(S(2) * dot(bar_F, D), trace_bar * volumetric);
        Mat3<V> F_bar = two_mu * (bar_F + bar * D - polar_rotation_adjoint(F_, R, bar_F));
        F_bar += (lame_.lambda * (S(2) * J_ - S(1)) * trace_bar) * C_;
        return {F_bar, material.E, material.nu};
    }
};

}  // namespace physreal
