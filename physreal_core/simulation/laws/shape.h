// The body as it lies on the grid against its own shape: F = D B, where D is the gradient of the motion from the place on
// the grid, and B leads from there to the shape without stress. B is 1 but where a body starts deformed, or flows.
//
// With tau the Kirchhoff stress and N = F^-T:  P = tau N B^T is the stress on the grid's areas (dW/dD, Piola),
// dF = dD B the change of F, and s = dF F^-1 = dt grad v the step of what looks at the present shape.
#pragma once
#include "matrix.h"

namespace physreal {

template <class V>
inline Mat3<V> inverse_transposed(const Mat3<V>& F) {
    const Mat3<V> C = cofactor(F);
    return (Scalar<V>(1) / determinant(F, C)) * C;
}

// SHAPED: whether B differs from 1; without, it is not looked at.
template <bool SHAPED, class V>
class ShapeOnGrid {
    Mat3<V> N_, B_;

public:
    ShapeOnGrid(const Mat3<V>& F, const Mat3<V>& B) : N_(inverse_transposed(F)), B_(B) {}

    Mat3<V> stress(const Mat3<V>& tau) const { return tau * area(); }
    // Returns tau_bar; adds to those of F and B.
    Mat3<V> stress_adjoint(const Mat3<V>& tau, const Mat3<V>& P_bar, Mat3<V>& F_bar, Mat3<V>& B_bar) const {
        const Mat3<V> M_bar = transpose(tau) * P_bar;
        add_inverse_bar(SHAPED ? M_bar * B_ : M_bar, F_bar);
        if constexpr (SHAPED) B_bar += transpose(M_bar) * N_;
        return P_bar * transpose(area());
    }

    Mat3<V> change(const Mat3<V>& dD) const { return SHAPED ? dD * B_ : dD; }
    // Returns the adjoint of dD from that of dF.
    Mat3<V> change_adjoint(const Mat3<V>& dD, const Mat3<V>& dF_bar, Mat3<V>& B_bar) const {
        if constexpr (SHAPED) B_bar += transpose(dD) * dF_bar;
        return SHAPED ? dF_bar * transpose(B_) : dF_bar;
    }

    Mat3<V> step(const Mat3<V>& dF) const { return dF * transpose(N_); }
    // Returns the adjoint of dF from that of s; adds to that of F.
    Mat3<V> step_adjoint(const Mat3<V>& dF, const Mat3<V>& step_bar, Mat3<V>& F_bar) const {
        add_inverse_bar(transpose(step_bar) * dF, F_bar);
        return step_bar * N_;
    }

private:
    Mat3<V> area() const { return SHAPED ? N_ * transpose(B_) : N_; }
    void add_inverse_bar(const Mat3<V>& N_bar, Mat3<V>& F_bar) const {
        F_bar += Scalar<V>(-1) * (N_ * (transpose(N_bar) * N_));
    }
};

// B after plastic flow from `trial` to F: the flow changes the shape without stress and not the motion.
template <class V>
inline Mat3<V> shape_after_flow(const Mat3<V>& B, const Mat3<V>& trial, const Mat3<V>& F) {
    return B * (transpose(inverse_transposed(trial)) * F);
}
// B_bar goes from after the flow to before it; adds to the adjoints of trial and F.
template <class V>
inline void shape_after_flow_adjoint(const Mat3<V>& B, const Mat3<V>& trial, const Mat3<V>& F, Mat3<V>& B_bar,
                                     Mat3<V>& trial_bar, Mat3<V>& F_bar) {
    const Mat3<V> N = inverse_transposed(trial), BtB_bar = transpose(B) * B_bar;
    F_bar += N * BtB_bar;
    trial_bar += Scalar<V>(-1) * (N * (BtB_bar * (transpose(F) * N)));
    B_bar = B_bar * transpose(transpose(N) * F);
}

}  // namespace physreal
