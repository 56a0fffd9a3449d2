// Viscosity: tau = J (2 mu_v D + lambda_v tr(D) 1), D the mean rate of deformation.
#pragma once
#include "term.h"

namespace physreal {

struct Viscosity {
    static constexpr Index TERM = term::viscosity;

    template <class At, class V>
    static Mat3<V> stress(const At& at, const Mat3<V>& F) {
        const Mat3<V> D = at.rate();
        const V J = determinant(F), shear = at.value(row::viscosity), bulk = at.value(row::viscosity + 1);
        return (Scalar<V>(2) * J * shear) * D + identity_times(J * bulk * trace(D));
    }

    template <class At, class V>
    static void adjoint(At& at, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        using S = Scalar<V>;
        const Mat3<V> D = at.rate(), C = cofactor(F);
        const V J = determinant(F, C), shear = at.value(row::viscosity), bulk = at.value(row::viscosity + 1);
        const V sheared = S(2) * dot(tau_bar, D), squeezed = trace(tau_bar) * trace(D);
        F_bar += (shear * sheared + bulk * squeezed) * C;
        at.add_rate((S(2) * J * shear) * tau_bar + identity_times(J * bulk * trace(tau_bar)));
        at.add(row::viscosity, J * sheared);
        at.add(row::viscosity + 1, J * squeezed);
    }
};

}  // namespace physreal
