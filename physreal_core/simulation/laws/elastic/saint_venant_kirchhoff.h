// St. Venant-Kirchhoff elasticity: tau = F (2 mu G + lambda tr G I) F^T with the Green strain G = (F^T F - I) / 2.
#pragma once

#include "adjoint.h"
#include "lame.h"

namespace physreal {

template <class V>
class SaintVenantKirchhoff {
    using S = Scalar<V>;
    Lame<V> lame_;
    Mat3<V> F_, G_, second_;  // second_: second Piola-Kirchhoff stress [Pa]

    Mat3<V> stress_of(const Mat3<V>& strain) const {
        Mat3<V> result = S(2) * lame_.mu * strain;
        const V pressure = lame_.lambda * trace(strain);
        for (int i = 0; i < 3; ++i) result(i, i) += pressure;
        return result;
    }

public:
    Mat3<V> tau;  // Kirchhoff stress [Pa]; NaN where det F <= 0

    SaintVenantKirchhoff(const Mat3<V>& F, V E, V nu) : lame_(E, nu), F_(F), G_(S(0.5) * (transpose(F) * F)) {
        for (int i = 0; i < 3; ++i) G_(i, i) -= S(0.5);
        second_ = stress_of(G_);
        tau = one_where_positive(determinant(F)) * (F * second_ * transpose(F));
    }

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const Mat3<V> bar = symmetric(tau_bar), second_bar = transpose(F_) * bar * F_;
        const LameAdjoint<V> material = lame_.adjoint(S(2) * dot(second_bar, G_), trace(second_bar) * trace(G_));
        return {S(2) * bar * F_ * second_ + F_ * stress_of(second_bar), material.E, material.nu};
    }
};

}  // namespace physreal
