// A tool or a hand that pushes: capsules whose ends are controller points, with Coulomb friction, and the adjoint.
//
// With q the point of a capsule's middle line that is nearest to a particle at x, r = x - q, n = r / |r|, u = v - dq/dt at that point of the
// capsule, and the depth d = radius + reach - |r| > 0, reach half the particle's size:
//     N = m k d ,   f = N n - mu N u_t / sqrt(|u_t|^2 + slow^2) ,   u_t = u - (u . n) n .
// Friction that holds lets a particle creep by a share of `slow`. Controller points move as grip.h says.
#pragma once
#include "dual.h"
#include "grip.h"

namespace physreal {

template <class S>
struct Tool {
    const int* ends;  // [capsules, 2] controller points
    const S* radius;  // [capsules]
    Index count;
    const S* points;  // [4, point_count, 3], see Grip
    Index point_count;
    S stiffness, friction;  // k [1/s2], mu
    S time, frame_rate;

    // f grows by the push on particles (V: one or many) of mass m at x with velocity v.
    template <class V>
    Vec3<V> force(const Vec3<V>& x, const Vec3<V>& v, V m, V reach, Vec3<V> f) const {
        const PathWeights<S> path(time, frame_rate);
        for (Index c = 0; c < count; c++) {
            const Capsule<V> own(*this, path, c);
            const Push<V> push(x, v, own, reach);
            if (!any(push.depth > S(0))) continue;
            f = f + (m * splat<V>(stiffness) * push.depth) * push.along(splat<V>(friction));
        }
        return f;
    }

    template <class V>
    struct Adjoint {
        Vec3<V> x, v;
        V mass, stiffness, friction;
    };

    // add(which of the four places, controller, axis, values to be summed) takes the adjoints of the controller points.
    template <class V, class Add>
    Adjoint<V> adjoint(const Vec3<V>& x, const Vec3<V>& v, V m, V reach, const Vec3<V>& f_bar, Add add) const {
        Adjoint<V> out = {};
        const PathWeights<S> path(time, frame_rate);
        for (Index c = 0; c < count; c++) {
            const Capsule<V> own(*this, path, c);
            const Push<V> push(x, v, own, reach);
            if (!any(push.depth > S(0))) continue;
            const V work = push.depth * dot(f_bar, push.along(splat<V>(friction)));
            out.mass += splat<V>(stiffness) * work;
            out.stiffness += m * work;
            out.friction += splat<V>(stiffness) * m * push.depth * dot(f_bar, push.rubbing);
            const V weight = splat<V>(stiffness) * m;
            out.x = out.x + slope(x, v, own, reach, f_bar, weight, 0, [](auto& in) -> auto& { return in.x; });
            out.v = out.v + slope(x, v, own, reach, f_bar, weight, 0, [](auto& in) -> auto& { return in.v; });
            for (int end = 0; end < 2; end++) {
                const Vec3<V> at = slope(x, v, own, reach, f_bar, weight, end, [](auto& in) -> auto& { return in.place; });
                const Vec3<V> by = slope(x, v, own, reach, f_bar, weight, end, [](auto& in) -> auto& { return in.speed; });
                for (int i = 0; i < 4; i++)
                    for (int d = 0; d < 3; d++)
                        add(i, ends[2 * c + end], d, path.place[i] * at[d] + path.velocity[i] * by[d]);
            }
        }
        return out;
    }

private:
    static constexpr S SLOW = S(5e-3);        // m/s
    static constexpr S SOFTENING = S(1e-12);  // m2, of the distance from the middle line

    template <class T>
    struct Capsule {
        Vec3<T> place[2], speed[2];
        T radius;

        Capsule() = default;
        Capsule(const Tool& tool, const PathWeights<S>& path, Index c) : radius(splat<T>(tool.radius[c])) {
            for (int end = 0; end < 2; end++)
                for (int d = 0; d < 3; d++) {
                    // the weights of places sum to one, those of velocities to zero
                    const S* own = tool.points + 3 * tool.ends[2 * c + end] + d;
                    const S from = own[3 * tool.point_count];
                    S at = from, by = 0;
                    for (int i = 0; i < 4; i++) {
                        const S off = own[3 * i * tool.point_count] - from;
                        at += path.place[i] * off;
                        by += path.velocity[i] * off;
                    }
                    place[end][d] = splat<T>(at);
                    speed[end][d] = splat<T>(by);
                }
        }
    };

    // T: V or Dual<V>.
    template <class T>
    struct Push {
        Vec3<T> outwards, rubbing;
        T depth;

        Push(const Vec3<T>& x, const Vec3<T>& v, const Capsule<T>& c, const T& reach) {
            const T zero = splat<T>(0), one = splat<T>(1);
            const Vec3<T> axis = c.place[1] - c.place[0], arm = x - c.place[0];
            const T free = dot(arm, axis) / (dot(axis, axis) + splat<T>(SOFTENING));
            T share = select(free > zero, free, zero);
            share = select(share < one, share, one);
            const Vec3<T> from = arm - share * axis;
            const T length = sqrt(dot(from, from) + splat<T>(SOFTENING));
            outwards = (one / length) * from;
            const T inside = c.radius + reach - length;
            depth = select(inside > zero, inside, zero);
            const Vec3<T> u = v - c.speed[0] - share * (c.speed[1] - c.speed[0]);
            const Vec3<T> across = u - dot(u, outwards) * outwards;
            rubbing = (splat<T>(-1) / sqrt(dot(across, across) + splat<T>(SLOW * SLOW))) * across;
        }
        // The push over N.
        Vec3<T> along(const T& friction) const { return outwards + friction * rubbing; }
    };

    template <class T>
    struct Inputs {
        Vec3<T> x, v, place, speed;
    };

    // The adjoint of the three numbers that `which` chooses of what a push depends on, for a capsule's end.
    template <class V, class Which>
    Vec3<V> slope(const Vec3<V>& x, const Vec3<V>& v, const Capsule<V>& c, V reach, const Vec3<V>& f_bar, V weight, int end,
                  Which which) const {
        using T = Dual<V>;
        Vec3<V> found;
        for (int axis = 0; axis < 3; axis++) {
            Inputs<T> in;
            Capsule<T> capsule;
            capsule.radius = {c.radius, V{}};
            for (int d = 0; d < 3; d++) {
                in.x[d] = {x[d], V{}};
                in.v[d] = {v[d], V{}};
                in.place[d] = {c.place[end][d], V{}};
                in.speed[d] = {c.speed[end][d], V{}};
                capsule.place[1 - end][d] = {c.place[1 - end][d], V{}};
                capsule.speed[1 - end][d] = {c.speed[1 - end][d], V{}};
            }
            which(in)[axis].slope = splat<V>(1);
            capsule.place[end] = in.place;
            capsule.speed[end] = in.speed;
            const Push<T> push(in.x, in.v, capsule, T(reach, V{}));
            const Vec3<T> f = push.depth * push.along(T(friction));
            found[axis] = weight * (f_bar[0] * f[0].slope + f_bar[1] * f[1].slope + f_bar[2] * f[2].slope);
        }
        return found;
    }
};

}  // namespace physreal
