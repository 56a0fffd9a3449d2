// Node phase: what a node's velocity becomes under forces, gravity, clamps and Coulomb contact with the ground, and its
// adjoint.
//
// Contact acts, after all forces, on the nodes near which the body touches the plane (touch.py). With v the free velocity
// of such a node and v_z < 0, the plane takes out the normal impulse m L, L = a |v_z|; the tangential velocity loses at
// most mu L and sticks where that is more than it has. How fully a node touches, a in [0, 1], is the share of touching
// volume around it over a limit. Nodes that leave the plane (v_z >= 0) are free.
#pragma once
#include "friction.h"

namespace physreal {

// What holds nodes, by their place: node (i, j, k) of the lattice stands at offset + cell (i, j, k).
template <class S>
struct Scene {
    S offset[3], cell;
    Index clamps;
    const S *clamp_lower, *clamp_upper;  // [clamps, 3]

    // n: number of a node of the lattice, `count` along x, y, z.
    bool holds(Index n, const Index* count) const {
        const Index index[3] = {n / (count[1] * count[2]), n / count[2] % count[1], n % count[2]};
        for (Index c = 0; c < clamps; c++) {
            bool held = true;
            for (int d = 0; d < 3; d++) {
                const S position = offset[d] + cell * S(index[d]);
                held &= position >= clamp_lower[3 * c + d] && position <= clamp_upper[3 * c + d];
            }
            if (held) return true;
        }
        return false;
    }
};

// What is around a node: mass and volume of the particles, each with its weight; a clamp's nodes have no mass here.
template <class S>
struct Around {
    S mass, volume;
};

// What a node's velocity follows from. `Node` is any type of four S: a vector of lanes, or Vec4.
template <class S>
struct NodePhase {
    S dt, gravity[3], mass_floor;
    S touching;  // share of the volume from which on a node touches fully
    S friction;
    const S* friction_law;  // null: Coulomb's

    // The velocity after a substep but for contact, and the volume around that touches the ground. before: the velocity,
    // its fourth number zero; push: dt times the forces, and that volume.
    template <class Node>
    Node free(const Node& before, const Node& push, const Around<S>& around) const {
        if (!(around.mass > mass_floor)) return Node{};
        return before + Node{push[0] / around.mass + dt * gravity[0], push[1] / around.mass + dt * gravity[1],
                             push[2] / around.mass + dt * gravity[2], push[3]};
    }

    // The velocity after contact; its fourth number is zero.
    template <class Node>
    Node velocity(const Node& free, const Around<S>& around) const {
        const S lost = contact(free, around) * -free[2];
        if (!(lost > 0)) return Node{free[0], free[1], free[2], 0};
        const S speed = length(free[0], free[1]), slower = friction_at(speed).value * lost;
        const S kept = speed > slower ? 1 - slower / speed : S(0);
        return Node{kept * free[0], kept * free[1], free[2] + lost, 0};
    }

    // Of what a velocity follows from.
    template <class Node>
    struct Adjoint {
        Node free;  // that of the velocity before, too, and 1 / mass of it that of the forces times dt; fourth: touching
        S mass;
    };

    // From the adjoint of the velocity; friction_bar grows.
    template <class Node>
    Adjoint<Node> adjoint(const Node& before, const Node& free, const Around<S>& around, Node b,
                          FrictionBar<S>& friction_bar) const {
        if (!(around.mass > mass_floor)) return {};
        const S touch = contact(free, around), lost = touch * -free[2];
        b[3] = 0;
        if (lost > 0) {
            const S speed = length(free[0], free[1]);
            const Friction<S> mu = friction_at(speed);
            const S slower = mu.value * lost;
            S lost_bar = b[2];
            if (speed > slower) {
                const S tx = free[0] / speed, ty = free[1] / speed, along = b[0] * tx + b[1] * ty;
                const S ratio = slower / speed, faster = -lost * along * mu.by_speed;  // the more it loses
                friction_bar.add(mu, -lost * along);
                lost_bar -= mu.value * along;
                b[0] += faster * tx - ratio * (b[0] - along * tx);
                b[1] += faster * ty - ratio * (b[1] - along * ty);
            } else {
                b[0] = b[1] = 0;
            }
            b[2] -= touch * lost_bar;
            if (touch < 1) b[3] = -free[2] * lost_bar / (touching * around.volume);
        }
        S mass_bar = 0;
        for (int d = 0; d < 3; d++) mass_bar -= b[d] * (free[d] - before[d] - dt * gravity[d]) / around.mass;
        return {b, mass_bar};
    }

private:
    // How fully a node touches the ground, if it comes down.
    template <class Node>
    S contact(const Node& free, const Around<S>& around) const {
        if (!(free[3] > 0 && free[2] < 0)) return 0;
        const S limit = touching * around.volume;
        return free[3] < limit ? free[3] / limit : S(1);
    }
    Friction<S> friction_at(S speed) const {
        return friction_law ? Friction<S>(friction, friction_law, speed) : Friction<S>(friction);
    }
    static S length(S x, S y) { return sqrt(x * x + y * y); }
};

}  // namespace physreal
