// Kirchhoff stresses beside the expert law's: viscosity, stiffening, fibres; with their adjoints. All are symmetric,
// and the adjoints take the symmetric part of tau_bar. The twin of term_laws.py, where the sources stand.
#pragma once

#include "../matrix.h"

namespace physreal {

// --- viscosity: tau = J (2 mu_v D + lambda_v tr(D) 1)

template <class V>
inline Mat3<V> viscous_stress(const Mat3<V>& F, const Mat3<V>& D, V shear, V bulk) {
    const V J = determinant(F);
    return (Scalar<V>(2) * J * shear) * D + identity_times(J * bulk * trace(D));
}

template <class V>
struct ViscosityAdjoint {
    Mat3<V> F, D;
    V shear, bulk;
};

template <class V>
inline ViscosityAdjoint<V> viscous_stress_adjoint(const Mat3<V>& F, const Mat3<V>& D, V shear, V bulk,
                                                  const Mat3<V>& tau_bar) {
    using S = Scalar<V>;
    const Mat3<V> C = cofactor(F);
    const V J = determinant(F, C), sheared = S(2) * dot(tau_bar, D), squeezed = trace(tau_bar) * trace(D);
    return {(shear * sheared + bulk * squeezed) * C,
            (S(2) * J * shear) * tau_bar + identity_times(J * bulk * trace(tau_bar)), J * sheared, J * squeezed};
}

// --- stiffening: tau = 4 c (I1_bar - 3) J^(-2/3) dev(F F^T)

template <class V>
class Stiffening {
    using S = Scalar<V>;
    Mat3<V> F_, cofactor_, b_;  // b_ = J^(-2/3) F F^T
    V J_, power_, invariant_, modulus_;
    Mat3<V> deviator_;

public:
    Mat3<V> tau;

    Stiffening(const Mat3<V>& F, V modulus) : F_(F), cofactor_(cofactor(F)), modulus_(modulus) {
        J_ = determinant(F, cofactor_);
        power_ = exp(S(-2.0 / 3.0) * log(J_));
        b_ = symmetric_product(power_ * F, transpose(F));
        invariant_ = trace(b_);
        deviator_ = b_ - identity_times(S(1.0 / 3.0) * invariant_);
        tau = (S(4) * modulus_ * (invariant_ - S(3))) * deviator_;
    }

    struct Adjoint {
        Mat3<V> F;
        V modulus;
    };

    Adjoint adjoint(const Mat3<V>& tau_bar) const {
        const V excess = S(4) * (invariant_ - S(3)), work = dot(tau_bar, deviator_);
        const Mat3<V> deviator_bar = (modulus_ * excess) * tau_bar;
        const V invariant_bar = S(4) * modulus_ * work - S(1.0 / 3.0) * trace(deviator_bar);
        const Mat3<V> b_bar = deviator_bar + identity_times(invariant_bar);
        const V J_bar = S(-2.0 / 3.0) * dot(b_bar, b_) / J_;
        return {(S(2) * power_) * (b_bar * F_) + J_bar * cofactor_, excess * work};
    }
};

// --- fibres: tau = k / 2 (|F a|^2 - 1) (F a) (F a)^T

template <class V>
inline Mat3<V> fibre_stress(const Mat3<V>& F, V modulus, const Vec3<V>& direction) {
    const Vec3<V> g = F * direction;
    const V size = Scalar<V>(0.5) * modulus * (dot(g, g) - Scalar<V>(1));
    Mat3<V> tau;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) tau(i, j) = size * g[i] * g[j];
    return tau;
}

template <class V>
struct FibreAdjoint {
    Mat3<V> F;
    V modulus;
    Vec3<V> direction;
};

template <class V>
inline FibreAdjoint<V> fibre_stress_adjoint(const Mat3<V>& F, V modulus, const Vec3<V>& direction,
                                            const Mat3<V>& tau_bar) {
    const Vec3<V> g = F * direction, pulled = tau_bar * g;
    const V strain = dot(g, g) - Scalar<V>(1), work = dot(g, pulled);
    const Vec3<V> g_bar = modulus * (work * g + strain * pulled);
    Mat3<V> F_bar;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) F_bar(i, j) = g_bar[i] * direction[j];
    return {F_bar, Scalar<V>(0.5) * strain * work, transpose(F) * g_bar};
}

}  // namespace physreal
