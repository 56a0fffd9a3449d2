// The shared half of every plastic expert: an isotropic return map in log strain, F_new = exp(delta eps) F_trial.
//
// With eps = log V of the trial F = V R, split into its deviator of norm q and its trace t, an isotropic law only has
// to say where (q, t) goes; direction of the deviator, principal frame and rotation R stay. Inside the yield surface F
// is returned untouched. At the surface the map has a kink: values join, derivatives jump, and exactly on it the
// elastic side's hold. Exponential return in log strain: Simo, CMAME 99 (1992).
#pragma once

#include "adjoint.h"
#include "log_strain.h"

namespace physreal {

// Where a law puts deviator norm and trace, in the lanes that yield.
template <class V>
struct Radial {
    Mask<V> yields;
    V q, t;
};

template <class V>
struct RadialAdjoint {
    V q, t, E, nu, y0, y1;
};

// a / b, 0 where b is not positive.
template <class V>
inline V ratio(V a, V b) {
    return select(b > Scalar<V>(0), a / b, V{});
}

// eps_bar of H = exp(eps), all in the principal frame: Daleckii and Krein's divided differences of the exponential,
// exp((x + y) / 2) sinh(d) / d with d = (x - y) / 2, by its series where x and y are near.
template <class V>
inline Mat3<V> exponential_adjoint(const Vec3<V>& eps, const Mat3<V>& H_bar) {
    using S = Scalar<V>;
    constexpr int TERMS = sizeof(S) == 4 ? 5 : 9;  // of sinh's series, for |d| < 0.5
    Vec3<V> root, whole;
    for (int i = 0; i < 3; ++i) {
        root[i] = exp(S(0.5) * eps[i]);
        whole[i] = root[i] * root[i];
    }
    Mat3<V> eps_bar = symmetric(H_bar);
    for (int i = 0; i < 3; ++i) {
        eps_bar(i, i) *= whole[i];
        for (int j = 0; j < i; ++j) {
            const V distance = eps[i] - eps[j], square = S(0.25) * distance * distance;
            V series = splat<V>(inverse_factorial<S>(2 * TERMS - 1));
            for (int k = TERMS - 2; k >= 0; --k) series = series * square + inverse_factorial<S>(2 * k + 1);
            const V apart = (whole[i] - whole[j]) / distance;
            eps_bar(i, j) *= select(square < S(0.25), root[i] * root[j] * series, apart);
            eps_bar(j, i) = eps_bar(i, j);
        }
    }
    return eps_bar;
}

// `Law` has `radial(q, t, E, nu, y0, y1, dt)` and `radial_adjoint(q, t, E, nu, y0, y1, dt, q_new_bar, t_new_bar)`; only
// the lanes that yield are used of the latter.
template <class Law>
struct ReturnMap {
    static constexpr bool flows = true;

    // F_trial itself, bit for bit, in the lanes that do not yield.
    template <class V>
    static Mat3<V> flow(const Mat3<V>& trial, V E, V nu, V y0, V y1, Scalar<V> dt) {
        if (!may_yield(trial, E, nu, y0, y1, dt)) return trial;
        const Step<V> step(trial, E, nu, y0, y1, dt);
        return where(step.yields, step.exponential() * trial, trial);
    }

