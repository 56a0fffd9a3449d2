// Stiffening: tau = 4 c (I1_bar - 3) J^(-2/3) dev(F F^T), with I1_bar = J^(-2/3) |F|^2.
#pragma once
#include "term.h"

namespace physreal {

struct Stiffening {
    static constexpr Index TERM = term::stiffening;

    template <class At, class V>
    static Mat3<V> stress(const At& at, const Mat3<V>& F) {
        const Strain<V> s(F);
        return (at.value(row::stiffening) * s.excess) * s.deviator;
    }

    template <class At, class V>
    static void adjoint(At& at, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        using S = Scalar<V>;
        const Strain<V> s(F);
        const V modulus = at.value(row::stiffening), work = dot(tau_bar, s.deviator);
        const Mat3<V> deviator_bar = (modulus * s.excess) * tau_bar;
        const V invariant_bar = S(4) * modulus * work - S(1.0 / 3.0) * trace(deviator_bar);
        const Mat3<V> b_bar = deviator_bar + identity_times(invariant_bar);
        const V J_bar = S(-2.0 / 3.0) * dot(b_bar, s.b) / s.J;
        F_bar += (S(2) * s.power) * (b_bar * F) + J_bar * s.cofactors;
        at.add(row::stiffening, s.excess * work);
    }

private:
    template <class V>
    struct Strain {
        Mat3<V> cofactors, b, deviator;  // b = J^(-2/3) F F^T
        V J, power, excess;              // excess = 4 (I1_bar - 3)

        explicit Strain(const Mat3<V>& F) : cofactors(cofactor(F)) {
            using S = Scalar<V>;
            J = determinant(F, cofactors);
            power = exp(S(-2.0 / 3.0) * log(J));
            b = symmetric_product(power * F, transpose(F));
            const V invariant = trace(b);
            deviator = b - identity_times(S(1.0 / 3.0) * invariant);
            excess = S(4) * (invariant - S(3));
        }
    };
};

}  // namespace physreal
