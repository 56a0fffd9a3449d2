// Obstacle: f = m k max(0, -phi) grad phi, phi the signed distance of a capsule: centre, half axis (zero for a ball),
// radius, stiffness.
#pragma once
#include "term.h"

namespace physreal {

struct Obstacle {
    static constexpr Index TERM = term::obstacle;

    template <class At>
    static auto force(const At& at) {
        const auto x = at.x();
        const Contact<decltype(x[0] + x[0])> contact(at, x);
        return (contact.stiffness * contact.depth) * contact.outwards;
    }

    template <class At, class V>
    static void adjoint(At& at, const Vec3<V>& f_bar) {
        using S = Scalar<V>;
        const Contact<V> c(at, at.x());
        const V work = select(c.depth > S(0), dot(c.outwards, f_bar), V{}), radius_bar = c.stiffness * work;
        const V turning = c.stiffness * c.depth / c.length;
        const Vec3<V> from_axis_bar = turning * f_bar - (turning * work + radius_bar) * c.outwards;
        const V along_bar = select(c.beside, -(c.inverse_square * dot(c.axis, from_axis_bar)), V{});
        const Vec3<V> x_bar = from_axis_bar + along_bar * c.axis;
        const Vec3<V> axis_bar = along_bar * (c.arm - (S(2) * c.along) * c.axis) - c.along * from_axis_bar;
        at.add_x(x_bar);
        at.add_mass(number_of(at, 7) * c.depth * work);
        for (int d = 0; d < 3; ++d) {
            at.add_number(number::obstacle + d, -x_bar[d]);
            at.add_number(number::obstacle + 3 + d, axis_bar[d]);
        }
        at.add_number(number::obstacle + 6, radius_bar);
        at.add_number(number::obstacle + 7, at.mass() * c.depth * work);
    }

private:
    template <class At>
    static auto number_of(const At& at, int place) {
        return at.number(number::obstacle + place);
    }

    // From the capsule's middle line to the particle, outwards, and how deep it is inside.
    template <class V>
    struct Contact {
        using S = Scalar<V>;
        Vec3<V> axis, arm, outwards;
        V along, length, depth, stiffness;
        Mask<V> beside;  // nearest to the axis between its ends
        S inverse_square;

        template <class At>
        Contact(const At& at, const Vec3<V>& x) : stiffness(at.mass() * number_of(at, 7)) {
            constexpr S SOFTENING = S(1e-12);  // m2, of the distance from its middle
            S square = 0;
            for (int d = 0; d < 3; ++d) {
                const S half = number_of(at, 3 + d);
                square += half * half;
                axis[d] = splat<V>(half);
                arm[d] = x[d] - number_of(at, d);
            }
            inverse_square = square > 0 ? 1 / square : S(0);
            const V free = inverse_square * dot(arm, axis);
            along = max(min(free, splat<V>(1)), splat<V>(-1));
            beside = abs(free) < S(1);
            const Vec3<V> from_axis = arm - along * axis;
            length = sqrt(dot(from_axis, from_axis) + SOFTENING);
            outwards = (S(1) / length) * from_axis;
            depth = max(number_of(at, 6) - length, V{});
        }
    };
};

}  // namespace physreal
