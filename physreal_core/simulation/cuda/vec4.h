// Four numbers of a node, moved 16 bytes at a time: (dt force x, y, z, volume that touches the ground), or a velocity.
#pragma once
#include "matrix.h"

namespace physreal {

template <class S>
struct alignas(16) Vec4 {
    S v[4];
    S& operator[](int i) { return v[i]; }
    const S& operator[](int i) const { return v[i]; }
};

template <class S>
inline Vec4<S> operator+(const Vec4<S>& a, const Vec4<S>& b) {
    return {{a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]}};
}
template <class S>
inline Vec4<S>& operator+=(Vec4<S>& a, const Vec4<S>& b) {
    return a = a + b;
}
template <class S>
inline Vec4<S> operator*(S s, const Vec4<S>& a) {
    return {{s * a[0], s * a[1], s * a[2], s * a[3]}};
}
template <class S>
inline Vec4<S> operator/(const Vec4<S>& a, S s) {
    return (1 / s) * a;
}
template <class S>
inline S dot(const Vec4<S>& a, const Vec4<S>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
}
template <class S>
inline Vec3<S> three(const Vec4<S>& a) {
    return {{a[0], a[1], a[2]}};
}

}  // namespace physreal
