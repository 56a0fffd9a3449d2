// What the adjoints of the laws return: of the deformation gradient F and of the material's parameters.
#pragma once

#include "matrix.h"

namespace physreal {

template <class V>
struct StressAdjoint {
    Mat3<V> F;
    V E, nu;
};

// y0, y1: the two parameters of the law of plastic flow.
template <class V>
struct FlowAdjoint {
    Mat3<V> F;
    V E, nu, y0, y1;
};

}  // namespace physreal
