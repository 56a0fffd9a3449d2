// Grip phase (paper, eq. interaction_force, and a dashpot along the same line): forces of the bonds between controller
// points and a particle, and their adjoint.
//
// Per bond of particle x and controller point a, with r = x - a, l = |r|, d = r / l:
//     f = -w (k_f (l / l0 - 1) + c_f (v - da/dt) . d) d
// Controller points move linearly through a frame.
#pragma once
#include "matrix.h"

namespace physreal {

template <class S>
struct Grip {
    const int* controller;          // [bonds]
    const S *weight, *rest_length;  // [bonds]
    const S* points;                // [2, point_count, 3] at both ends of the frame
    Index point_count;
    S stiffness, damping, softening;  // softening [m2] of the distance
    S time, frame_rate;               // time: since the frame's start, in frames

    Vec3<S> force(Index first, Index last, const Vec3<S>& x, const Vec3<S>& v, Vec3<S> f) const {
        for (Index e = first; e < last; e++) {
            const Bond b(*this, e, x, v);
            f = f - b.pull * b.direction;
        }
        return f;
    }

    // Of position, velocity, stiffness and damping.
    struct Adjoint {
        Vec3<S> x, v;
        S stiffness, damping;
    };

    // add(end of the frame, controller, axis, value) takes the adjoints of the controller points.
    template <class Add>
    Adjoint adjoint(Index first, Index last, const Vec3<S>& x, const Vec3<S>& v, const Vec3<S>& f_bar, Add add) const {
        Adjoint out = {};
        for (Index e = first; e < last; e++) {
            const Bond b(*this, e, x, v);
            const S along = dot(f_bar, b.direction), friction = b.weight * damping * along;
            // f = -pull d, with pull and d both functions of the distance
            const Vec3<S> d_bar = (-b.pull) * f_bar - friction * b.relative;
            const S stretching = dot(d_bar, b.direction) / b.length + b.weight * stiffness * along / b.rest_length;
            const Vec3<S> x_bar = (1 / b.length) * d_bar - stretching * b.direction, v_bar = (-friction) * b.direction;
            for (int d = 0; d < 3; d++) {
                // a bond knows x - from - time (to - from) and v - frame_rate (to - from) only
                const S travel_bar = -time * x_bar[d] - frame_rate * v_bar[d];
                add(0, controller[e], d, -x_bar[d] - travel_bar);
                add(1, controller[e], d, travel_bar);
            }
            out.x = out.x + x_bar;
            out.v = out.v + v_bar;
            out.stiffness -= b.weight * b.strain * along;
            out.damping -= b.weight * b.rate * along;
        }
        return out;
    }

private:
    struct Bond {
        Vec3<S> direction, relative;
        S length, rate, strain, weight, rest_length, pull;

        Bond(const Grip& grip, Index e, const Vec3<S>& x, const Vec3<S>& v)
            : weight(grip.weight[e]), rest_length(grip.rest_length[e]) {
            const S* from = grip.points + 3 * grip.controller[e];
            const S* to = from + 3 * grip.point_count;
            Vec3<S> r;
            for (int d = 0; d < 3; d++) {
                const S travel = to[d] - from[d];
                r[d] = x[d] - from[d] - grip.time * travel;
                relative[d] = v[d] - travel * grip.frame_rate;
            }
            length = sqrt(dot(r, r) + grip.softening);
            direction = (1 / length) * r;
            rate = dot(relative, direction);
            strain = length / rest_length - 1;
            pull = weight * (grip.stiffness * strain + grip.damping * rate);
        }
    };
};

}  // namespace physreal
