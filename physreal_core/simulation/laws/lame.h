// Lame's parameters from Young's and Poisson's: mu = E / (2 (1 + nu)), lambda = E nu / ((1 + nu)(1 - 2 nu)).
#pragma once

#include "number.h"

namespace physreal {

template <class V>
struct LameAdjoint {
    V E, nu;
};

template <class V>
class Lame {
    using S = Scalar<V>;
    V nu_, of_shear_, of_bulk_;  // 1 / (1 + nu) and 1 / (1 - 2 nu)

public:
    V E, mu, lambda;

    Lame(V youngs_modulus, V poissons_ratio) : nu_(poissons_ratio), E(youngs_modulus) {
        const V plus = nu_ + S(1), minus = S(1) - S(2) * nu_;
        const V inverse = S(1) / (plus * minus);
        of_shear_ = inverse * minus;
        of_bulk_ = inverse * plus;
        mu = S(0.5) * E * of_shear_;
        lambda = E * nu_ * inverse;
    }

    V three_bulk() const { return E * of_bulk_; }  // 3 lambda + 2 mu

    LameAdjoint<V> adjoint(V mu_bar, V lambda_bar) const {
        const V both = of_shear_ * of_bulk_;
        // d lambda / d nu = E (1 + 2 nu^2) / ((1 + nu)(1 - 2 nu))^2
        return {S(0.5) * mu_bar * of_shear_ + lambda_bar * nu_ * both,
                lambda_bar * E * (S(1) + S(2) * nu_ * nu_) * (both * both) - mu_bar * mu * of_shear_};
    }
};

}  // namespace physreal
