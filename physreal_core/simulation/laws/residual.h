// Neural residuals beside the expert laws (paper, "Hybrid Expert-Neural Constitutive Model").
//
// Elastic: delta tau = beta_e n(tau_exp) R S R^T, with S = s / sqrt(1 + |s|^2), s the network's symmetric output on
// psi(F) and the latent code, and n = sqrt(|tau|^2 + e^2) - e, e = 1e-4 E: smooth at zero stress and never above
// |tau_exp|.
// Plastic: delta F = beta_p (dt / frame dt) |F_exp| r(C) R S, with r in [0, 1) growing from zero with the strain C - I
// of the trial F, so that an unstrained particle does not flow. S symmetric keeps the rotation R of F, as the experts
// do.
// Both are objective, bounded (|delta tau| <= beta_e |tau_exp|, |delta F| <= beta_p |F_exp| per frame), exactly zero
// with zero output weights, and differentiable wherever det F > 0.
//
// Features of the strain, F = R U: the three elementary symmetric functions of U - I (sorted singular values themselves
// have no derivative where two meet); the six entries 00, 11, 22, 01, 02, 12 of F^T F - I, in the axes of the
// undeformed body; and J - 1. Turning the deformed body changes none of them; turning the undeformed body in its axes
// changes the six, so a network goes to the same body in another place with turned weights (residual_config.py).
#pragma once

#include "matrix.h"
#include "network.h"

namespace physreal {

// Of one residual: the network's flat weights, the particle's latent code (rows `stride` apart), the residual's bound,
// and the strain that counts as one.
template <class S>
struct ResidualInputs {
    const S* weights;
    const S* latent;
    Index stride;
    S beta, strain_scale;
};

// The network on the strain features of F = R U: S = s / sqrt(1 + |s|^2), |S| < 1, of its symmetric output s.
template <class V, class Net>
class ResidualDirection {
    using S_ = Scalar<V>;
    static constexpr S_ ROOT = 0.70710678118654752440;  // sqrt(1/2): Mandel's scaling of the entries off the diagonal
    typename Net::template Activations<V> h_;
    typename Net::template Slopes<V> slopes_;
    V b_[OUTPUTS], shrink_;  // s / sqrt(1 + |s|^2)

    // R^T F - I: symmetric.
    static Mat3<V> stretch(const Mat3<V>& F, const Mat3<V>& R) {
        return symmetric_product(transpose(R), F) - identity_times(splat<V>(1));
    }

public:
    Mat3<V> S;

    ResidualDirection(const Mat3<V>& F, const Mat3<V>& R, const ResidualInputs<S_>& inputs) {
        const Mat3<V> W = stretch(F, R), C = symmetric_product(transpose(F), F);
        const V trace_W = trace(W);
        const V strains[STRAIN_FEATURES] = {trace_W,         S_(0.5) * (trace_W * trace_W - dot(W, W)),
                                            determinant(W),  C(0, 0) - S_(1),
                                            C(1, 1) - S_(1), C(2, 2) - S_(1),
                                            C(0, 1),         C(0, 2),
                                            C(1, 2),         determinant(F) - S_(1)};
        for (int j = 0; j < STRAIN_FEATURES; ++j) h_.inputs[j] = (S_(1) / inputs.strain_scale) * strains[j];
        for (int q = 0; q < Net::LATENT; ++q)
            h_.inputs[STRAIN_FEATURES + q] = load<V>(inputs.latent + q * inputs.stride);
        Net::forward(inputs.weights, h_, slopes_, b_);
        V square = b_[0] * b_[0];
        for (int o = 1; o < OUTPUTS; ++o) square += b_[o] * b_[o];
        shrink_ = S_(1) / sqrt(S_(1) + square);
        for (int o = 0; o < OUTPUTS; ++o) b_[o] *= shrink_;
        const V m01 = ROOT * b_[3], m02 = ROOT * b_[4], m12 = ROOT * b_[5];
        S = {{b_[0], m01, m02, m01, b_[1], m12, m02, m12, b_[2]}};
    }

