// Node phase: momentum to velocity, gravity, clamps, Coulomb contact with the ground, and its adjoint (plain/grid.py).
#pragma once
#include "frame.h"
#include "term_laws/friction.h"
#include "transfers.h"

namespace physreal {

enum NodeKind : unsigned char { FREE, HELD, GROUND, NEXT_TO_GROUND };

template <class S>
NodeKind kind_of_node(const Frame<S>& frame, Index i, Index j, Index k) {
    const Index index[3] = {i, j, k};
    for (Index c = 0; c < frame.clamps; c++) {
        bool held = true;
        for (int d = 0; d < 3; d++) {
            S position = frame.offset[d] + frame.cell * S(index[d]);
            held &= position >= frame.clamp_lower[3 * c + d] && position <= frame.clamp_upper[3 * c + d];
        }
        if (held) return HELD;
    }
    if (!frame.has_ground || k > 1) return FREE;
    if (k < 1) return GROUND;
    return k > frame.origin[2] ? NEXT_TO_GROUND : FREE;  // a box that begins here has nothing below
}

template <class S>
void mark_nodes(const Frame<S>& frame, Index first, Index last) {
    for (Index n = first; n < last; n++) {
        Index k = n % frame.count[2], j = n / frame.count[2] % frame.count[1],
              i = n / (frame.count[1] * frame.count[2]);
        frame.kind[n] = kind_of_node(frame, i + frame.origin[0], j + frame.origin[1], k + frame.origin[2]);
    }
}

// Kind of a node in a substep: one next to the plane acts where the body touches it, see touch.py. `below` gives the (momentum,
// mass) of the node below.
template <class S, class Below>
inline unsigned char kind_now(const Frame<S>& frame, Index n, Node<S> p, const Below& below) {
    if (frame.kind[n] != NEXT_TO_GROUND) return frame.kind[n];
    return below(n - 1)[3] > frame.touching * p[3] ? GROUND : FREE;
}

template <class S>
inline S length_of(S x, S y) {
    return __builtin_sqrt(x * x + y * y);
}

// Friction of a node that slides with this speed.
template <class S>
inline Friction<S> friction_at(const Frame<S>& frame, S speed) {
    if (!(frame.terms & FRICTION_LAW)) return Friction<S>(frame.friction);
    return Friction<S>(frame.friction, frame.term_numbers + FRICTION_SHAPE, speed);
}

// Velocity of a node from its (momentum, mass); the fourth number is zero.
template <class S>
inline Node<S> node_velocity(const Frame<S>& frame, Node<S> p, unsigned char kind) {
    if (!(p[3] > frame.mass_floor) || kind == HELD) return Node<S>{};
    Node<S> v = p / p[3];
    for (int d = 0; d < 3; d++) v[d] += frame.dt * frame.gravity[d];
    v[3] = 0;
    if (kind == GROUND && v[2] < 0) {
        S speed = length_of(v[0], v[1]), lost = -friction_at(frame, speed).value * v[2];
        S kept = speed > lost ? 1 - lost / speed : S(0);
        v = Node<S>{kept * v[0], kept * v[1], 0, 0};
    }
    return v;
}

// Adjoint of a node's (momentum, mass) from that of its velocity; friction_bar grows.
template <class S>
inline Node<S> node_adjoint(const Frame<S>& frame, Node<S> p, unsigned char kind, Node<S> b,
                            FrictionBar<S>& friction_bar) {
    if (!(p[3] > frame.mass_floor) || kind == HELD) return Node<S>{};
    Node<S> free = p / p[3], v = free;
    for (int d = 0; d < 3; d++) v[d] += frame.dt * frame.gravity[d];
    if (kind == GROUND && v[2] < 0) {
        S speed = length_of(v[0], v[1]);
        Friction<S> friction = friction_at(frame, speed);
        S lost = -friction.value * v[2];
        if (speed > lost) {
            S tx = v[0] / speed, ty = v[1] / speed, along = b[0] * tx + b[1] * ty, ratio = lost / speed;
            S faster = v[2] * along * friction.by_speed;  // the more it loses
            friction_bar.add(friction, v[2] * along);
            b = Node<S>{b[0] - ratio * (b[0] - along * tx) + faster * tx,
                        b[1] - ratio * (b[1] - along * ty) + faster * ty, friction.value * along, 0};
        } else {
            b = Node<S>{};
        }
    }
    b[3] = -(b[0] * free[0] + b[1] * free[1] + b[2] * free[2]);
    return b / p[3];
}

// Sum of the threads' grids at a node.
template <class S>
inline Node<S> summed(const Frame<S>& frame, Index nodes, Index n) {
    Node<S> p = read<Node<S>>(frame.scratch + 4 * n);
    for (Index t = 1; t < frame.threads; t++) p += read<Node<S>>(frame.scratch + 4 * (t * (nodes + 4) + n));
    return p;
}

}  // namespace physreal
