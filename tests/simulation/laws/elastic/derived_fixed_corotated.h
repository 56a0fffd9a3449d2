// Fixed corotated elasticity, see fixed_corotated.h, of which only the value is written.
#pragma once
#include "derived_adjoint.h"
#include "lame.h"

namespace physreal {

struct FixedCorotatedValue {
    template <class V>
    static Mat3<V> stress(const Mat3<V>& F, V E, V nu) {
        using S = Scalar<V>;
        const Lame<V> lame(E, nu);
        const V J = determinant(F);
        const Mat3<V> sheared = S(2) * lame.mu * (F - polar_rotation(F)) * transpose(F);
        return sheared + identity_times(lame.lambda * J * (J - S(1)));
    }
};

template <class V>
using DerivedFixedCorotated = DerivedAdjoint<V, FixedCorotatedValue>;

}  // namespace physreal
