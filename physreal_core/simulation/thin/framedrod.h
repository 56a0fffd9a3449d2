// Two segments of a rod with directors and the vertex between them (rod.py): stretching of the segments, bending and twisting there.
//
// Discrete elastic rod (Bergou et al. 2008, 2010). Each segment has a director d; with t its tangent, m1 is the part of d across t at
// length one, and m2 = t x m1. With a and b the segments, kb = 2 t_a x t_b / (1 + t_a . t_b) the curvature binormal:
//     curvature_1 = kb . (m2_a + m2_b) / 2 ,  curvature_2 = -kb . (m1_a + m1_b) / 2 ,
//     twist = angle from m1_a, led over the vertex by the shortest turn, to m1_b.
// Strains are these and the two stretches. Slopes hold where a director has a part along its tangent, too, so that slopes of slopes are
// right; they are symmetric but for what changes a director's length.
//
// The energy is sum_k stiffness_k (strain_k - rest_k)^2 / 2. With a retardation time, bending and twisting have a dashpot beside each spring
// (Kelvin and Voigt): the moment of strain k is stiffness_k (strain_k - rest_k + time d strain_k / dt).
#pragma once
#include "elements.h"

namespace physreal {

template <class T, class V>
class FramedRod {
public:
    static constexpr int FACE = 2, CORNERS = 3, FRAMES = 2, CONSTANTS = rod::COUNT, STIFFNESS = framed_rod_stiffness::COUNT;
    static constexpr int STRETCH = 0, CURVATURE = 2, TWIST = 4, STRAINS = 5;

    T strains[STRAINS];

    FramedRod(const Vec3<T> (&x)[CORNERS], const Vec3<T> (&director)[FRAMES], const V (&constants)[CONSTANTS]) {
        const T one = number(1), half = number(0.5);
        for (int i = 0; i < FRAMES; ++i) {
            rest_[i] = constants[rod::rest_length + i];
            const Vec3<T> segment = x[i + 1] - x[i];
            const T length = sqrt(dot(segment, segment));
            per_length_[i] = one / length;
            tangent_[i] = per_length_[i] * segment;
            strains[STRETCH + i] = length / lifted<T>(rest_[i]) - one;
            const T along = dot(director[i], tangent_[i]);
            const Vec3<T> across = director[i] - along * tangent_[i];
            per_director_[i] = one / sqrt(dot(across, across));
            tilt_[i] = along * per_director_[i];
            m1_[i] = per_director_[i] * across;
            m2_[i] = cross(tangent_[i], m1_[i]);
        }
        per_sum_ = one / (one + dot(tangent_[0], tangent_[1]));
        binormal_ = (number(2) * per_sum_) * cross(tangent_[0], tangent_[1]);
        middle_ = per_sum_ * (tangent_[0] + tangent_[1]);
        strains[CURVATURE] = half * dot(binormal_, m2_[0] + m2_[1]);
        strains[CURVATURE + 1] = -half * dot(binormal_, m1_[0] + m1_[1]);
        const Vec3<T> led = m1_[0] - dot(m1_[0], tangent_[1]) * middle_;
        strains[TWIST] = atan2(dot(cross(tangent_[1], led), m1_[1]), dot(led, m1_[1]));
    }

    // Adds sign times the slopes of the strains, weighed, by the vertices and by the directors.
    void slopes(const T (&weights)[STRAINS], Scalar<V> sign, Vec3<T> (&of_x)[CORNERS], Vec3<T> (&of_director)[FRAMES]) const {
        const T half = number(0.5), twist = weights[TWIST];
        const T first = weights[CURVATURE], second = weights[CURVATURE + 1];
        const Vec3<T> mean = (first * per_sum_) * (m2_[0] + m2_[1]) - (second * per_sum_) * (m1_[0] + m1_[1]);
        const T bent = first * strains[CURVATURE] + second * strains[CURVATURE + 1];
        const Vec3<T> shared = (half * twist) * binormal_ - bent * middle_;
        for (int i = 0; i < FRAMES; ++i) {
            const Vec3<T> over = i == 0 ? cross(tangent_[1], mean) : cross(mean, tangent_[0]);
            const T turn = turning(weights, i);
            const T s = number(sign), stretch = s * weights[STRETCH + i] / lifted<T>(rest_[i]);
            const Vec3<T> slope =
                stretch * tangent_[i] + (s * per_length_[i]) * (shared + over - (turn * tilt_[i]) * m2_[i]);
            of_x[i] = of_x[i] - slope;
            of_x[i + 1] = of_x[i + 1] + slope;
            of_director[i] = of_director[i] + (s * turn * per_director_[i]) * m2_[i];
        }
    }

