// The laws on many particles, values and adjoints: materials, residuals alone, optional laws, friction; elementary
// functions. V is lanes or one number. Arrays are rows of `stride` numbers; `first` and `last` are whole blocks.
#pragma once
#include "friction.h"
#include "material.h"

namespace physreal {

template <class V>
inline Vec3<V> get3(const Scalar<V>* rows, Index stride, Index p) {
    return {{load<V>(rows + p), load<V>(rows + stride + p), load<V>(rows + 2 * stride + p)}};
}

template <class V>
inline Mat3<V> get9(const Scalar<V>* rows, Index stride, Index p) {
    Mat3<V> A;
    for (int i = 0; i < 9; ++i) A.m[i] = load<V>(rows + i * stride + p);
    return A;
}

template <class V>
inline void put(Scalar<V>* rows, Index stride, Index p, const Vec3<V>& a) {
    for (int i = 0; i < 3; ++i) store(rows + i * stride + p, a[i]);
}

template <class V>
inline void put(Scalar<V>* rows, Index stride, Index p, const Mat3<V>& A) {
    for (int i = 0; i < 9; ++i) store(rows + i * stride + p, A.m[i]);
}

// For networks' adjoints; filled with NaN, for nobody may read what he has not written.
template <class S, int SIZE>
struct Workspace {
    S numbers[SIZE + 1];
    Workspace() {
        for (S& number : numbers) number = not_a_number<S>();
    }
};

// --- materials

template <class V, template <class> class Elastic, class Plastic, class ElasticNetwork, class PlasticNetwork>
inline void drive_material(const Points<Scalar<V>>& a, Index first, Index last) {
    using S = Scalar<V>;
    using M = Material<V, Elastic, Plastic, ElasticNetwork, PlasticNetwork>;
    Workspace<S, M::workspace_size> workspace;
    const MaterialArrays<S> arrays = {a.E,
                                      a.nu,
                                      a.plastic,
                                      a.latent,
                                      a.weights,
                                      a.latent,
                                      a.weights,
                                      a.E_bar,
                                      a.nu_bar,
                                      a.plastic_bar,
                                      a.latent_elastic_bar,
                                      a.network_elastic_bar,
                                      a.latent_plastic_bar,
                                      a.network_plastic_bar,
                                      a.stride,
                                      a.dt,
                                      a.share,
                                      a.beta_elastic,
                                      a.beta_plastic,
                                      a.strain_scale,
                                      workspace.numbers};
    M material(arrays);
    a.width[0] = LaneTraits<V>::COUNT;
    for (Index p = first; p < last; p += LaneTraits<V>::COUNT) {
        const Mat3<V> F = get9<V>(a.F, a.stride, p), seed = get9<V>(a.seed, a.stride, p);
        if (a.flow) {
            put(a.value, a.stride, p, material.flow(p, F));
            put(a.F_bar, a.stride, p, material.flow_adjoint(p, F, seed));
        } else {
            const auto stress = material.stress(p, F);
            put(a.value, a.stride, p, stress.tau);
            Mat3<V> F_bar = get9<V>(a.F_bar, a.stride, p);
            material.stress_adjoint(p, stress, F, seed, F_bar);
            put(a.F_bar, a.stride, p, F_bar);
        }
    }
    material.finish();
}

// --- a residual beside any result of an expert

template <class V, class Net>
inline void drive_residual(const Points<Scalar<V>>& a, Index first, Index last) {
    using S = Scalar<V>;
    using NetAdjoint = typename Net::template Adjoint<V>;
    Workspace<S, NetAdjoint::workspace_size> workspace;
    NetAdjoint network_adjoint(workspace.numbers, a.flow ? a.network_plastic_bar : a.network_elastic_bar);
    for (Index p = first; p < last; p += LaneTraits<V>::COUNT) {
        const S beta = a.flow ? a.beta_plastic * a.share : a.beta_elastic;
        const ResidualInputs<S> inputs = {a.weights, a.latent + p, a.stride, beta, a.strain_scale};
        const Mat3<V> F = get9<V>(a.F, a.stride, p), R = polar_rotation(F), expert = get9<V>(a.expert, a.stride, p),
                      seed = get9<V>(a.seed, a.stride, p);
        if (a.flow) {
            const FlowResidual<V, Net> residual(F, R, expert, inputs);
            put(a.value, a.stride, p, residual.delta);
            const auto bar = residual.adjoint(F, seed, inputs, network_adjoint, a.latent_plastic_bar + p);
            put(a.F_bar, a.stride, p, bar.trial);
            put(a.expert_bar, a.stride, p, bar.F_exp);
        } else {
            const StressResidual<V, Net> residual(F, R, expert, load<V>(a.E + p), inputs);
            put(a.value, a.stride, p, residual.delta);
            const auto bar = residual.adjoint(F, seed, inputs, network_adjoint, a.latent_elastic_bar + p);
            put(a.F_bar, a.stride, p, bar.F);
            put(a.expert_bar, a.stride, p, bar.tau_exp);
            store(a.E_bar + p, bar.E);
        }
    }
    network_adjoint.finish();
}

// --- optional laws

// A block of particles as the laws see it, see term.h. The adjoint of a shared number stays one of each particle.
template <class V>
class TermAt {
    using S = Scalar<V>;
    const TermPoints<S>& a_;
    Index p_;

