// The entry points of the fused kernels: one node or particle of all rollouts.
#pragma once
#include "node_phases.h"
#include "particles.h"

namespace physreal {

template <class S, bool INPUTS, Index TERMS, bool SHAPED, int HAND, bool LED, bool TOUCHES, template <class> class Elastic,
          class Plastic, class ElasticNetwork, class PlasticNetwork>
struct Step : ContactStep<S, 3, true> {
    using Node = NodeOfRollout<S, INPUTS, TERMS>;
    using Particle = ParticleOfRollout<S, INPUTS, TERMS, SHAPED, HAND, LED, TOUCHES,
                                       Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>;

    static void give_mass(const Frame<S>& f, int thread) {
        particle(f, thread, [](Particle p) { p.give_mass(); });
    }
    static void weigh(const Frame<S>& f, int thread) {
        node(f, thread, [](Node n, const Vec4<S>& sum) { n.weigh(sum); });
    }

    static void start(const Frame<S>& f, int n) { Node(f, n).start(); }
    static void update(const Frame<S>& f, int thread, int slot) {
        node(f, thread, [=](Node n, const Vec4<S>& sum) { n.update(sum, slot); });
    }
    static void turn(const Frame<S>& f, int thread, int slot, int arriving, int leaving) {
        node(f, thread, [=](Node n, const Vec4<S>& sum) { n.turn(sum, slot, arriving, leaving); });
    }
    static void settle_nodes(const Frame<S>& f, int n) { Node(f, n).settle(); }
    static void settle_particles(const Frame<S>& f, int thread) {
        particle(f, thread, [](Particle p) { p.settle(); });
    }

    template <bool ARRIVING, bool LEAVING>
    static void forward(const Frame<S>& f, int thread, int substep, int slot, int slot_next, int keep) {
        particle(f, thread, [=](Particle p) {
            p.template forward<ARRIVING, LEAVING>(substep, slot, slot_next, keep);
        });
    }
    template <bool ARRIVING, bool LEAVING>
    static void backward(const Frame<S>& f, int thread, int slot) {
        particle(f, thread, [=](Particle p) { p.template backward<ARRIVING, LEAVING>(slot); });
    }

private:
    // Calls use with the thread's node and the sum of what particles left there; of a node's threads the first one does.
    template <class Use>
    static void node(const Frame<S>& f, int thread, Use use) {
        const Vec4<S> sum = gathered(f, thread / LANES, thread % LANES);
        if (thread % LANES == 0) use(Node(f, thread / LANES), sum);
    }
    // Calls use with the thread's particle; the last of a rollout's threads have none (parts.py).
    template <class Use>
    static void particle(const Frame<S>& f, int thread, Use use) {
        const int own = thread % int(f.threads);
        if (own < f.particles) use(Particle(f, thread / int(f.threads), own));
    }
};

}  // namespace physreal
