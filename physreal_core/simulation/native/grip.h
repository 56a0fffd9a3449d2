// Grip phase: forces of the bonds between controller points and particles, and their adjoint (plain/grip.py).
#pragma once
#include "frame.h"

namespace physreal {

// One bond at one substep: distance and relative velocity from a controller point that moves linearly through the
// frame.
template <class S>
struct Bond {
    S direction[3], relative[3], length, rate, strain, weight, rest_length;

    Bond(const Frame<S>& frame, Index e, S time, const S* state, Index place) {
        const S* from = frame.controllers + 3 * frame.grip_controller[e];
        const S* to = from + 3 * frame.controller_points;
        S r[3], square = frame.grip_softening;
        for (int d = 0; d < 3; d++) {
            S travel = to[d] - from[d];
            r[d] = state[d * frame.stride + place] - from[d] - time * travel;
            relative[d] = state[(3 + d) * frame.stride + place] - travel * frame.frame_rate;
            square += r[d] * r[d];
        }
        length = __builtin_sqrt(square);
        rate = 0;
        for (int d = 0; d < 3; d++) {
            direction[d] = r[d] / length;
            rate += relative[d] * direction[d];
        }
        weight = frame.grip_weight[e];
        rest_length = frame.grip_rest_length[e];
        strain = length / rest_length - 1;
    }

    S pull(const Frame<S>& frame) const { return weight * (frame.grip_stiffness * strain + frame.grip_damping * rate); }
};

// Calls visit(particle's place, first bond, last bond) for the gripped particles with first <= place < last.
template <class S, class Visit>
inline void for_gripped(const Frame<S>& frame, Index first, Index last, Visit visit) {
    for (Index q = 0; q < frame.gripped; q++) {
        Index place = frame.place[frame.grip_particle[q]];
        if (place >= first && place < last) visit(place, frame.grip_first[q], frame.grip_first[q + 1]);
    }
}

// Writes `before`, rows of the other forces, + grip of the gripped particles among the places [first, last) into
// frame.force.
template <class S>
void grip_forces(const Frame<S>& frame, Index substep, const S* state, const S* before, Index first, Index last) {
    S time = S(substep) * frame.share;
    for_gripped(frame, first, last, [&](Index place, Index bond, Index end) {
        S force[3];
        for (int d = 0; d < 3; d++) force[d] = before[d * frame.stride + place];
        for (; bond < end; bond++) {
            Bond<S> b(frame, bond, time, state, place);
            for (int d = 0; d < 3; d++) force[d] -= b.pull(frame) * b.direction[d];
        }
        for (int d = 0; d < 3; d++) frame.force[d * frame.stride + place] = force[d];
    });
}

// Adds to the adjoints of x and v, to the thread's sums, and to its controllers_bar [2, points, 3]. Without optional
// terms v_bar = m q_bar on entry, of which the force's adjoint is dt q_bar; with them that stands in frame.force_bar.
template <bool TERMS, class S>
void grip_forces_adjoint(const Frame<S>& frame, Index substep, const S* state, const S* mass, Index first, Index last,
                         S* sums, S* controllers_bar) {
    S time = S(substep) * frame.share;
    for_gripped(frame, first, last, [&](Index place, Index bond, Index end) {
        S* bar = frame.adjoint + place;
        S force_bar[3], x_sum[3] = {}, v_sum[3] = {};
        for (int d = 0; d < 3; d++)
            force_bar[d] = TERMS ? frame.force_bar[d * frame.stride + place]
                                 : frame.dt / mass[place] * bar[(3 + d) * frame.stride];
        for (; bond < end; bond++) {
            Bond<S> b(frame, bond, time, state, place);
            S along = 0, turning = 0, d_bar[3];
            for (int d = 0; d < 3; d++) along += force_bar[d] * b.direction[d];
            S damping = b.weight * frame.grip_damping * along;
            // f = -pull d, with pull and d both functions of the distance
            for (int d = 0; d < 3; d++) {
                d_bar[d] = -b.pull(frame) * force_bar[d] - damping * b.relative[d];
                turning += d_bar[d] * b.direction[d];
            }
            S* from_bar = controllers_bar + 3 * frame.grip_controller[bond];
            S* to_bar = from_bar + 3 * frame.controller_points;
            for (int d = 0; d < 3; d++) {
                x_sum[d] += (d_bar[d] - turning * b.direction[d]) / b.length;
                x_sum[d] -= b.weight * frame.grip_stiffness * along / b.rest_length * b.direction[d];
                v_sum[d] -= damping * b.direction[d];
            }
            S stretching = turning / b.length + b.weight * frame.grip_stiffness * along / b.rest_length;
            for (int d = 0; d < 3; d++) {
                // a bond knows x - from - time (to - from) and v - frame_rate (to - from) only
                S x_bar = d_bar[d] / b.length - stretching * b.direction[d];
                S travel_bar = frame.frame_rate * damping * b.direction[d] - time * x_bar;
                from_bar[d] -= x_bar + travel_bar;
                to_bar[d] += travel_bar;
            }
            sums[STIFFNESS_SUM] -= b.weight * b.strain * along;
            sums[DAMPING_SUM] -= b.weight * b.rate * along;
        }
        for (int d = 0; d < 3; d++) {
            bar[d * frame.stride] += x_sum[d];
            bar[(3 + d) * frame.stride] += v_sum[d];
        }
    });
}

}  // namespace physreal
