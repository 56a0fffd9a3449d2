// The entry points of the fused kernels: one node or particle of all rollouts.
#pragma once
#include "node_phases.h"
#include "particles.h"

namespace physreal {

template <class S, bool INPUTS, Index TERMS, bool SHAPED, bool GRIPPED, bool LED, template <class> class Elastic,
          class Plastic, class ElasticNetwork, class PlasticNetwork>
struct Step {
    using Node = NodeOfRollout<S, INPUTS, TERMS>;
    using Particle = ParticleOfRollout<S, INPUTS, TERMS, SHAPED, GRIPPED, LED,
                                       Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>;

    static void give_mass(const Frame<S>& f, int p) { Particle(f, p).give_mass(); }
    static void weigh(const Frame<S>& f, int n) { Node(f, n).weigh(); }

    static void start(const Frame<S>& f, int n) { Node(f, n).start(); }
    static void update(const Frame<S>& f, int n, int slot, int cleared_slot) { Node(f, n).update(slot, cleared_slot); }
    static void turn(const Frame<S>& f, int n, int slot, int arriving, int leaving) {
        Node(f, n).turn(slot, arriving, leaving);
    }
    static void settle_nodes(const Frame<S>& f, int n) { Node(f, n).settle(); }
    static void settle_particles(const Frame<S>& f, int p) { Particle(f, p).settle(); }

    template <bool ARRIVING, bool LEAVING>
    static void forward(const Frame<S>& f, int p, int substep, int slot, int slot_next, int grid_slot, int keep) {
        Particle(f, p).template forward<ARRIVING, LEAVING>(substep, slot, slot_next, grid_slot, keep);
    }
    template <bool ARRIVING, bool LEAVING>
    static void backward(const Frame<S>& f, int p, int slot) {
        Particle(f, p).template backward<ARRIVING, LEAVING>(slot);
    }
};

}  // namespace physreal
