// Adhesion to the ground: f_z = -a e (u / d) exp(-u / d) for u > 0, the height above where the particle started.
#pragma once
#include "term.h"

namespace physreal {

struct Adhesion {
    static constexpr Index TERM = term::adhesion;

    template <class At>
    static auto force(const At& at) {
        auto x = at.x();
        using V = decltype(x[2] + x[2]);
        const V u = max((x[2] - at.value(row::start_height)) / at.number(number::adhesion_range), V{});
        const V pull = at.value(row::adhesion) * u * exp(Scalar<V>(1) - u);
        return Vec3<V>{{V{}, V{}, -pull}};
    }

    template <class At, class V>
    static void adjoint(At& at, const Vec3<V>& f_bar) {
        using S = Scalar<V>;
        const S range = at.number(number::adhesion_range);
        const V height = at.x()[2] - at.value(row::start_height), peak = at.value(row::adhesion);
        const V u = max(height / range, V{}), fade = exp(S(1) - u);
        const V u_bar = select(height > S(0), -(peak * (S(1) - u) * fade * f_bar[2]), V{});
        at.add_x(Vec3<V>{{V{}, V{}, u_bar / range}});
        at.add(row::start_height, -(u_bar / range));
        at.add(row::adhesion, -(u * fade * f_bar[2]));
        at.add_number(number::adhesion_range, -(u * u_bar / range));
    }
};

}  // namespace physreal
