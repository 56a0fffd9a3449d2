// No plastic flow: the trial deformation gradient stays as it is.
#pragma once

#include "adjoint.h"

namespace physreal {

struct Identity {
    static constexpr bool flows = false;

    template <class V>
    static Mat3<V> flow(const Mat3<V>& trial, V, V, V, V, Scalar<V>) {
        return trial;
    }

    template <class V>
    static FlowAdjoint<V> adjoint(const Mat3<V>&, V, V, V, V, Scalar<V>, const Mat3<V>& F_bar) {
        return {F_bar, V{}, V{}, V{}, V{}};
    }
};

}  // namespace physreal
