// Neo-Hookean elasticity, see neo_hookean.h, of which only the value is written.
#pragma once
#include "derived_adjoint.h"
#include "lame.h"

namespace physreal {

struct NeoHookeanValue {
    template <class V>
    static Mat3<V> stress(const Mat3<V>& F, V E, V nu) {
        const Lame<V> lame(E, nu);
        return lame.mu * (F * transpose(F)) + identity_times(lame.lambda * log(determinant(F)) - lame.mu);
    }
};

template <class V>
using DerivedNeoHookean = DerivedAdjoint<V, NeoHookeanValue>;

}  // namespace physreal
