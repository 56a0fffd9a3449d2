// Node phases of all rollouts at once: what is around the nodes, velocities from forces, and on the way back both adjoints
// in one.
//
// Slots count from the frame's first one, `first[0]`, so that one CUDA graph serves every frame that is kept. A slot of
// `free` takes the free velocities of a substep.
#pragma once
#include "parts.h"
#include "phase.h"
#include "report.h"

namespace physreal {

// INPUTS: whether gravity has an adjoint; TERMS: bits of the optional laws in use.
template <class S, bool INPUTS, Index TERMS>
class NodeOfRollout {
    const Frame<S>& f_;
    const int n_, rollout_, own_;  // number among all, its rollout, number within
    const NodePhase<S> phase_;

    Vec4<S>& at(S* grid) const { return reinterpret_cast<Vec4<S>*>(grid)[n_]; }
    Vec4<S>& free(int slot) const {
        return reinterpret_cast<Vec4<S>*>(f_.free)[Index(f_.first[0] + slot) * f_.rollouts * f_.nodes + n_];
    }

    Around<S> around() const { return {f_.around[2 * n_], f_.around[2 * n_ + 1]}; }
    bool held() const {
        const Scene<S> scene = {
            {f_.offset[0], f_.offset[1], f_.offset[2]}, f_.cell, f_.clamps, f_.clamp_lower, f_.clamp_upper};
        bool held = false;
        for (int c = f_.first_copy[own_]; c >= 0; c = f_.next_copy[c]) held |= scene.holds(c, f_.count);
        return held;
    }
    // Before a substep; before the first one the frame's.
    Vec4<S> velocity_before(int slot) const {
        return slot > 0 ? phase_.velocity(free(slot - 1), around()) : at(f_.first_velocity);
    }

public:
    NodeOfRollout(const Frame<S>& f, int n)
        : f_(f),
          n_(n),
          rollout_(n / int(f.nodes)),
          own_(n - rollout_ * int(f.nodes)),
          phase_(phase_of<S, TERMS>(f, rollout_)) {}

    // What is around the node. sum: that the particles have left (parts.h), here and below.
    void weigh(const Vec4<S>& sum) const {
        f_.around[2 * n_] = held() ? S(0) : sum[0];
        f_.around[2 * n_ + 1] = sum[1];
    }

    // --- forward

    void start() const {
        at(f_.first_velocity) = at(f_.velocity);
        if (n_ < f_.rollouts) f_.report[n_] = NOT_FAILED;
    }

    void update(const Vec4<S>& sum, int slot) const {
        const Vec4<S> velocity = phase_.free(at(f_.velocity), sum, around());
        free(slot) = velocity;
        at(f_.velocity) = phase_.velocity(velocity, around());
    }

    // --- adjoint

    // slot: the substep whose forces' adjoint is asked for (arriving); the velocities are those before it (leaving). The
    // adjoint of the nodes' velocity, which the particles have left, becomes that of the forces times dt. `carry` holds what
    // later substeps give to the velocity, and the masses' adjoint, which grows.
    void turn(const Vec4<S>& sum, int slot, int arriving, int leaving) const {
        if (arriving) {
            const Vec4<S> before = velocity_before(slot), carried = at(f_.carry);
            FrictionBar<S> friction_bar = {};
            const auto found = phase_.adjoint(before, free(slot), around(), carried + sum, friction_bar);
            const Vec4<S>& bar = found.free;
            const S share = around().mass > f_.mass_floor ? 1 / around().mass : S(0);
            at(f_.carry) = {{bar[0], bar[1], bar[2], carried[3] + found.mass}};
            at(f_.node_bar) = {{share * bar[0], share * bar[1], share * bar[2], bar[3]}};
            if (f_.first_copy[own_] == own_) add_node_sums<INPUTS, TERMS>(f_, n_, friction_bar, bar);
        }
        if (leaving) at(f_.velocity) = velocity_before(slot);
    }

    // Moves the masses' adjoint into node_bar.
    void settle() const {
        Vec4<S>& bar = at(f_.carry);
        at(f_.node_bar) = {{0, 0, 0, bar[3]}};
        bar[3] = 0;
    }
};

}  // namespace physreal