    // Slope of the weighed strains by a turn of director i about its tangent.
    T turning(const T (&weights)[STRAINS], int i) const {
        const T half = number(0.5);
        const T bent = half * (weights[CURVATURE] * dot(binormal_, m1_[i]) + weights[CURVATURE + 1] * dot(binormal_, m2_[i]));
        return i == 0 ? -bent - weights[TWIST] : weights[TWIST] - bent;
    }

private:
    V rest_[FRAMES];
    Vec3<T> tangent_[FRAMES], m1_[FRAMES], m2_[FRAMES], binormal_, middle_;
    T per_length_[FRAMES], per_director_[FRAMES], tilt_[FRAMES], per_sum_;

    static T number(Scalar<V> value) { return lifted<T>(splat<V>(value)); }
};

// Forces of the elements in V's lanes, and their adjoint.
template <class V>
class FramedRodForces {
    using Element = FramedRod<V, V>;
    using Slopes = FramedRod<Dual<V>, V>;
    static constexpr int STRAINS = Element::STRAINS, CURVATURE = Element::CURVATURE, TWIST = Element::TWIST;

public:
    static constexpr int CORNERS = 3, FRAMES = 2;

    // Of the vertices x [m], v [m/s], of the segments' directors, and their spins about the tangents [rad/s]. As an adjoint: of what the step
    // takes from the elements' forces.
    struct State {
        Vec3<V> x[CORNERS], v[CORNERS], director[FRAMES];
        V spin[FRAMES];
    };
    struct Forces {
        Vec3<V> force[CORNERS];
        V torque[FRAMES];
    };

    FramedRodForces(const V (&constants)[Element::CONSTANTS], const V (&numbers)[Element::STIFFNESS]) : constants_(constants) {
        for (int i = 0; i < 2; ++i) {
            stiffness_[i] = numbers[framed_rod_stiffness::stretching + i] * constants[rod::rest_length + i];
            rest_[i] = V{};
            stiffness_[CURVATURE + i] = numbers[framed_rod_stiffness::bending] * constants[rod::per_length];
            rest_[CURVATURE + i] = numbers[framed_rod_stiffness::rest_curvature + i] / constants[rod::per_length];
            time_[i] = V{};
            time_[CURVATURE + i] = numbers[framed_rod_stiffness::retardation];
        }
        stiffness_[TWIST] = numbers[framed_rod_stiffness::twisting] * constants[rod::per_length];
        rest_[TWIST] = V{};
        time_[TWIST] = numbers[framed_rod_stiffness::retardation + 1];
    }

    // damped: whether there are retardation times.
    Forces forces(const State& now, bool damped) const {
        const Element element(now.x, now.director, constants_);
        V moments[STRAINS];
        for (int k = 0; k < STRAINS; ++k) moments[k] = stiffness_[k] * (element.strains[k] - rest_[k]);
        if (damped) {
            const Slopes moving = along(now, now.v, now.spin);
            for (int k = CURVATURE; k < STRAINS; ++k) moments[k] += stiffness_[k] * time_[k] * moving.strains[k].slope;
        }
        Forces out = {};
        Vec3<V> of_director[FRAMES] = {};
        element.slopes(moments, -1, out.force, of_director);
        for (int i = 0; i < FRAMES; ++i) out.torque[i] = -element.turning(moments, i);
        return out;
    }

