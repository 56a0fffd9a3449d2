// How a substep leads a segment's director on: by an angle about the old tangent, then by the shortest turn from the old tangent to the new.
//
// The angle's sine and cosine are those of Cayley's transform, whose angle is the given one but for its third power.
#pragma once
#include "elements.h"

namespace physreal {

template <class V>
class DirectorStep {
public:
    // before, after: the segment at both ends of the substep.
    DirectorStep(const Vec3<V>& director, V angle, const Vec3<V>& before, const Vec3<V>& after) : director_(director) {
        using S = Scalar<V>;
        set_tangent(0, before);
        set_tangent(1, after);
        half_ = S(0.5) * angle;
        per_square_ = S(1) / (S(1) + half_ * half_);
        cosine_ = (S(1) - half_ * half_) * per_square_;
        sine_ = S(2) * half_ * per_square_;
        turned_ = cosine_ * director + sine_ * cross(tangent_[0], director);
        per_sum_ = S(1) / (S(1) + dot(tangent_[0], tangent_[1]));
        sum_ = tangent_[0] + tangent_[1];
        share_ = dot(turned_, tangent_[1]) * per_sum_;
        const Vec3<V> led = turned_ - share_ * sum_;
        per_led_ = S(1) / sqrt(dot(led, led));
        result_ = per_led_ * led;
    }

    const Vec3<V>& director() const { return result_; }

    struct Adjoint {
        Vec3<V> director, before, after;
        V angle;
    };
    Adjoint adjoint(const Vec3<V>& bar) const {
        using S = Scalar<V>;
        const Vec3<V> led_bar = per_led_ * (bar - dot(bar, result_) * result_);
        const V share_bar = -dot(led_bar, sum_) * per_sum_;
        const Vec3<V> turned_bar = led_bar + share_bar * tangent_[1];
        const Vec3<V> of_both = -share_ * led_bar;
        const Vec3<V> after_bar = of_both + share_bar * (turned_ - share_ * tangent_[0]);
        const Vec3<V> before_bar = of_both - (share_bar * share_) * tangent_[1] + sine_ * cross(director_, turned_bar);
        const V of_cosine = dot(turned_bar, director_), of_sine = dot(turned_bar, cross(tangent_[0], director_));
        const V half_bar = S(2) * per_square_ * per_square_ * (of_sine * (S(1) - half_ * half_) - S(2) * of_cosine * half_);
        return {cosine_ * turned_bar + sine_ * cross(turned_bar, tangent_[0]), of_segment(0, before_bar),
                of_segment(1, after_bar), S(0.5) * half_bar};
    }

private:
    Vec3<V> director_, tangent_[2], turned_, sum_, result_;
    V per_length_[2], half_, per_square_, cosine_, sine_, per_sum_, share_, per_led_;

    void set_tangent(int i, const Vec3<V>& segment) {
        per_length_[i] = Scalar<V>(1) / sqrt(dot(segment, segment));
        tangent_[i] = per_length_[i] * segment;
    }
    Vec3<V> of_segment(int i, const Vec3<V>& bar) const {
        return per_length_[i] * (bar - dot(bar, tangent_[i]) * tangent_[i]);
    }
};

}  // namespace physreal
