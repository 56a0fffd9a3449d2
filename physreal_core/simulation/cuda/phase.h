// The node phase of a rollout, and what its adjoint gives to what all nodes share.
#pragma once
#include "nodes.h"

namespace physreal {

// TERMS: bits of the optional laws in use.
template <class S, Index TERMS>
inline NodePhase<S> phase_of(const Frame<S>& f, int rollout) {
    const S* g = f.gravity + 3 * rollout;
    const S* law = TERMS & term::friction_law ? f.friction_law + 3 * rollout : nullptr;
    return {f.timing[0], {g[0], g[1], g[2]}, f.mass_floor, f.touching, f.friction[rollout], law};
}

// n: number of the node among all; free_bar: adjoint of its free velocity. INPUTS: whether gravity has an adjoint.
template <bool INPUTS, Index TERMS, class S, class Node>
inline void add_node_sums(const Frame<S>& f, Index n, const FrictionBar<S>& friction_bar, const Node& free_bar) {
    const auto add = [&](int sum, S value) { f.node_sums[sum * f.rollouts * f.nodes + n] += value; };
    add(node_sum::friction_coefficient, friction_bar.dynamic);
    for (int d = 0; d < 3; ++d) {
        if (INPUTS) add(node_sum::gravity + d, f.timing[0] * free_bar[d]);
        if (TERMS & term::friction_law) add(node_sum::friction_law + d, friction_bar.law[d]);
    }
}

}  // namespace physreal
