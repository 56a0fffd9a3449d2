// Grip phase (paper, eq. interaction_force, and a dashpot along the same line): forces of the bonds between controller
// points and a particle, and their adjoint.
//
// Per bond of particle x and controller point a, with r = x - a, l = |r|, d = r / l:
//     f = -w (k_f (l / l0 - 1) + c_f (v - da/dt) . d) d
// A controller point moves through a frame from a_1 to a_2 along the cubic whose slopes there are (a_2 - a_0) / 2 and
// (a_3 - a_1) / 2 (Catmull and Rom 1974), a_0 and a_3 its places a frame before and after.
#pragma once
#include "matrix.h"

namespace physreal {

// Weights of a controller point's four places in its place and its velocity.
template <class S>
struct PathWeights {
    S place[4], velocity[4];

    // time: since the frame's start, in frames.
    PathWeights(S t, S frame_rate) {
        const S half = S(0.5), rate = half * frame_rate;
        place[0] = half * t * (t * (2 - t) - 1);
        place[1] = half * (t * t * (3 * t - 5) + 2);
        place[2] = half * t * (t * (4 - 3 * t) + 1);
        place[3] = half * t * t * (t - 1);
        velocity[0] = rate * (t * (4 - 3 * t) - 1);
        velocity[1] = rate * t * (9 * t - 10);
        velocity[2] = rate * (t * (8 - 9 * t) + 1);
        velocity[3] = rate * t * (3 * t - 2);
    }
};

template <class S>
struct Grip {
    const int* controller;          // [bonds]
    const S *weight, *rest_length;  // [bonds]
    const S* points;                // [4, point_count, 3] a frame before, at both ends of the frame, a frame after
    Index point_count;
    S stiffness, damping, softening;  // softening [m2] of the distance
    S time, frame_rate;               // time: since the frame's start, in frames

    Vec3<S> force(Index first, Index last, const Vec3<S>& x, const Vec3<S>& v, Vec3<S> f) const {
        const PathWeights<S> path(time, frame_rate);
        for (Index e = first; e < last; e++) {
            const Bond b(*this, path, e, x, v);
            f = f - b.pull * b.direction;
        }
        return f;
    }

    // Of position, velocity, stiffness and damping.
    struct Adjoint {
        Vec3<S> x, v;
        S stiffness, damping;
    };

    // add(which of the four places, controller, axis, value) takes the adjoints of the controller points, add_length(bond, value) those
    // of the rest lengths.
    template <class Add, class AddLength>
    Adjoint adjoint(Index first, Index last, const Vec3<S>& x, const Vec3<S>& v, const Vec3<S>& f_bar, Add add,
                    AddLength add_length) const {
        Adjoint out = {};
        const PathWeights<S> path(time, frame_rate);
        for (Index e = first; e < last; e++) {
            const Bond b(*this, path, e, x, v);
            const S along = dot(f_bar, b.direction), friction = b.weight * damping * along;
            // f = -pull d, with pull and d both functions of the distance
            const Vec3<S> d_bar = (-b.pull) * f_bar - friction * b.relative;
            const S stretching = dot(d_bar, b.direction) / b.length + b.weight * stiffness * along / b.rest_length;
            const Vec3<S> x_bar = (1 / b.length) * d_bar - stretching * b.direction, v_bar = (-friction) * b.direction;
            for (int i = 0; i < 4; i++)
                for (int d = 0; d < 3; d++)
                    add(i, controller[e], d, -path.place[i] * x_bar[d] - path.velocity[i] * v_bar[d]);
            out.x = out.x + x_bar;
            out.v = out.v + v_bar;
            add_length(e, b.weight * stiffness * b.length / (b.rest_length * b.rest_length) * along);
            out.stiffness -= b.weight * b.strain * along;
            out.damping -= b.weight * b.rate * along;
        }
        return out;
    }

private:
    struct Bond {
        Vec3<S> direction, relative;
        S length, rate, strain, weight, rest_length, pull;

        Bond(const Grip& grip, const PathWeights<S>& path, Index e, const Vec3<S>& x, const Vec3<S>& v)
            : weight(grip.weight[e]), rest_length(grip.rest_length[e]) {
            const S* from = grip.points + 3 * (grip.point_count + grip.controller[e]);
            Vec3<S> r;
            for (int d = 0; d < 3; d++) {
                r[d] = x[d] - from[d];
                relative[d] = v[d];
            }
            // the weights of places sum to one, those of velocities to zero
            for (int i = 0; i < 4; i++) {
                const S* to = grip.points + 3 * (i * grip.point_count + grip.controller[e]);
                for (int d = 0; d < 3; d++) {
                    r[d] -= path.place[i] * (to[d] - from[d]);
                    relative[d] -= path.velocity[i] * (to[d] - from[d]);
                }
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
