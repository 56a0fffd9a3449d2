// What shells and rods share: vectors of numbers that may be dual, and what an element of a thin body is.
//
// An element is a class with FACE vertices of its own and CORNERS with those of neighbours, CONSTANTS numbers of its shape without stress and STIFFNESS numbers in which its energy is
// linear. `Element<T, V>(x, constants)` holds its strains at positions x, T either V or Dual<V>:
//     `forces(stiffness, f)`              subtracts the energy's derivative by x from f,
//     `stiffness_adjoint(bar)`            with the slope of x the adjoint of f: adds that of the stiffness to bar.
// The energy's second derivatives are symmetric, so the adjoint of x is the slope of the forces along the adjoint of f. Of framed rods, whose
// elements have FRAMES directors, see `FramedRodForces` (framedrod.h).
#pragma once
#include "dual.h"
#include "matrix.h"

namespace physreal {

template <class T>
struct Lift {
    template <class V>
    static T of(const V& value) {
        return value;
    }
};
template <class V>
struct Lift<Dual<V>> {
    static Dual<V> of(const V& value) { return {value, V{}}; }
};
// A number without slope.
template <class T, class V>
inline T lifted(const V& value) {
    return Lift<T>::of(value);
}

template <class T>
inline Vec3<T> cross(const Vec3<T>& a, const Vec3<T>& b) {
    return {{a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]}};
}

}  // namespace physreal
