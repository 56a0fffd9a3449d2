// Drag: f = -(c1 + c2 |v|) v. Its source stands beside the twin in terms_reference.py, as that of every optional law.
#pragma once
#include "term.h"

namespace physreal {

struct Drag {
    static constexpr Index TERM = term::drag;

    template <class At>
    static auto force(const At& at) {
        const auto v = at.v();
        return -(at.value(row::linear_drag) + at.value(row::quadratic_drag) * sqrt(dot(v, v))) * v;
    }

    template <class At, class V>
    static void adjoint(At& at, const Vec3<V>& f_bar) {
        const Vec3<V> v = at.v();
        const V linear = at.value(row::linear_drag), quadratic = at.value(row::quadratic_drag);
        const V speed = sqrt(dot(v, v)), along = dot(v, f_bar);
        const V turning = select(speed > Scalar<V>(0), quadratic * along / speed, V{});
        at.add_v(-(linear + quadratic * speed) * f_bar - turning * v);
        at.add(row::linear_drag, -along);
        at.add(row::quadratic_drag, -(speed * along));
    }
};

}  // namespace physreal