    // The adjoint of the state by that of the forces; bar grows by that of the numbers.
    State adjoint(const State& now, const Forces& of, bool damped, V (&bar)[Element::STIFFNESS]) const {
        State out = {};
        const Slopes towards = along(now, of.force, of.torque);
        Dual<V> moments[STRAINS];
        for (int k = 0; k < STRAINS; ++k)
            moments[k] = {stiffness_[k] * (towards.strains[k].x - rest_[k]), stiffness_[k] * towards.strains[k].slope};
        V rates[STRAINS] = {};
        if (damped) {
            const Slopes moving = along(now, now.v, now.spin);
            Dual<V> lost[STRAINS] = {};
            for (int k = CURVATURE; k < STRAINS; ++k) {
                rates[k] = moving.strains[k].slope;
                moments[k].x += stiffness_[k] * time_[k] * rates[k];
                lost[k].x = stiffness_[k] * time_[k] * towards.strains[k].slope;
            }
            Vec3<Dual<V>> of_x[CORNERS] = {}, of_director[FRAMES] = {};
            moving.slopes(lost, -1, of_x, of_director);
            add(of_x, of_director, out);
            for (int c = 0; c < CORNERS; ++c)
                for (int d = 0; d < 3; ++d) out.v[c][d] = of_x[c][d].x;
            for (int i = 0; i < FRAMES; ++i) out.spin[i] = -moving.turning(lost, i).x;
        }
        Vec3<Dual<V>> of_x[CORNERS] = {}, of_director[FRAMES] = {};
        towards.slopes(moments, -1, of_x, of_director);
        add(of_x, of_director, out);
        add_to_numbers(towards, rates, bar);
        return out;
    }

private:
    const V (&constants_)[Element::CONSTANTS];
    V stiffness_[STRAINS], rest_[STRAINS], time_[STRAINS];

    // The element with slopes along a motion of the vertices and spins of the directors.
    Slopes along(const State& now, const Vec3<V> (&motion)[CORNERS], const V (&spin)[FRAMES]) const {
        Vec3<Dual<V>> x[CORNERS], director[FRAMES];
        for (int c = 0; c < CORNERS; ++c)
            for (int d = 0; d < 3; ++d) x[c][d] = {now.x[c][d], motion[c][d]};
        for (int i = 0; i < FRAMES; ++i) {
            const Vec3<V> segment = now.x[i + 1] - now.x[i];
            const V rate = spin[i] / sqrt(dot(segment, segment));
            const Vec3<V> turning = rate * cross(segment, now.director[i]);
            for (int d = 0; d < 3; ++d) director[i][d] = {now.director[i][d], turning[d]};
        }
        return {x, director, constants_};
    }

    static void add(const Vec3<Dual<V>> (&of_x)[CORNERS], const Vec3<Dual<V>> (&of_director)[FRAMES], State& out) {
        for (int c = 0; c < CORNERS; ++c)
            for (int d = 0; d < 3; ++d) out.x[c][d] += of_x[c][d].slope;
        for (int i = 0; i < FRAMES; ++i)
            for (int d = 0; d < 3; ++d) out.director[i][d] += of_director[i][d].slope;
    }

    void add_to_numbers(const Slopes& towards, const V (&rates)[STRAINS], V (&bar)[Element::STIFFNESS]) const {
        V by_stiffness[STRAINS], by_time[STRAINS];
        for (int k = 0; k < STRAINS; ++k) {
            const V slope = towards.strains[k].slope;
            by_stiffness[k] = (towards.strains[k].x - rest_[k] + time_[k] * rates[k]) * slope;
            by_time[k] = stiffness_[k] * rates[k] * slope;
        }
        for (int i = 0; i < 2; ++i) {
            bar[framed_rod_stiffness::stretching + i] -= constants_[rod::rest_length + i] * by_stiffness[i];
            bar[framed_rod_stiffness::bending] -= constants_[rod::per_length] * by_stiffness[CURVATURE + i];
            bar[framed_rod_stiffness::rest_curvature + i] +=
                stiffness_[CURVATURE + i] / constants_[rod::per_length] * towards.strains[CURVATURE + i].slope;
        }
        bar[framed_rod_stiffness::twisting] -= constants_[rod::per_length] * by_stiffness[TWIST];
        bar[framed_rod_stiffness::retardation] -= by_time[CURVATURE] + by_time[CURVATURE + 1];
        bar[framed_rod_stiffness::retardation + 1] -= by_time[TWIST];
    }
};

}  // namespace physreal
