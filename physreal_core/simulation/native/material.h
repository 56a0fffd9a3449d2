// The material of a block of LANES particles: expert laws plus, where there is a network, their neural residuals, with
// adjoints that add to the parameters' rows. The twin of plain/material.py.
#pragma once

#include "laws/drucker_prager.h"
#include "laws/fixed_corotated.h"
#include "laws/hencky.h"
#include "laws/identity.h"
#include "laws/neo_hookean.h"
#include "laws/von_mises.h"
#include "residual.h"

namespace physreal {

// Rows of `stride` particles, padded to whole blocks with F = 1, valid E and nu, and adjoints of zero. The bars and the
// workspace are for the adjoints only; each thread has its own workspace and its own bars of the networks.
template <class S>
struct MaterialArrays {
    const S *E, *nu;   // Young's modulus [Pa], Poisson's ratio
    const S* plastic;  // 2 rows: the law's parameters
    // latent codes, a row for each number, and the networks' flat weights
    const S *latent_elastic, *network_elastic, *latent_plastic, *network_plastic;
    S *E_bar, *nu_bar, *plastic_bar;
    S *latent_elastic_bar, *network_elastic_bar, *latent_plastic_bar, *network_plastic_bar;
    long stride;
    S dt;                                        // substep [s]
    S share;                                     // substep over frame duration
    S beta_elastic, beta_plastic, strain_scale;  // of constitutive/residual_config.py
    S* workspace;                                // Material::workspace_size scalars
};

// The polar rotation of F, from the expert where it has it.
template <class Expert, class V>
inline Mat3<V> rotation(const Expert&, const Mat3<V>& F) {
    return polar_rotation(F);
}
template <class V>
inline Mat3<V> rotation(const FixedCorotated<V>& expert, const Mat3<V>&) {
    return expert.R;
}

// The stress of an expert and its residual; just the expert's without a network.
template <class V, class Expert, class Net>
struct HybridStress {
    Expert expert;
    StressResidual<V, Net> residual;
    Mat3<V> tau;

    HybridStress(const Mat3<V>& F, V E, V nu, const ResidualInputs<Scalar<V>>& inputs)
        : expert(F, E, nu), residual(F, rotation(expert, F), expert.tau, E, inputs), tau(expert.tau + residual.delta) {}
};

template <class V, class Expert>
struct HybridStress<V, Expert, NoNetwork> : Expert {
    HybridStress(const Mat3<V>& F, V E, V nu, const ResidualInputs<Scalar<V>>&) : Expert(F, E, nu) {}
};

template <class S, template <class> class Elastic, class Plastic, class ElasticNetwork, class PlasticNetwork>
class Material {
    using V = Lanes<S>;
    using ElasticAdjoint = typename ElasticNetwork::template Adjoint<S>;
    using PlasticAdjoint = typename PlasticNetwork::template Adjoint<S>;

    MaterialArrays<S> a_;
    ElasticAdjoint elastic_adjoint_;
    PlasticAdjoint plastic_adjoint_;

    V E(int p) const { return load(a_.E + p); }
    V nu(int p) const { return load(a_.nu + p); }
    V y0(int p) const { return load(a_.plastic + p); }
    V y1(int p) const { return load(a_.plastic + a_.stride + p); }
    static void add(S* row, V value) { store(row, load(row) + value); }

    ResidualInputs<S> elastic_inputs(int p) const {
        return {a_.network_elastic, a_.latent_elastic + p, a_.stride, a_.beta_elastic, a_.strain_scale};
    }
    ResidualInputs<S> plastic_inputs(int p) const {
        return {a_.network_plastic, a_.latent_plastic + p, a_.stride, a_.beta_plastic * a_.share, a_.strain_scale};
    }

public:
    static constexpr bool flows = Plastic::flows || PlasticNetwork::present;
    static constexpr int workspace_size = ElasticAdjoint::workspace_size + PlasticAdjoint::workspace_size;

    using Stress = HybridStress<V, Elastic<V>, ElasticNetwork>;  // has `tau` [Pa], and what the adjoint needs

    explicit Material(const MaterialArrays<S>& arrays)
        : a_(arrays),
          elastic_adjoint_(arrays.workspace, arrays.network_elastic_bar),
          plastic_adjoint_(arrays.workspace + ElasticAdjoint::workspace_size, arrays.network_plastic_bar) {}

    // p: the first particle of a block, here and below.
    Stress stress(int p, const Mat3<V>& F) const { return Stress(F, E(p), nu(p), elastic_inputs(p)); }

    // Adds to F_bar and to the rows of the parameters' adjoints.
    void stress_adjoint(int p, const Stress& stress, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        if constexpr (ElasticNetwork::present) {
            const auto neural =
                stress.residual.adjoint(F, tau_bar, elastic_inputs(p), elastic_adjoint_, a_.latent_elastic_bar + p);
            F_bar += neural.F;
            add(a_.E_bar + p, neural.E);
            expert_adjoint(p, stress.expert, tau_bar + neural.tau_exp, F_bar);
        } else {
            expert_adjoint(p, stress, tau_bar, F_bar);
        }
    }

    // F after plastic flow over a substep.
    Mat3<V> flow(int p, const Mat3<V>& trial) const {
        const Mat3<V> F = expert_flow(p, trial);
        if constexpr (PlasticNetwork::present)
            return F + FlowResidual<V, PlasticNetwork>(trial, polar_rotation(trial), F, plastic_inputs(p)).delta;
        else
            return F;
    }

    // Adjoint of the trial from that of the new F; adds to the rows of the parameters' adjoints.
    Mat3<V> flow_adjoint(int p, const Mat3<V>& trial, const Mat3<V>& new_bar) {
        Mat3<V> expert_bar = new_bar, neural_bar = {};
        if constexpr (PlasticNetwork::present) {
            const Mat3<V> F = expert_flow(p, trial);
            const ResidualInputs<S> inputs = plastic_inputs(p);
            const FlowResidual<V, PlasticNetwork> residual(trial, polar_rotation(trial), F, inputs);
            const auto neural = residual.adjoint(trial, new_bar, inputs, plastic_adjoint_, a_.latent_plastic_bar + p);
            expert_bar += neural.F_exp;
            neural_bar = neural.trial;
        }
        if constexpr (Plastic::flows) {
            const FlowAdjoint<V> bar = Plastic::adjoint(trial, E(p), nu(p), y0(p), y1(p), a_.dt, expert_bar);
            add(a_.E_bar + p, bar.E);
            add(a_.nu_bar + p, bar.nu);
            add(a_.plastic_bar + p, bar.y0);
            add(a_.plastic_bar + a_.stride + p, bar.y1);
            expert_bar = bar.F;
        }
        return expert_bar + neural_bar;
    }

    // Adds what is left of the networks' adjoints; after the last block, before the bars are read.
    void finish() {
        elastic_adjoint_.finish();
        plastic_adjoint_.finish();
    }

private:
    Mat3<V> expert_flow(int p, const Mat3<V>& trial) const {
        if constexpr (Plastic::flows)
            return Plastic::flow(trial, E(p), nu(p), y0(p), y1(p), a_.dt);
        else
            return trial;
    }

    template <class Expert>
    void expert_adjoint(int p, const Expert& expert, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        const StressAdjoint<V> bar = expert.adjoint(tau_bar);
        F_bar += bar.F;
        add(a_.E_bar + p, bar.E);
        add(a_.nu_bar + p, bar.nu);
    }
};

}  // namespace physreal
