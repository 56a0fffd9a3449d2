// Maxwell branches beside the elastic law: each is a spring and a dashpot in series. Its state is A = b - 1, where b is
// the left Cauchy-Green tensor of its spring; it is zero where the branch is relaxed.
//
//     b' = L b + b L^T - (b - 1) / t   with L the deviator of the velocity gradient,   tau = m dev(b)
//
// m [Pa] is the branch's shear modulus, t [s] its relaxation time. With the energy m/2 (tr b - 3 - log det b) per
// undeformed volume the power that is lost is m / (2 t) tr(b + b^-1 - 2), which is never negative. Sources: Simo,
// "On a fully three-dimensional finite-strain viscoelastic damage model", CMAME 60(2), 1987, for the deviatoric split;
// Reese and Govindjee, "A theory of finite viscoelasticity and numerical aspects", Int. J. Solids Struct. 35, 1998, for
// the spring's own strain as a state. The linear relaxation of b is that of an upper-convected Maxwell fluid.
//
// A substep relaxes for half of its length, carries b along with f = det(1 + s)^(-1/3) (1 + s), s = dt grad v, and
// relaxes for the other half (Strang splitting: second order in dt; b stays positive definite; each part dissipates).
// Without relaxation b is exactly that of the deformation gradient, less its volume.
#pragma once
#include "term.h"

namespace physreal {

template <class V>
inline Mat3<V> deviator(const Mat3<V>& A) {
    return A - identity_times(Scalar<V>(1.0 / 3.0) * trace(A));
}

// What a branch keeps of A over half a substep.
template <class S>
inline S kept_half(S dt, S time) {
    return exp(-S(0.5) * dt / time);
}
// Derivative of it by the relaxation time.
template <class S>
inline S kept_half_slope(S dt, S time) {
    return kept_half(dt, time) * S(0.5) * dt / (time * time);
}

// Of one substep, for all branches of a particle.
template <class V>
class BranchStep {
    using S = Scalar<V>;
    Mat3<V> f_, product_, cofactors_;  // 1 + s, (1 + s)(1 + s)^T - 1
    V J_, growth_;                     // det(1 + s), and J^(-2/3) - 1

public:
    // step: s = dt grad v.
    explicit BranchStep(const Mat3<V>& step) : f_(step + identity_times(splat<V>(1))), cofactors_(cofactor(f_)) {
        product_ = S(2) * symmetric(step) + symmetric_product(step, transpose(step));
        J_ = determinant(f_, cofactors_);
        growth_ = exp(S(-2.0 / 3.0) * log(J_)) - S(1);
    }

    // A after the substep; kept: of half of it.
    Mat3<V> advance(const Mat3<V>& A, S kept) const { return kept * carried(pushed(kept * A)); }

    // Returns the adjoint of A from that of A after the substep; adds to those of s and of `kept`.
    Mat3<V> adjoint(const Mat3<V>& A, S kept, const Mat3<V>& next_bar, Mat3<V>& step_bar, V& kept_bar) const {
        const Mat3<V> bar = symmetric(next_bar), half = kept * A, P = pushed(half);
        kept_bar += dot(bar, carried(P));
        const Mat3<V> P_bar = (kept * (growth_ + S(1))) * bar;
        const V growth_bar = kept * (dot(bar, P) + trace(bar));
        const Mat3<V> back = P_bar * f_, half_bar = symmetric_product(transpose(f_), back);
        step_bar += S(2) * (back + back * half) + (S(-2.0 / 3.0) * (growth_ + S(1)) / J_ * growth_bar) * cofactors_;
        kept_bar += dot(half_bar, A);
        return kept * half_bar;
    }

private:
    // (1 + s)(1 + A)(1 + s)^T - 1: small differences stay exact where A is small.
    Mat3<V> pushed(const Mat3<V>& A) const { return product_ + symmetric_product(f_ * A, transpose(f_)); }
    // The same less the volume of 1 + s.
    Mat3<V> carried(const Mat3<V>& P) const { return P + growth_ * P + identity_times(growth_); }
};

// The stress of a term's branches. TIME: place of their times among the numbers; MODULUS: row of the first's modulus.
template <Index BIT, int MODULUS, int TIME>
struct MaxwellBranches {
    static constexpr Index TERM = BIT;
    static constexpr int TIMES = TIME, COUNT = branches_of(BIT);

    template <class At, class V>
    static Mat3<V> stress(const At& at, const Mat3<V>&) {
        Mat3<V> sum = {};
        for (int k = 0; k < COUNT; ++k) sum += at.value(MODULUS + k) * at.branch(BIT, k);
        return deviator(sum);
    }

    template <class At, class V>
    static void adjoint(At& at, const Mat3<V>&, const Mat3<V>& tau_bar, Mat3<V>&) {
        const Mat3<V> bar = deviator(tau_bar);
        for (int k = 0; k < COUNT; ++k) {
            at.add(MODULUS + k, dot(bar, at.branch(BIT, k)));
            at.add_branch(BIT, k, at.value(MODULUS + k) * bar);
        }
    }
};

}  // namespace physreal
