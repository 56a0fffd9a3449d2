// Forces on particles from what is around them: drag, adhesion to the ground, an obstacle; with their adjoints.
// The twin of term_laws.py, where the sources stand.
#pragma once

#include "../matrix.h"

namespace physreal {

// --- drag: f = -(c1 + c2 |v|) v

template <class V>
inline Vec3<V> drag(const Vec3<V>& v, V linear, V quadratic) {
    return -(linear + quadratic * sqrt(dot(v, v))) * v;
}

template <class V>
struct DragAdjoint {
    Vec3<V> v;
    V linear, quadratic;
};

template <class V>
inline DragAdjoint<V> drag_adjoint(const Vec3<V>& v, V linear, V quadratic, const Vec3<V>& f_bar) {
    const V speed = sqrt(dot(v, v)), along = dot(v, f_bar);
    const V turning = select(speed > Scalar<V>(0), quadratic * along / speed, V{});
    return {-(linear + quadratic * speed) * f_bar - turning * v, -along, -(speed * along)};
}

// --- adhesion: f_z = -a e (u / d) exp(-u / d) for u > 0

template <class V>
inline V adhesion(V height, V peak, V reach) {
    using S = Scalar<V>;
    const V u = max(height / reach, V{});
    return -(peak * u * exp(S(1) - u));
}

template <class V>
struct AdhesionAdjoint {
    V height, peak, reach;
};

template <class V>
inline AdhesionAdjoint<V> adhesion_adjoint(V height, V peak, V reach, V f_bar) {
    using S = Scalar<V>;
    const V u = max(height / reach, V{}), fade = exp(S(1) - u);
    const V u_bar = select(height > S(0), -(peak * (S(1) - u) * fade * f_bar), V{});
    return {u_bar / reach, -(u * fade * f_bar), -(u * u_bar / reach)};
}

// --- obstacle: f = m k max(0, -phi) grad phi of a capsule

template <class V>
struct ObstacleAdjoint {
    Vec3<V> x, centre, axis;
    V mass, radius, stiffness;
};

template <class V>
class Obstacle {
    using S = Scalar<V>;
    static constexpr S SOFTENING = S(1e-12);  // m2, of the distance from its middle

    Vec3<V> axis_, arm_, out_;
    V along_, length_, depth_, mass_, stiffness_;
    Mask<V> beside_;  // nearest to the axis between its ends
    S inverse_square_;

public:
    Vec3<V> force;

    // capsule: centre, half axis (zero for a ball), radius, stiffness.
    Obstacle(const Vec3<V>& x, V mass, const S* capsule) : mass_(mass), stiffness_(splat<V>(capsule[7])) {
        const S square = capsule[3] * capsule[3] + capsule[4] * capsule[4] + capsule[5] * capsule[5];
        inverse_square_ = square > 0 ? 1 / square : S(0);
        for (int d = 0; d < 3; ++d) {
            axis_[d] = splat<V>(capsule[3 + d]);
            arm_[d] = x[d] - capsule[d];
        }
        const V free = inverse_square_ * dot(arm_, axis_);
        along_ = max(min(free, splat<V>(1)), splat<V>(-1));
        beside_ = abs(free) < S(1);
        const Vec3<V> from_axis = arm_ - along_ * axis_;
        length_ = sqrt(dot(from_axis, from_axis) + SOFTENING);
        out_ = (S(1) / length_) * from_axis;
        depth_ = max(capsule[6] - length_, V{});
        force = (mass_ * stiffness_ * depth_) * out_;
    }

    ObstacleAdjoint<V> adjoint(const Vec3<V>& f_bar) const {
        const Mask<V> touches = depth_ > S(0);
        const V outwards = select(touches, dot(out_, f_bar), V{});
        const V radius_bar = mass_ * stiffness_ * outwards;
        const V turning = mass_ * stiffness_ * depth_ / length_;
        const Vec3<V> from_axis_bar = turning * f_bar - (turning * outwards + radius_bar) * out_;
        const V along_bar = select(beside_, -(inverse_square_ * dot(axis_, from_axis_bar)), V{});
        const Vec3<V> x_bar = from_axis_bar + along_bar * axis_;
        const Vec3<V> axis_bar = along_bar * (arm_ - (S(2) * along_) * axis_) - along_ * from_axis_bar;
        return {x_bar,      Vec3<V>{} - x_bar,        axis_bar, stiffness_ * depth_ * outwards,
                radius_bar, mass_ * depth_ * outwards};
    }
};

}  // namespace physreal
