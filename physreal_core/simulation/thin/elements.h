// What shells and rods share: what an element of a thin body is.
//
// An element is a class with FACE vertices of its own and CORNERS with those of neighbours, CONSTANTS numbers of its shape without stress
// and STIFFNESS numbers in which its energy is linear. `Element<T, V>(x, constants)` is one at positions x, T either V or Dual<V>. Of one whose
// energy is a square of STRAINS strains:
//     `strains(e)`                                 writes its strains e,
//     `pull(s, f)`                                 subtracts B^T s from f, B the derivative of e by x,
//     `stress(stiffness, e, s)`                    writes s = S e, the energy's derivative by e,
//     `stiffness_adjoint(e, e_bar, bar)`           subtracts the derivative of e_bar S e by the stiffness from bar;
// of one that does not say its strains, and has no viscosity:
//     `forces(stiffness, f)`                       subtracts the energy's derivative by x from f,
//     `stiffness_adjoint(bar)`                     with the slope of x the adjoint of f: adds that of the stiffness to bar.
// Of framed rods, whose elements have FRAMES directors, see `FramedRodForces` (framedrod.h).
#pragma once
#include "vectors.h"

namespace physreal {

// Whether an element says its strains; one that does not has no viscosity.
template <class E, class = void>
struct HasStrains {
    static constexpr bool value = false;
};
template <class E>
struct HasStrains<E, decltype(void(E::STRAINS))> {
    static constexpr bool value = true;
};

// Positions with a slope along v.
template <int CORNERS, class V>
inline void move_along(const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS], Vec3<Dual<V>> (&moving)[CORNERS]) {
    for (int c = 0; c < CORNERS; ++c)
        for (int d = 0; d < 3; ++d) moving[c][d] = {x[c][d], v[c][d]};
}

template <class E>
constexpr int strains_of() {
    if constexpr (HasStrains<E>::value)
        return E::STRAINS;
    else
        return 1;
}

// Elastic forces of an element, f = -B^T S e where it says its strains. The energy's second derivatives are symmetric, so the adjoint of x is the slope of the
// forces along the adjoint of f.
template <template <class, class> class Element, class V>
struct ElasticForces {
    using Plain = Element<V, V>;
    static constexpr int CORNERS = Plain::CORNERS, STRAINS = strains_of<Plain>(), STIFFNESS = Plain::STIFFNESS;
    const V (&constants)[Plain::CONSTANTS], (&stiffness)[STIFFNESS];

    void forces(const Vec3<V> (&x)[CORNERS], Vec3<V> (&f)[CORNERS]) const {
        const Plain element(x, constants);
        if constexpr (HasStrains<Plain>::value) {
            V e[STRAINS], s[STRAINS];
            element.strains(e);
            element.stress(stiffness, e, s);
            element.pull(s, f);
        } else {
            element.forces(stiffness, f);
        }
    }

    // Adds to x_bar and stiffness_bar.
    void adjoint(const Vec3<V> (&x)[CORNERS], const Vec3<V> (&f_bar)[CORNERS], Vec3<V> (&x_bar)[CORNERS],
                 V (&stiffness_bar)[STIFFNESS]) const {
        Vec3<Dual<V>> along[CORNERS], f[CORNERS] = {};
        move_along(x, f_bar, along);
        const Element<Dual<V>, V> element(along, constants);
        if constexpr (HasStrains<Plain>::value) {
            Dual<V> e[STRAINS], s[STRAINS];
            element.strains(e);
            element.stress(stiffness, e, s);
            element.pull(s, f);
            V strain[STRAINS], bar[STRAINS];
            for (int i = 0; i < STRAINS; ++i) strain[i] = e[i].x, bar[i] = e[i].slope;
            element.stiffness_adjoint(strain, bar, stiffness_bar);
        } else {
            element.forces(stiffness, f);
            element.stiffness_adjoint(stiffness_bar);
        }
        for (int c = 0; c < CORNERS; ++c)
            for (int d = 0; d < 3; ++d) x_bar[c][d] += f[c][d].slope;
    }
};

// The same with viscosity, f = -B^T (S e + R B v), R made from its numbers as S from those of the stiffness.
template <template <class, class> class Element, class V>
struct ViscousForces {
    using Plain = Element<V, V>;
    static constexpr int CORNERS = Plain::CORNERS, STRAINS = Plain::STRAINS, STIFFNESS = Plain::STIFFNESS;
    const V (&constants)[Plain::CONSTANTS], (&stiffness)[STIFFNESS], (&viscosity)[STIFFNESS];

    void forces(const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS], Vec3<V> (&f)[CORNERS]) const {
        V e[STRAINS], rate[STRAINS], s[STRAINS];
        slopes(at(x, v), e, rate);
        const Plain element(x, constants);
        stresses(element, e, rate, s);
        element.pull(s, f);
    }

    // With l the adjoint of f: by v -B^T R B l; by x, at fixed s = S e + R B v and r = R B l, -D(B^T s)[l] - B^T S B l - D(B^T r)[v],
    // D(.)[l] the derivative along l.
    void adjoint(const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS], const Vec3<V> (&f_bar)[CORNERS],
                 Vec3<V> (&x_bar)[CORNERS], Vec3<V> (&v_bar)[CORNERS], V (&stiffness_bar)[STIFFNESS],
                 V (&viscosity_bar)[STIFFNESS]) const {
        const Element<Dual<V>, V> along = at(x, f_bar), moving = at(x, v);
        V e[STRAINS], rate[STRAINS], bar[STRAINS], s[STRAINS], s_slope[STRAINS], r[STRAINS];
        slopes(moving, e, rate);
        slopes(along, e, bar);
        stresses(along, e, rate, s);
        along.stress(stiffness, bar, s_slope);
        along.stress(viscosity, bar, r);
        Dual<V> both[STRAINS], fixed[STRAINS];
        for (int i = 0; i < STRAINS; ++i) both[i] = {s[i], s_slope[i]}, fixed[i] = {r[i], V{}};
        Vec3<Dual<V>> by_x[CORNERS] = {}, by_v[CORNERS] = {};
        along.pull(both, by_x);
        moving.pull(fixed, by_v);
        for (int c = 0; c < CORNERS; ++c)
            for (int d = 0; d < 3; ++d) {
                x_bar[c][d] += by_x[c][d].slope + by_v[c][d].slope;
                v_bar[c][d] += by_v[c][d].x;
            }
        along.stiffness_adjoint(e, bar, stiffness_bar);
        along.stiffness_adjoint(rate, bar, viscosity_bar);
    }

private:
    Element<Dual<V>, V> at(const Vec3<V> (&x)[CORNERS], const Vec3<V> (&v)[CORNERS]) const {
        Vec3<Dual<V>> moving[CORNERS];
        move_along(x, v, moving);
        return {moving, constants};
    }
    static void slopes(const Element<Dual<V>, V>& element, V (&e)[STRAINS], V (&slope)[STRAINS]) {
        Dual<V> both[STRAINS];
        element.strains(both);
        for (int i = 0; i < STRAINS; ++i) e[i] = both[i].x, slope[i] = both[i].slope;
    }
    template <class Any>
    void stresses(const Any& element, const V (&e)[STRAINS], const V (&rate)[STRAINS], V (&s)[STRAINS]) const {
        V viscous[STRAINS];
        element.stress(stiffness, e, s);
        element.stress(viscosity, rate, viscous);
        for (int i = 0; i < STRAINS; ++i) s[i] = s[i] + viscous[i];
    }
};

}  // namespace physreal
