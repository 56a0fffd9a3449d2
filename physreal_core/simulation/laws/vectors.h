// Vectors of numbers that may be dual.
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
