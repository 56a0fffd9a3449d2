// Fibres: tau = k / 2 (|F a|^2 - 1) (F a) (F a)^T.
#pragma once
#include "term.h"

namespace physreal {

struct Fibres {
    static constexpr Index TERM = term::fibres;

    template <class At, class V>
    static Mat3<V> stress(const At& at, const Mat3<V>& F) {
        const Vec3<V> g = F * at.vector(row::fibre_direction);
        const V size = Scalar<V>(0.5) * at.value(row::fibre_modulus) * (dot(g, g) - Scalar<V>(1));
        return outer(size * g, g);
    }

    template <class At, class V>
    static void adjoint(At& at, const Mat3<V>& F, const Mat3<V>& tau_bar, Mat3<V>& F_bar) {
        const Vec3<V> direction = at.vector(row::fibre_direction), g = F * direction, pulled = tau_bar * g;
        const V strain = dot(g, g) - Scalar<V>(1), work = dot(g, pulled);
        const Vec3<V> g_bar = at.value(row::fibre_modulus) * (work * g + strain * pulled);
        F_bar += outer(g_bar, direction);
        at.add(row::fibre_modulus, Scalar<V>(0.5) * strain * work);
        at.add(row::fibre_direction, transpose(F) * g_bar);
    }
};

}  // namespace physreal