    template <class V>
    static FlowAdjoint<V> adjoint(const Mat3<V>& trial, V E, V nu, V y0, V y1, Scalar<V> dt, const Mat3<V>& F_bar) {
        using S = Scalar<V>;
        if (!may_yield(trial, E, nu, y0, y1, dt)) return {F_bar, V{}, V{}, V{}, V{}};
        const Step<V> step(trial, E, nu, y0, y1, dt);
        const Mat3<V>& Q = step.p.Q;
        const Mat3<V> H_bar = (transpose(Q) * F_bar) * transpose(step.p.A);  // principal frame, as what follows
        const Mat3<V> delta_bar = exponential_adjoint(step.delta, H_bar);
        V scale_bar = V{};
        for (int i = 0; i < 3; ++i) scale_bar += delta_bar(i, i) * step.deviator[i];
        const V t_bar = S(1.0 / 3.0) * trace(delta_bar);
        const RadialAdjoint<V> back =
            Law::radial_adjoint(step.q, step.t, E, nu, y0, y1, dt, ratio(scale_bar, step.q), t_bar);
        const V q_bar = back.q - ratio(scale_bar * step.scale, step.q);
        Mat3<V> eps_bar = (step.scale - S(1)) * delta_bar;  // the deviator's first
        for (int i = 0; i < 3; ++i) eps_bar(i, i) += ratio(q_bar, step.q) * step.deviator[i];
        const V mean_bar = back.t - t_bar - S(1.0 / 3.0) * trace(eps_bar);
        for (int i = 0; i < 3; ++i) eps_bar(i, i) += mean_bar;
        const Mat3<V> trial_bar = step.exponential() * F_bar + log_strain_adjoint(step.p, eps_bar);
        const auto if_yields = [&](V x) { return select(step.yields, x, V{}); };
        return {where(step.yields, trial_bar, F_bar), if_yields(back.E), if_yields(back.nu), if_yields(back.y0),
                if_yields(back.y1)};
    }

private:
    // Whether any lane can yield, without a principal frame: with b = F F^T, m = tr(b) / 3 and x = |b / m - I| < 1,
    // q <= |log(b / m)| / 2 <= -log(1 - x) / 2 <= x / (2 (1 - x)), and every law yields above some q at a given trace.
    template <class V>
    static bool may_yield(const Mat3<V>& trial, V E, V nu, V y0, V y1, Scalar<V> dt) {
        using S = Scalar<V>;
        constexpr S MARGIN = 100 * ITERATE_TOLERANCE<S> * ITERATE_TOLERANCE<S>;  // rounding, here and in principal()
        const Mat3<V> b = symmetric_product(trial, transpose(trial));
        const V m = S(1.0 / 3.0) * trace(b);
        const Mat3<V> deviator = b - identity_times(m);
        const V x = sqrt(dot(deviator, deviator)) / m;
        const V bound = S(1.01) * S(0.5) * x / (S(1) - x) + MARGIN;
        const V q = select(x < S(0.9), bound, splat<V>(infinity<S>()));
        return any(Law::radial(q, log(determinant(trial)), E, nu, y0, y1, dt).yields);
    }

    // The trial strain, and the change `delta` of the principal strains that the law asks for.
    template <class V>
    struct Step {
        Principal<V> p;
        V t, q, scale;
        Vec3<V> deviator, delta;
        Mask<V> yields;

        Step(const Mat3<V>& trial, V E, V nu, V y0, V y1, Scalar<V> dt) : p(principal(trial)) {
            using S = Scalar<V>;
            t = p.eps[0] + p.eps[1] + p.eps[2];
            for (int i = 0; i < 3; ++i) deviator[i] = p.eps[i] - S(1.0 / 3.0) * t;
            q = sqrt(dot(deviator, deviator));
            const Radial<V> next = Law::radial(q, t, E, nu, y0, y1, dt);
            yields = next.yields;
            scale = ratio(next.q, q);
            const V change = S(1.0 / 3.0) * (next.t - t);
            for (int i = 0; i < 3; ++i) delta[i] = (scale - S(1)) * deviator[i] + change;
        }

        Mat3<V> exponential() const { return from_principal(p.Q, {{exp(delta[0]), exp(delta[1]), exp(delta[2])}}); }
    };

    template <class V>
    static Mat3<V> where(Mask<V> mask, const Mat3<V>& where_set, const Mat3<V>& elsewhere) {
        Mat3<V> out;
        for (int i = 0; i < 9; ++i) out.m[i] = select(mask, where_set.m[i], elsewhere.m[i]);
        return out;
    }
};

}  // namespace physreal
