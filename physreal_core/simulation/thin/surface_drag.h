// Drag of the surroundings on a thin body by area and normal (term `surface_drag`): slender-body and flat-plate drag with one coefficient,
// c = rho C_d / 2 of the speed across the surface. Plain torch: `shell_drag` and `rod_drag` in reference.py.
//
// `SurfaceDrag<V, FACE>` has ROWS coefficients of an element, FACE vertices of which lie in it (elements.h):
//     `forces(c, x, v, f)`                               adds to the forces f,
//     `adjoint(c, x, v, f_bar, x_bar, v_bar, c_bar)`     adds to the adjoints of x, v and c.
#pragma once
#include "elements.h"

namespace physreal {

template <class V, int FACE>
struct SurfaceDrag;

// A triangle with N = 2 A n and the mean velocity v of its corners feels -(c / 2) |u| u N / |N|^2, u = v . N: that is -c A (v . n)^2 along n.
template <class V>
struct SurfaceDrag<V, 3> {
    static constexpr int ROWS = 1;

    template <int CORNERS>
    static void forces(const V (&c)[ROWS], const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS], Vec3<V> (&f)[CORNERS]) {
        const Vec3<V> N = cross(x[1] - x[0], x[2] - x[0]);
        const V u = dot(third() * (v[0] + v[1] + v[2]), N);
        const V size = S(0.5) * c[0] * abs(u) * u / dot(N, N);
        const Vec3<V> share = -(third() * size) * N;
        for (int i = 0; i < 3; ++i) f[i] = f[i] + share;
    }

    // Of b . f with b the mean adjoint of the corners: -(c / 2) |u| u w / |N|^2, w = b . N.
    template <int CORNERS>
    static void adjoint(const V (&c)[ROWS], const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS],
                        const Vec3<V> (&f_bar)[CORNERS], Vec3<V> (&x_bar)[CORNERS], Vec3<V> (&v_bar)[CORNERS],
                        V (&c_bar)[ROWS]) {
        const Vec3<V> first = x[1] - x[0], second = x[2] - x[0], N = cross(first, second);
        const Vec3<V> mean = third() * (v[0] + v[1] + v[2]), b = third() * (f_bar[0] + f_bar[1] + f_bar[2]);
        const V u = dot(mean, N), w = dot(b, N), per_square = S(1) / dot(N, N), size = S(0.5) * abs(u) * per_square;
        const V by_u = S(-2) * c[0] * size * w, by_w = -(c[0] * size * u), by_square = c[0] * size * u * w * per_square;
        const Vec3<V> N_bar = by_u * mean + by_w * b + (S(2) * by_square) * N;
        const Vec3<V> first_bar = cross(second, N_bar), second_bar = cross(N_bar, first);
        x_bar[0] = x_bar[0] - (first_bar + second_bar);
        x_bar[1] = x_bar[1] + first_bar;
        x_bar[2] = x_bar[2] + second_bar;
        for (int i = 0; i < 3; ++i) v_bar[i] = v_bar[i] + (third() * by_u) * N;
        c_bar[0] -= size * u * w;
    }

private:
    using S = Scalar<V>;
    static V third() { return splat<V>(S(1) / S(3)); }
};

// Each of two segments with the tangent t and the mean velocity v of its ends feels -k |p| p, p = v - (v . t) t; k = c d l of the part of it
// that falls to this element.
template <class V>
struct SurfaceDrag<V, 2> {
    static constexpr int ROWS = 2;

    template <int CORNERS>
    static void forces(const V (&k)[ROWS], const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS], Vec3<V> (&f)[CORNERS]) {
        for (int i = 0; i < ROWS; ++i) {
            const Across now(x[i + 1] - x[i], half() * (v[i] + v[i + 1]));
            const Vec3<V> share = -(half() * k[i] * now.speed) * now.part;
            f[i] = f[i] + share;
            f[i + 1] = f[i + 1] + share;
        }
    }

    template <int CORNERS>
    static void adjoint(const V (&k)[ROWS], const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS],
                        const Vec3<V> (&f_bar)[CORNERS], Vec3<V> (&x_bar)[CORNERS], Vec3<V> (&v_bar)[CORNERS],
                        V (&k_bar)[ROWS]) {
        for (int i = 0; i < ROWS; ++i) {
            const Vec3<V> velocity = half() * (v[i] + v[i + 1]), b = half() * (f_bar[i] + f_bar[i + 1]);
            const Across now(x[i + 1] - x[i], velocity);
            const V along = dot(now.part, b);
            const V turning = select(now.speed > S(0), along / now.speed, V{});
            const Vec3<V> part_bar = -k[i] * (now.speed * b + turning * now.part);
            const V sliding = dot(part_bar, now.tangent), forward = dot(velocity, now.tangent);
            const Vec3<V> velocity_bar = part_bar - sliding * now.tangent;
            const Vec3<V> tangent_bar = -forward * part_bar - sliding * velocity;
            const Vec3<V> way_bar = (S(1) / now.length) * (tangent_bar - dot(tangent_bar, now.tangent) * now.tangent);
            x_bar[i] = x_bar[i] - way_bar;
            x_bar[i + 1] = x_bar[i + 1] + way_bar;
            for (int end = i; end < i + 2; ++end) v_bar[end] = v_bar[end] + half() * velocity_bar;
            k_bar[i] -= now.speed * along;
        }
    }

private:
    using S = Scalar<V>;
    static V half() { return splat<V>(S(0.5)); }
    // The part of a velocity across a segment.
    struct Across {
        V length, speed;
        Vec3<V> tangent, part;
        Across(const Vec3<V>& way, const Vec3<V>& velocity) : length(sqrt(dot(way, way))) {
            tangent = (S(1) / length) * way;
            part = velocity - dot(velocity, tangent) * tangent;
            speed = sqrt(dot(part, part));
        }
    };
};

}  // namespace physreal
