// Solids that stand still: the push of their surface and its friction.
//
// With phi their signed distance (distance_field.h), g its slope, n = g / |g| and the depth d = reach - phi > 0:
//     f = m k d g - mu N u / sqrt(|u|^2 + slow^2) ,   N = m k d |g| ,   u = v - (v . n) n .
// The push is the slope of the energy m k d^2 / 2. Friction that holds lets a particle creep by a share of `slow`, as a tool's does.
#pragma once
#include "../distance_field.h"
#include "../dual.h"
#include "term.h"

namespace physreal {

struct Solids {
    static constexpr Index TERM = term::solids;

    template <class At>
    static auto force(const At& at) {
        const auto reach = at.value(row::solid_reach);
        using V = decltype(reach + reach);
        const Distance<V> distance = at.solids().at(at.x(), reach);
        if (!any(distance.value < reach)) return Vec3<V>{};
        const V weight = at.mass() * at.number(number::solid_stiffness);
        return weight * push(distance.value, distance.slope, at.v(), V(reach), splat<V>(at.number(number::solid_friction)));
    }

    template <class At, class V>
    static void adjoint(At& at, const Vec3<V>& f_bar) {
        const V reach = at.value(row::solid_reach), mass = at.mass();
        const Distance<V> distance = at.solids().at(at.x(), reach);
        if (!any(distance.value < reach)) return;
        const V stiffness = splat<V>(at.number(number::solid_stiffness)), friction = splat<V>(at.number(number::solid_friction));
        const Vec3<V> v = at.v();
        const V work = dot(f_bar, push(distance.value, distance.slope, v, reach, friction));
        at.add_mass(stiffness * work);
        at.add_number(number::solid_stiffness, mass * work);
        // the adjoint by what `seed` moves
        const auto slope = [&](auto seed) {
            using T = Dual<V>;
            T value(distance.value, V{}), of_reach(reach, V{}), of_friction(friction, V{});
            Vec3<T> g, speed;
            for (int d = 0; d < 3; d++) {
                g[d] = T(distance.slope[d], V{});
                speed[d] = T(v[d], V{});
            }
            seed(value, g, speed, of_reach, of_friction);
            const Vec3<T> f = push(value, g, speed, of_reach, of_friction);
            return mass * stiffness * (f_bar[0] * f[0].slope + f_bar[1] * f[1].slope + f_bar[2] * f[2].slope);
        };
        Vec3<V> x_bar, v_bar;
        for (int axis = 0; axis < 3; axis++) {
            x_bar[axis] = slope([&](auto& value, auto& g, auto&, auto&, auto&) {
                value.slope = distance.slope[axis];
                for (int d = 0; d < 3; d++) g[d].slope = distance.curvature.m[3 * d + axis];
            });
            v_bar[axis] = slope([&](auto&, auto&, auto& speed, auto&, auto&) { speed[axis].slope = splat<V>(1); });
        }
        at.add_x(x_bar);
        at.add_v(v_bar);
        at.add(row::solid_reach, slope([](auto&, auto&, auto&, auto& of_reach, auto&) { of_reach.slope = splat<V>(1); }));
        at.add_number(number::solid_friction,
                      slope([](auto&, auto&, auto&, auto&, auto& of_friction) { of_friction.slope = splat<V>(1); }));
    }

private:
    // The force over m k. T: V or Dual<V>.
    template <class T>
    static Vec3<T> push(const T& distance, const Vec3<T>& g, const Vec3<T>& v, const T& reach, const T& friction) {
        using S = Scalar<T>;
        constexpr S SLOW = S(5e-3);       // m/s
        constexpr S SOFTENING = S(1e-6);  // of the slope: where surfaces on two sides are as near there is no direction
        const T zero = splat<T>(0), inside = reach - distance, depth = select(inside > zero, inside, zero);
        const T steep = sqrt(dot(g, g) + splat<T>(SOFTENING * SOFTENING));
        const Vec3<T> n = (splat<T>(1) / steep) * g, u = v - dot(v, n) * n;
        const T rubbing = friction * steep / sqrt(dot(u, u) + splat<T>(SLOW * SLOW));
        return depth * (g - rubbing * u);
    }
};

}  // namespace physreal