    Index place(Index term, int k) const { return branches_before(a_.terms, term) + k; }
    void add_to(S* rows, Index r, V bar) {
        S* row = rows + r * a_.stride + p_;
        store(row, load<V>(row) + bar);
    }
    void add_to(S* rows, Index r, const Vec3<V>& bar) {
        for (int d = 0; d < 3; ++d) add_to(rows, r + d, bar[d]);
    }

public:
    TermAt(const TermPoints<S>& points, Index p) : a_(points), p_(p) {}

    Vec3<V> x() const { return get3<V>(a_.x, a_.stride, p_); }
    Vec3<V> v() const { return get3<V>(a_.v, a_.stride, p_); }
    V mass() const { return load<V>(a_.mass + p_); }
    Mat3<V> rate() const { return get9<V>(a_.rate, a_.stride, p_); }
    Mat3<V> branch(Index term, int k) const { return get9<V>(a_.branches + 9 * place(term, k) * a_.stride, a_.stride, p_); }
    V value(Index r) const { return load<V>(a_.values + r * a_.stride + p_); }
    Vec3<V> vector(Index r) const { return get3<V>(a_.values + r * a_.stride, a_.stride, p_); }
    S number(Index n) const { return a_.numbers[n]; }
    DistanceField<S> solids() const { return distance_field(a_); }

    void add_x(const Vec3<V>& bar) { add_to(a_.x_bar, 0, bar); }
    void add_v(const Vec3<V>& bar) { add_to(a_.v_bar, 0, bar); }
    void add_mass(V bar) { add_to(a_.mass_bar, 0, bar); }
    void add_rate(const Mat3<V>& bar) {
        for (int i = 0; i < 9; ++i) add_to(a_.rate_bar, i, bar.m[i]);
    }
    void add_branch(Index term, int k, const Mat3<V>& bar) {
        for (int i = 0; i < 9; ++i) add_to(a_.branches_bar, 9 * place(term, k) + i, bar.m[i]);
    }
    template <class T>
    void add(Index r, const T& bar) {
        add_to(a_.value_bars, r, bar);
    }
    void add_number(Index n, V bar) { add_to(a_.number_bars, n, bar); }
};

template <class V>
inline void drive_terms(const TermPoints<Scalar<V>>& a, Index first, Index last) {
    for (Index p = first; p < last; p += LaneTraits<V>::COUNT) {
        TermAt<V> at(a, p);
        const Mat3<V> F = get9<V>(a.F, a.stride, p), tau_bar = symmetric(get9<V>(a.stress_seed, a.stride, p));
        const Vec3<V> f_bar = get3<V>(a.force_seed, a.stride, p);
        Vec3<V> force = {};
        Mat3<V> tau = {}, F_bar = get9<V>(a.F_bar, a.stride, p);
        ForceTerms::each(a.terms, [&](auto law) { force = force + law.force(at); });
        ForceTerms::each(a.terms, [&](auto law) { law.adjoint(at, f_bar); });
        StressTerms::each(a.terms, [&](auto law) { tau += law.stress(at, F); });
        StressTerms::each(a.terms, [&](auto law) { law.adjoint(at, F, tau_bar, F_bar); });
        put(a.force, a.stride, p, force);
        put(a.stress, a.stride, p, tau);
        put(a.F_bar, a.stride, p, F_bar);
    }
}

// A substep of one Maxwell branch.
template <class V>
inline void drive_branch(const BranchPoints<Scalar<V>>& a, Index first, Index last) {
    for (Index p = first; p < last; p += LaneTraits<V>::COUNT) {
        const Mat3<V> A = get9<V>(a.branches, a.stride, p), step = get9<V>(a.step, a.stride, p);
        const auto kept = kept_half(a.dt, a.time);
        const BranchStep<V> of_step(step);
        put(a.value, a.stride, p, of_step.advance(A, kept));
        Mat3<V> step_bar = {};
        V kept_bar = {};
        put(a.branches_bar, a.stride, p, of_step.adjoint(A, kept, get9<V>(a.seed, a.stride, p), step_bar, kept_bar));
        put(a.step_bar, a.stride, p, step_bar);
        store(a.time_bar + p, kept_half_slope(a.dt, a.time) * kept_bar);
    }
}

// Friction at a node: a row for each of mu, its adjoint's speed, dynamic coefficient and three numbers of the law.
template <class S>
inline void drive_friction(S dynamic, const S* law, const S* speed, const S* seed, S* out, Index nodes, Index node) {
    const Friction<S> mu(dynamic, law, speed[node]);
    FrictionBar<S> bar = {};
    bar.add(mu, seed[node]);
    const S results[] = {mu.value, seed[node] * mu.by_speed, bar.dynamic, bar.law[0], bar.law[1], bar.law[2]};
    for (int i = 0; i < 6; ++i) out[i * nodes + node] = results[i];
}

// --- elementary functions

// Eight rows: log, exp, sine, cosine, square root and its inverse, absolute value, and their sum in all lanes of a
// block.
template <class V>
inline void elementary(const Scalar<V>* x, Scalar<V>* out, Index count) {
    for (Index p = 0; p < count; p += LaneTraits<V>::COUNT) {
        const V value = load<V>(x + p);
        V sine, cosine;
        sin_cos(value, sine, cosine);
        const V results[] = {log(value),  exp(value),          sine,       cosine,
                             sqrt(value), inverse_sqrt(value), abs(value), splat<V>(sum(value))};
        for (int i = 0; i < 8; ++i) store(out + i * count + p, results[i]);
    }
}

}  // namespace physreal
