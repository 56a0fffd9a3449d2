// Inner pressure: tau = -p J 1, the Cauchy stress -p of a gas in the body's pores.
#pragma once
#include "term.h"

namespace physreal {

struct Pressure {
    static constexpr Index TERM = term::pressure;

    template <class At, class V>
    static Mat3<V> stress(const At& at, const Mat3<V>& F) {
        return identity_times(-at.value(row::pressure) * determinant(F));
    }

    template <class At, class V>
    static void adjoint(At& at, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        const Mat3<V> C = cofactor(F);
        const V opened = -trace(tau_bar);
        F_bar += (at.value(row::pressure) * opened) * C;
        at.add(row::pressure, determinant(F, C) * opened);
    }
};

}  // namespace physreal
