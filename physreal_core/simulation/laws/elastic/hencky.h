// Hencky elasticity (St. Venant-Kirchhoff in the logarithmic strain): tau = 2 mu eps + lambda tr(eps) I, eps = log V.
//
// Source: Simo, "Algorithms for static and dynamic multiplicative plasticity", CMAME 99 (1992), with energy
// mu eps:eps + lambda/2 (tr eps)^2 per undeformed volume; in MPM: Klar et al., "Drucker-Prager elastoplasticity for
// sand animation", SIGGRAPH 2016.
#pragma once

#include "adjoint.h"
#include "lame.h"
#include "log_strain.h"

namespace physreal {

template <class V>
class Hencky {
    using S = Scalar<V>;
    Lame<V> lame_;
    Principal<V> p_;

    V volume_strain() const { return p_.eps[0] + p_.eps[1] + p_.eps[2]; }

public:
    Mat3<V> tau;  // Kirchhoff stress [Pa]; NaN where det F <= 0

    Hencky(const Mat3<V>& F, V E, V nu) : lame_(E, nu), p_(principal(F)) {
        const V volumetric = lame_.lambda * volume_strain();
        Vec3<V> stress;
        for (int i = 0; i < 3; ++i) stress[i] = S(2) * lame_.mu * p_.eps[i] + volumetric;
        tau = from_principal(p_.Q, stress);
    }

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const Mat3<V> bar = to_principal(p_.Q, symmetric(tau_bar));
        const V trace_bar = trace(bar);
        const V along = bar(0, 0) * p_.eps[0] + bar(1, 1) * p_.eps[1] + bar(2, 2) * p_.eps[2];
        const LameAdjoint<V> material = lame_.adjoint(S(2) * along, trace_bar * volume_strain());
        Mat3<V> eps_bar = S(2) * lame_.mu * bar;
        for (int i = 0; i < 3; ++i) eps_bar(i, i) += lame_.lambda * trace_bar;
        return {log_strain_adjoint(p_, eps_bar), material.E, material.nu};
    }
};

}  // namespace physreal
