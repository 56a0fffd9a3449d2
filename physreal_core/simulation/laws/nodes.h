// Node phase: momentum to velocity, gravity, clamps, Coulomb contact with the ground, and its adjoint.
//
// Contact acts, after all forces, on the nodes of the lattice layer k = 0 and below, and on those next to the plane, k
// = 1, where the body touches it (touch.py). With v the free velocity of such a node and v_z < 0, the plane takes out
// the normal impulse m |v_z|, the tangential velocity loses at most mu |v_z| and sticks where that is more than it has.
// Nodes that leave the plane (v_z >= 0) are free.
#pragma once
#include "friction.h"

namespace physreal {

enum NodeKind : unsigned char { FREE, HELD, GROUND, NEXT_TO_GROUND };

// What holds nodes, by their place: node (i, j, k) of the lattice stands at offset + cell (i, j, k).
template <class S>
struct Scene {
    S offset[3], cell;
    Index clamps, has_ground;
    const S *clamp_lower, *clamp_upper;  // [clamps, 3]

    // lowest: k of the box's first layer.
    NodeKind kind_of(Index i, Index j, Index k, Index lowest) const {
        const Index index[3] = {i, j, k};
        for (Index c = 0; c < clamps; c++) {
            bool held = true;
            for (int d = 0; d < 3; d++) {
                const S position = offset[d] + cell * S(index[d]);
                held &= position >= clamp_lower[3 * c + d] && position <= clamp_upper[3 * c + d];
            }
            if (held) return HELD;
        }
        if (!has_ground || k > 1) return FREE;
        if (k < 1) return GROUND;
        return k > lowest ? NEXT_TO_GROUND : FREE;  // a box that begins here has nothing below
    }
};

// What a node's velocity follows from beside its (momentum, mass). `Node` is any type of four S: a vector of lanes, or
// Vec4.
template <class S>
struct NodePhase {
    S dt, gravity[3], mass_floor, touching;
    S friction;
    const S* friction_law;  // null: Coulomb's

    // Kind in a substep: a node next to the plane acts where the body touches it. mass_below: of the node below.
    template <class Below>
    unsigned char kind_now(unsigned char kind, S mass, const Below& mass_below) const {
        if (kind != NEXT_TO_GROUND) return kind;
        return mass_below() > touching * mass ? GROUND : FREE;
    }

    // The fourth number is zero.
    template <class Node>
    Node velocity(const Node& p, unsigned char kind) const {
        if (!(p[3] > mass_floor) || kind == HELD) return Node{};
        Node v = free_velocity(p);
        if (kind == GROUND && v[2] < 0) {
            const S speed = length(v[0], v[1]), lost = -friction_at(speed).value * v[2];
            const S kept = speed > lost ? 1 - lost / speed : S(0);
            v = Node{kept * v[0], kept * v[1], 0, 0};
        }
        return v;
    }

    // Adjoint of (momentum, mass) from that of the velocity; friction_bar grows.
    template <class Node>
    Node adjoint(const Node& p, unsigned char kind, Node b, FrictionBar<S>& friction_bar) const {
        if (!(p[3] > mass_floor) || kind == HELD) return Node{};
        const Node free = p / p[3], v = free_velocity(p);
        if (kind == GROUND && v[2] < 0) {
            const S speed = length(v[0], v[1]);
            const Friction<S> mu = friction_at(speed);
            const S lost = -mu.value * v[2];
            if (speed > lost) {
                const S tx = v[0] / speed, ty = v[1] / speed, along = b[0] * tx + b[1] * ty, ratio = lost / speed;
                const S faster = v[2] * along * mu.by_speed;  // the more it loses
                friction_bar.add(mu, v[2] * along);
                b = Node{b[0] - ratio * (b[0] - along * tx) + faster * tx,
                         b[1] - ratio * (b[1] - along * ty) + faster * ty, mu.value * along, 0};
            } else {
                b = Node{};
            }
        }
        b[3] = -(b[0] * free[0] + b[1] * free[1] + b[2] * free[2]);
        return b / p[3];
    }

private:
    template <class Node>
    Node free_velocity(const Node& p) const {
        Node v = p / p[3];
        for (int d = 0; d < 3; d++) v[d] += dt * gravity[d];
        v[3] = 0;
        return v;
    }
    Friction<S> friction_at(S speed) const {
        return friction_law ? Friction<S>(friction, friction_law, speed) : Friction<S>(friction);
    }
    static S length(S x, S y) { return sqrt(x * x + y * y); }
};

}  // namespace physreal