    // F_bar of S_bar and of what reaches the rotation elsewhere, R_bar; adds to the latent code's adjoint.
    template <class NetAdjoint>
    Mat3<V> adjoint(const Mat3<V>& F, const Mat3<V>& R, const Mat3<V>& S_bar, const Mat3<V>& R_bar,
                    const ResidualInputs<S_>& inputs, NetAdjoint& network_adjoint, S_* latent_bar) const {
        V outputs_bar[OUTPUTS] = {S_bar(0, 0),
                                  S_bar(1, 1),
                                  S_bar(2, 2),
                                  ROOT * (S_bar(0, 1) + S_bar(1, 0)),
                                  ROOT * (S_bar(0, 2) + S_bar(2, 0)),
                                  ROOT * (S_bar(1, 2) + S_bar(2, 1))};
        V along = b_[0] * outputs_bar[0];
        for (int o = 1; o < OUTPUTS; ++o) along += b_[o] * outputs_bar[o];
        for (int o = 0; o < OUTPUTS; ++o) outputs_bar[o] = shrink_ * (outputs_bar[o] - along * b_[o]);
        V x_bar[Net::INPUTS];
        network_adjoint(inputs.weights, h_, slopes_, outputs_bar, x_bar);
        for (int q = 0; q < Net::LATENT; ++q) {
            S_* row = latent_bar + q * inputs.stride;
            store(row, load<V>(row) + x_bar[STRAIN_FEATURES + q]);
        }
        for (int j = 0; j < STRAIN_FEATURES; ++j) x_bar[j] *= S_(1) / inputs.strain_scale;
        return strains_adjoint(F, R, x_bar, R_bar);
    }

private:
    static Mat3<V> strains_adjoint(const Mat3<V>& F, const Mat3<V>& R, const V* x_bar, const Mat3<V>& R_bar) {
        const Mat3<V> W = stretch(F, R);
        Mat3<V> W_bar = x_bar[2] * cofactor(W) - x_bar[1] * W;
        for (int i = 0; i < 3; ++i) W_bar(i, i) += x_bar[1] * trace(W) + x_bar[0];
        // C = F^T F: twice its symmetric adjoint
        const Mat3<V> C_bar = {{S_(2) * x_bar[3], x_bar[6], x_bar[7], x_bar[6], S_(2) * x_bar[4], x_bar[8], x_bar[7],
                                x_bar[8], S_(2) * x_bar[5]}};
        const Mat3<V> F_bar = R * W_bar + F * C_bar + x_bar[9] * cofactor(F);
        return F_bar + polar_rotation_adjoint(F, R, F * W_bar + R_bar);
    }
};

template <class V>
struct StressResidualAdjoint {
    Mat3<V> F, tau_exp;
    V E;
};

// What the elastic residual adds to the expert's stress.
template <class V, class Net>
class StressResidual {
    using S_ = Scalar<V>;
    static constexpr S_ SMALL_STRESS = 1e-4;  // over E: below, the residual fades quadratically instead of linearly
    ResidualDirection<V, Net> direction_;
    Mat3<V> R_, tau_exp_;
    V e_, root_, size_;
    S_ beta_;

public:
    Mat3<V> delta;  // [Pa]

    // tau_exp symmetric.
    StressResidual(const Mat3<V>& F, const Mat3<V>& R, const Mat3<V>& tau_exp, V E, const ResidualInputs<S_>& inputs)
        : direction_(F, R, inputs), R_(R), tau_exp_(tau_exp), e_(SMALL_STRESS * E), beta_(inputs.beta) {
        const V square = dot(tau_exp, tau_exp);
        root_ = sqrt(square + e_ * e_);
        size_ = square / (root_ + e_);  // sqrt(square + e^2) - e without cancellation
        delta = symmetric_product(R, (beta_ * size_) * direction_.S * transpose(R));
    }

    template <class NetAdjoint>
    StressResidualAdjoint<V> adjoint(const Mat3<V>& F, const Mat3<V>& delta_bar, const ResidualInputs<S_>& inputs,
                                     NetAdjoint& network_adjoint, S_* latent_bar) const {
        const Mat3<V> bar_R = symmetric(delta_bar) * R_;
        const Mat3<V> S_bar = symmetric_product(transpose(R_), bar_R);
        const V size_bar = beta_ * dot(direction_.S, S_bar), scale = beta_ * size_;
        const Mat3<V> R_bar = (S_(2) * scale) * (bar_R * direction_.S);
        const Mat3<V> F_bar = direction_.adjoint(F, R_, scale * S_bar, R_bar, inputs, network_adjoint, latent_bar);
        return {F_bar, (size_bar / root_) * tau_exp_, size_bar * SMALL_STRESS * (e_ / root_ - S_(1))};
    }
};

template <class V>
struct FlowResidualAdjoint {
    Mat3<V> trial, F_exp;
};

// What the plastic residual adds to the expert's deformation gradient.
template <class V, class Net>
class FlowResidual {
    using S_ = Scalar<V>;
    static constexpr S_ SMALL_STRAIN = 1e-3;  // Green strain below which it fades quadratically instead of linearly
    ResidualDirection<V, Net> direction_;
    Mat3<V> R_, F_exp_, G_;
    V root_, growth_, size_;
    S_ beta_;

public:
    Mat3<V> delta;

    // The bound is the substep's: that of a frame times the substep's share of it.
    FlowResidual(const Mat3<V>& trial, const Mat3<V>& R, const Mat3<V>& F_exp, const ResidualInputs<S_>& inputs)
        : direction_(trial, R, inputs), R_(R), F_exp_(F_exp), beta_(inputs.beta) {
        G_ = symmetric_product(transpose(trial), trial) - identity_times(splat<V>(1));
        const V square = S_(0.25) * dot(G_, G_);
        root_ = sqrt(square + SMALL_STRAIN * SMALL_STRAIN);
        const V n = square / (root_ + SMALL_STRAIN);
        growth_ = n / sqrt(S_(1) + n * n);
        size_ = sqrt(dot(F_exp, F_exp));
        delta = (beta_ * size_ * growth_) * (R * direction_.S);
    }

    template <class NetAdjoint>
    FlowResidualAdjoint<V> adjoint(const Mat3<V>& trial, const Mat3<V>& delta_bar, const ResidualInputs<S_>& inputs,
                                   NetAdjoint& network_adjoint, S_* latent_bar) const {
        const Mat3<V> S_bar = transpose(R_) * delta_bar;
        const V rate = beta_ * size_ * growth_, rate_bar = beta_ * dot(direction_.S, S_bar);
        const V fade = S_(1) - growth_ * growth_;  // 1 / (1 + n^2)
        const V square_bar = S_(0.5) * rate_bar * size_ * fade * sqrt(fade) / root_;
        Mat3<V> trial_bar = direction_.adjoint(trial, R_, rate * S_bar, rate * (delta_bar * direction_.S), inputs,
                                               network_adjoint, latent_bar);
        trial_bar += square_bar * (trial * G_);
        return {trial_bar, (rate_bar * growth_ / size_) * F_exp_};
    }
};

}  // namespace physreal
