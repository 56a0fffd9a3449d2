// The adjoint of an elastic law from its value alone, by forward differentiation: a dual number, which carries its
// derivative along one direction, goes through the law in place of V, once for each entry of F and for E and nu.
//
// For laws that only call what stands below, and whose value is differentiable as it is computed: polar_rotation() is,
// the directions of principal() are not where singular values repeat.
#pragma once

#include "adjoint.h"
#include "dual.h"

namespace physreal {

// An elastic law from a class with `template <class V> static Mat3<V> stress(const Mat3<V>& F, V E, V nu)`.
template <class V, class Value>
class DerivedAdjoint {
    Mat3<V> F_;
    V E_, nu_;

    // tau_bar : d tau along the direction in which one number's slope is set.
    static V along(const Mat3<V>& tau_bar, const Mat3<Dual<V>>& F, Dual<V> E, Dual<V> nu) {
        const Mat3<Dual<V>> tau = Value::template stress<Dual<V>>(F, E, nu);
        V work = {};
        for (int i = 0; i < 9; ++i) work += tau_bar.m[i] * tau.m[i].slope;
        return work;
    }

public:
    Mat3<V> tau;  // Kirchhoff stress [Pa]

    DerivedAdjoint(const Mat3<V>& F, V E, V nu) : F_(F), E_(E), nu_(nu), tau(Value::template stress<V>(F, E, nu)) {}

    StressAdjoint<V> adjoint(const Mat3<V>& tau_bar) const {
        const V one = splat<V>(1);
        Dual<V> E(E_, V{}), nu(nu_, V{});
        Mat3<Dual<V>> F;
        for (int i = 0; i < 9; ++i) F.m[i].x = F_.m[i];
        StressAdjoint<V> bar;
        ONE_AT_A_TIME for (int i = 0; i < 9; ++i) {
            F.m[i].slope = one;
            bar.F.m[i] = along(tau_bar, F, E, nu);
            F.m[i].slope = V{};
        }
        bar.E = along(tau_bar, F, Dual<V>(E_, one), nu);
        bar.nu = along(tau_bar, F, E, Dual<V>(nu_, one));
        return bar;
    }
};

}  // namespace physreal
