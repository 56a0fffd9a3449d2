// The material of a particle, or of a block of lanes: expert law plus, where there is a network, its neural residual,
// with adjoints that add to the parameters' rows.
#pragma once

#include "adjoint.h"
#include "residual.h"

namespace physreal {

// Rows of `stride` particles, those of a block that is not full with F = 1, valid E and nu, and adjoints of zero. The
// bars and the workspace are for the adjoints only; each thread of a CPU has its own workspace and its own bars of the
// networks.
template <class S>
struct MaterialArrays {
    const S *E, *nu;   // Young's modulus [Pa], Poisson's ratio
    const S* plastic;  // 2 rows: the law's parameters
    // latent codes, a row for each number, and the networks' flat weights
    const S *latent_elastic, *network_elastic, *latent_plastic, *network_plastic;
    S *E_bar, *nu_bar, *plastic_bar;
    S *latent_elastic_bar, *network_elastic_bar, *latent_plastic_bar, *network_plastic_bar;
    Index stride;
    S dt;                                        // substep [s]
    S share;                                     // substep over frame duration
    S beta_elastic, beta_plastic, strain_scale;  // of residual_config.py
    S* workspace;                                // Material::workspace_size scalars
};

// A form's frame has rows `constants` and `bars` as the layout says (particle_rows.py), and the numbers of the
// residuals.
template <bool TERMS, class Frame, class S>
inline MaterialArrays<S> material_arrays(const Frame& f, S dt, S share, const S* network_elastic,
                                         const S* network_plastic, S* network_elastic_bar, S* network_plastic_bar,
                                         S* workspace) {
    const auto constants = [&](Index r) { return f.constants + r * f.stride; };
    const auto bars = [&](Index r) { return f.bars + r * f.stride; };
    constexpr Index LATENT = constant::COUNT + (TERMS ? row::COUNT : 0);
    constexpr Index LATENT_BAR = bar::COUNT + (TERMS ? input::COUNT + row::COUNT : 0);
    MaterialArrays<S> a;
    a.E = constants(constant::youngs_modulus);
    a.nu = constants(constant::poissons_ratio);
    a.plastic = constants(constant::plastic);
    a.latent_elastic = constants(LATENT);
    a.latent_plastic = constants(LATENT + f.latent_elastic_size);
    a.network_elastic = network_elastic;
    a.network_plastic = network_plastic;
    a.E_bar = bars(bar::youngs_modulus);
    a.nu_bar = bars(bar::poissons_ratio);
    a.plastic_bar = bars(bar::plastic);
    a.latent_elastic_bar = bars(LATENT_BAR);
    a.latent_plastic_bar = bars(LATENT_BAR + f.latent_elastic_size);
    a.network_elastic_bar = network_elastic_bar;
    a.network_plastic_bar = network_plastic_bar;
    a.stride = f.stride;
    a.dt = dt;
    a.share = share;
    a.beta_elastic = f.beta_elastic;
    a.beta_plastic = f.beta_plastic;
    a.strain_scale = f.strain_scale;
    a.workspace = workspace;
    return a;
}

// The polar rotation of F, from the expert where it has it.
template <class Expert, class V>
inline auto rotation(const Expert& expert, const Mat3<V>&, int) -> decltype(expert.R) {
    return expert.R;
}
template <class Expert, class V>
inline Mat3<V> rotation(const Expert&, const Mat3<V>& F, long) {
    return polar_rotation(F);
}

// The stress of an expert and its residual; just the expert's without a network.
template <class V, class Expert, class Net>
struct HybridStress {
    Expert expert;
    StressResidual<V, Net> residual;
    Mat3<V> tau;

    HybridStress(const Mat3<V>& F, V E, V nu, const ResidualInputs<Scalar<V>>& inputs)
        : expert(F, E, nu),
          residual(F, rotation(expert, F, 0), expert.tau, E, inputs),
          tau(expert.tau + residual.delta) {}
};

template <class V, class Expert>
struct HybridStress<V, Expert, NoNetwork> : Expert {
    HybridStress(const Mat3<V>& F, V E, V nu, const ResidualInputs<Scalar<V>>&) : Expert(F, E, nu) {}
};

// V: lanes, or one number. p: the first particle of a block, or the one particle.
template <class V, template <class> class Elastic, class Plastic, class ElasticNetwork, class PlasticNetwork>
class Material {
    using S = Scalar<V>;
    using ElasticAdjoint = typename ElasticNetwork::template Adjoint<V>;
    using PlasticAdjoint = typename PlasticNetwork::template Adjoint<V>;

    MaterialArrays<S> a_;
    ElasticAdjoint elastic_adjoint_;
    PlasticAdjoint plastic_adjoint_;

    V E(Index p) const { return load<V>(a_.E + p); }
    V nu(Index p) const { return load<V>(a_.nu + p); }
    V y0(Index p) const { return load<V>(a_.plastic + p); }
    V y1(Index p) const { return load<V>(a_.plastic + a_.stride + p); }
    static void add(S* row, V value) { store(row, load<V>(row) + value); }

    ResidualInputs<S> elastic_inputs(Index p) const {
        return {a_.network_elastic, a_.latent_elastic + p, a_.stride, a_.beta_elastic, a_.strain_scale};
    }
    ResidualInputs<S> plastic_inputs(Index p) const {
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

    Stress stress(Index p, const Mat3<V>& F) const { return Stress(F, E(p), nu(p), elastic_inputs(p)); }

    // Adds to F_bar and to the rows of the parameters' adjoints.
    void stress_adjoint(Index p, const Stress& stress, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
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
    Mat3<V> flow(Index p, const Mat3<V>& trial) const {
        const Mat3<V> F = expert_flow(p, trial);
        if constexpr (PlasticNetwork::present)
            return F + FlowResidual<V, PlasticNetwork>(trial, polar_rotation(trial), F, plastic_inputs(p)).delta;
        else
            return F;
    }

    // Adjoint of the trial from that of the new F; adds to the rows of the parameters' adjoints.
    Mat3<V> flow_adjoint(Index p, const Mat3<V>& trial, const Mat3<V>& new_bar) {
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
    Mat3<V> expert_flow(Index p, const Mat3<V>& trial) const {
        if constexpr (Plastic::flows)
            return Plastic::flow(trial, E(p), nu(p), y0(p), y1(p), a_.dt);
        else
            return trial;
    }

    template <class Expert>
    void expert_adjoint(Index p, const Expert& expert, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        const StressAdjoint<V> bar = expert.adjoint(tau_bar);
        F_bar += bar.F;
        add(a_.E_bar + p, bar.E);
        add(a_.nu_bar + p, bar.nu);
    }
};

}  // namespace physreal
