// Dual numbers: forward differentiation along one direction.
#pragma once
#include "number.h"

namespace physreal {

// x + slope d, with d * d = 0.
template <class V>
struct Dual {
    V x = {}, slope = {};

    Dual() = default;
    Dual(V x, V slope) : x(x), slope(slope) {}
    Dual(Scalar<V> constant) : x(splat<V>(constant)) {}

    friend Dual operator-(Dual a) { return {-a.x, -a.slope}; }
    friend Dual operator+(Dual a, Dual b) { return {a.x + b.x, a.slope + b.slope}; }
    friend Dual operator-(Dual a, Dual b) { return {a.x - b.x, a.slope - b.slope}; }
    friend Dual operator*(Dual a, Dual b) { return {a.x * b.x, a.slope * b.x + a.x * b.slope}; }
    friend Dual operator/(Dual a, Dual b) {
        const V inverse = Scalar<V>(1) / b.x, quotient = a.x * inverse;
        return {quotient, (a.slope - quotient * b.slope) * inverse};
    }
    Dual& operator+=(Dual b) { return *this = *this + b; }
    Dual& operator-=(Dual b) { return *this = *this - b; }
    Dual& operator*=(Dual b) { return *this = *this * b; }
    friend Mask<V> operator<(Dual a, Dual b) { return a.x < b.x; }
    friend Mask<V> operator>(Dual a, Dual b) { return a.x > b.x; }
    friend Mask<V> operator<=(Dual a, Dual b) { return a.x <= b.x; }
    friend Mask<V> operator>=(Dual a, Dual b) { return a.x >= b.x; }

    friend Dual select(Mask<V> mask, Dual a, Dual b) {
        return {physreal::select(mask, a.x, b.x), physreal::select(mask, a.slope, b.slope)};
    }
    friend Dual sqrt(Dual a) {
        const V root = physreal::sqrt(a.x);
        return {root, Scalar<V>(0.5) * a.slope / root};
    }
    friend Dual inverse_sqrt(Dual a) {
        const V value = physreal::inverse_sqrt(a.x);
        return {value, Scalar<V>(-0.5) * a.slope * value * value * value};
    }
    friend Dual log(Dual a) { return {physreal::log(a.x), a.slope / a.x}; }
    friend Dual exp(Dual a) {
        const V value = physreal::exp(a.x);
        return {value, value * a.slope};
    }
    friend Dual atan2(Dual y, Dual x) {
        return {physreal::atan2(y.x, x.x), (x.x * y.slope - y.x * x.slope) / (x.x * x.x + y.x * y.x)};
    }
    friend Dual abs(Dual a) { return select(a < Dual(0), -a, a); }
};

template <class V>
struct LaneTraits<Dual<V>> {
    using Scalar = physreal::Scalar<V>;
    using Mask = physreal::Mask<V>;
    static constexpr int COUNT = LaneTraits<V>::COUNT;
};

}  // namespace physreal
