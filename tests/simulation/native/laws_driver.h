// Every block of particles through a material, stress or flow and its adjoint, on arrays of rows of `stride` numbers; and
// the elementary functions alone.
#pragma once

#include "material.h"

namespace physreal {

template <class V> inline Mat3<V> load_matrix(const Scalar<V>* row, long stride) {
    Mat3<V> A;
    for (int i = 0; i < 9; ++i) A.m[i] = load(row + i * stride);
    return A;
}

template <class V> inline void store_matrix(Scalar<V>* row, long stride, const Mat3<V>& A) {
    for (int i = 0; i < 9; ++i) store(row + i * stride, A.m[i]);
}

template <class Material, class S>
void stress_of_all(const MaterialArrays<S>& arrays, const S* F_in, const S* bar_in, S* out, S* F_bar_out,
                   bool backward) {
    using V = Lanes<S>;
    Material material(arrays);
    for (int p = 0; p < arrays.stride; p += LANES) {
        const Mat3<V> F = load_matrix<V>(F_in + p, arrays.stride);
        const auto stress = material.stress(p, F);
        store_matrix(out + p, arrays.stride, stress.tau);
        if (!backward) continue;
        Mat3<V> F_bar = load_matrix<V>(F_bar_out + p, arrays.stride);
        material.stress_adjoint(p, stress, F, load_matrix<V>(bar_in + p, arrays.stride), F_bar);
        store_matrix(F_bar_out + p, arrays.stride, F_bar);
    }
    if (backward) material.finish();
}

template <class Material, class S>
void flow_of_all(const MaterialArrays<S>& arrays, const S* F_in, const S* bar_in, S* out, S* F_bar_out, bool backward) {
    using V = Lanes<S>;
    Material material(arrays);
    for (int p = 0; p < arrays.stride; p += LANES) {
        const Mat3<V> trial = load_matrix<V>(F_in + p, arrays.stride);
        store_matrix(out + p, arrays.stride, material.flow(p, trial));
        if (!backward) continue;
        const Mat3<V> bar = material.flow_adjoint(p, trial, load_matrix<V>(bar_in + p, arrays.stride));
        store_matrix(F_bar_out + p, arrays.stride, bar);
    }
    if (backward) material.finish();
}

// rows: addresses of E, nu, plastic, latent elastic, network elastic, latent plastic, network plastic; of their adjoints
// in the same order; of the workspace, F, the result's adjoint, the result and F's adjoint.
// numbers: dt, share, beta_elastic, beta_plastic, strain_scale.
template <class S, template <class> class Elastic, class Plastic, class ElasticNetwork, class PlasticNetwork>
void evaluate(const unsigned long long* rows, const S* numbers, long stride, bool flow, bool backward) {
    using M = Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>;
    const auto row = [&](int i) { return reinterpret_cast<S*>(rows[i]); };
    const MaterialArrays<S> arrays = {row(0),     row(1),     row(2),     row(3),     row(4),  row(5),  row(6),
                                      row(7),     row(8),     row(9),     row(10),    row(11), row(12), row(13),
                                      stride,     numbers[0], numbers[1], numbers[2], numbers[3], numbers[4], row(14)};
    if (flow)
        flow_of_all<M>(arrays, row(15), row(16), row(17), row(18), backward);
    else
        stress_of_all<M>(arrays, row(15), row(16), row(17), row(18), backward);
}

// Scalars of the workspace, and particles of a block.
template <class S, class ElasticNetwork, class PlasticNetwork> inline void sizes(int* out) {
    out[0] = Material<S, NeoHookean, Identity, ElasticNetwork, PlasticNetwork>::workspace_size;
    out[1] = LANES;
}

// Five rows of `stride`: log, exp, sine, cosine, and in all lanes of a block the sum of its numbers.
template <class S> void elementary(const S* x, S* out, int stride) {
    using V = Lanes<S>;
    for (int p = 0; p < stride; p += LANES) {
        const V value = load(x + p);
        V sine, cosine;
        sin_cos(value, sine, cosine);
        const V results[] = {log(value), exp(value), sine, cosine, splat<V>(sum(value))};
        for (int i = 0; i < 5; ++i) store(out + i * stride + p, results[i]);
    }
}

}  // namespace physreal
