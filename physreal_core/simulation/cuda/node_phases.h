// Node phases on the boxes of all rollouts at once: velocities from momenta, and on the way back both adjoints in one.
//
// Every rollout has `nodes` rows of storage, of which its box takes the first. Slots count from the frame's first one,
// `first[0]`, so that one CUDA graph serves every frame that is kept.
#pragma once
#include "nodes.h"
#include "report.h"
#include "vec4.h"

namespace physreal {

// INPUTS: whether gravity has an adjoint; TERMS: bits of the optional laws in use.
template <class S, bool INPUTS, Index TERMS>
class NodeOfRollout {
    const Frame<S>& f_;
    const int n_, rollout_, own_;  // number among all, its rollout, number within
    const int* box_;
    NodePhase<S> phase_;

    Vec4<S>* momentum(int slot) const { return slot_of(f_.momentum, slot); }
    Vec4<S>* slot_of(S* grids, int slot) const {
        return reinterpret_cast<Vec4<S>*>(grids) + Index(slot) * f_.rollouts * f_.nodes;
    }

    unsigned char kind_in(const Vec4<S>* momenta) const {
        if (!(momenta[n_][3] > f_.mass_floor) || !(f_.has_ground || f_.clamps)) return FREE;
        const Scene<S> scene = {{f_.offset[0], f_.offset[1], f_.offset[2]},
                                f_.cell,
                                f_.clamps,
                                f_.has_ground,
                                f_.clamp_lower,
                                f_.clamp_upper};
        const int k = own_ % box_[5], j = own_ / box_[5] % box_[4], i = own_ / (box_[4] * box_[5]);
        const auto kind = scene.kind_of(i + box_[0], j + box_[1], k + box_[2], box_[2]);
        return phase_.kind_now(kind, momenta[n_][3], [&] { return momenta[n_ - 1][3]; });
    }

    void add(int sum, S value) const { f_.node_sums[sum * f_.rollouts * f_.nodes + n_] += value; }

public:
    NodeOfRollout(const Frame<S>& f, int n)
        : f_(f), n_(n), rollout_(n / int(f.nodes)), own_(n - rollout_ * int(f.nodes)), box_(f.box + 6 * rollout_) {
        const S* g = f.gravity + 3 * rollout_;
        phase_ = {f.timing[0],          {g[0], g[1], g[2]},
                  f.mass_floor,         f.touching,
                  f.friction[rollout_], TERMS & term::friction_law ? f.friction_law + 3 * rollout_ : nullptr};
    }

    // Whether this row of storage belongs to the rollout's box.
    bool used() const { return own_ < box_[3] * box_[4] * box_[5]; }

    void start() const {
        momentum(f_.first[0])[n_] = {};
        if (n_ < f_.rollouts * REPORT_COLUMNS) f_.report[n_] = empty_report(n_);
    }

    void update(int slot, int cleared_slot) const {
        if (!used()) return;
        const Vec4<S>* momenta = momentum(f_.first[0] + slot);
        reinterpret_cast<Vec4<S>*>(f_.velocity)[n_] = phase_.velocity(momenta[n_], kind_in(momenta));
        momentum(f_.first[0] + cleared_slot)[n_] = {};
    }

    // slot: the substep whose momenta's adjoint is asked for (arriving); the velocities are those of the one before
    // (leaving). The adjoint of the nodes' velocity becomes that of (momentum, mass); rows by turns.
    void turn(int slot, int arriving, int leaving) const {
        if (!used()) return;
        if (arriving) {
            const Vec4<S>* momenta = momentum(f_.first[0] + slot);
            Vec4<S>& bar = slot_of(f_.node_bar, slot % 2)[n_];
            FrictionBar<S> friction_bar = {};
            bar = phase_.adjoint(momenta[n_], kind_in(momenta), bar, friction_bar);
            add(node_sum::friction_coefficient, friction_bar.dynamic);
            for (int d = 0; d < 3; ++d) {
                // gravity acts on the velocity as momentum / mass does, dt times
                if (INPUTS) add(node_sum::gravity + d, phase_.dt * momenta[n_][3] * bar[d]);
                if (TERMS & term::friction_law) add(node_sum::friction_law + d, friction_bar.law[d]);
            }
        }
        if (leaving) {
            const Vec4<S>* momenta = momentum(f_.first[0] + slot - 1);
            reinterpret_cast<Vec4<S>*>(f_.velocity)[n_] = phase_.velocity(momenta[n_], kind_in(momenta));
            slot_of(f_.node_bar, (slot + 1) % 2)[n_] = {};
        }
    }
};

}  // namespace physreal
