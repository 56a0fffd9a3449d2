// Two segments of a rod and the vertex between them (rod.py): stretching of the segments, bending at the vertex.
//
// With a, b the segments, P = |a| |b| and s = a . b, the square of the curvature binormal 2 a x b / (P + s) is 4 tan^2(angle / 2)
// (Bergou et al. 2008), its derivative by a is 8 |b| / |a| a x (a x b) / (P + s)^2, without cancellation where the rod is straight.
#pragma once
#include "elements.h"

namespace physreal {

template <class T, class V>
class Rod {
public:
    static constexpr int FACE = 2, CORNERS = 3, FRAMES = 0, CONSTANTS = rod::COUNT, STIFFNESS = rod_stiffness::COUNT;
    static constexpr int STRETCHING = rod_stiffness::bending;

    Rod(const Vec3<T> (&x)[CORNERS], const V (&constants)[CONSTANTS]) : per_length_(constants[rod::per_length]) {
        const T one = lifted<T>(splat<V>(Scalar<V>(1)));
        for (int i = 0; i < 2; ++i) {
            rest_[i] = constants[rod::rest_length + i];
            segment_[i] = x[i + 1] - x[i];
            length_[i] = sqrt(dot(segment_[i], segment_[i]));
            strain_[i] = length_[i] / lifted<T>(rest_[i]) - one;
        }
        across_ = cross(segment_[0], segment_[1]);
        const T sum = length_[0] * length_[1] + dot(segment_[0], segment_[1]);
        weight_ = lifted<T>(splat<V>(Scalar<V>(4)) * per_length_) / (sum * sum);
    }

    void forces(const V (&stiffness)[STIFFNESS], Vec3<T> (&f)[CORNERS]) const {
        const T bending = lifted<T>(stiffness[rod_stiffness::bending]) * weight_;
        for (int i = 0; i < 2; ++i) {
            const Vec3<T>&own = segment_[i], turn = i == 0 ? across_ : lifted<T>(splat<V>(Scalar<V>(-1))) * across_;
            const T pull = lifted<T>(stiffness[rod_stiffness::stretching + i]) * strain_[i] / length_[i];
            const Vec3<T> slope = pull * own + bending * (length_[1 - i] / length_[i]) * cross(own, turn);
            f[i] = f[i] + slope;
            f[i + 1] = f[i + 1] - slope;
        }
    }

    // For T = Dual<V>.
    void stiffness_adjoint(V (&bar)[STIFFNESS]) const {
        for (int i = 0; i < 2; ++i)
            bar[rod_stiffness::stretching + i] -= rest_[i] * strain_[i].x * strain_[i].slope;
        // the energy is stiffness weight |a x b|^2 / 2
        const T energy = T(Scalar<V>(0.5)) * weight_ * dot(across_, across_);
        bar[rod_stiffness::bending] -= energy.slope;
    }

    // For T = V: the mean of both stretches, that of their squares, and the square of the curvature.
    void invariants(V (&I)[INVARIANTS]) const {
        using S = Scalar<V>;
        I[0] = S(0.5) * (strain_[0] + strain_[1]);
        I[1] = S(0.5) * (strain_[0] * strain_[0] + strain_[1] * strain_[1]);
        I[2] = per_length_ * weight_ * dot(across_, across_);
    }
    // Adds to x_bar.
    void invariants_adjoint(const V (&I_bar)[INVARIANTS], Vec3<V> (&x_bar)[CORNERS]) const {
        using S = Scalar<V>;
        // forces are minus the slope of half of weight |a x b|^2, and of rest strain^2 / 2
        const V bending[STIFFNESS] = {V{}, V{}, S(2) * per_length_ * I_bar[2]};
        Vec3<V> f[CORNERS] = {};
        forces(bending, f);
        for (int c = 0; c < CORNERS; ++c) x_bar[c] = x_bar[c] - f[c];
        for (int i = 0; i < 2; ++i) {
            const V strain_bar = S(0.5) * I_bar[0] + I_bar[1] * strain_[i];
            const Vec3<V> slope = (strain_bar / (length_[i] * rest_[i])) * segment_[i];
            x_bar[i] = x_bar[i] - slope;
            x_bar[i + 1] = x_bar[i + 1] + slope;
        }
    }

private:
    V rest_[2], per_length_;
    Vec3<T> segment_[2], across_;
    T length_[2], strain_[2], weight_;
};

}  // namespace physreal
