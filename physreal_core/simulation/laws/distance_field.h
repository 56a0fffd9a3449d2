// A signed distance that is given on a lattice, smooth in between: quadratic B-splines, whose slopes have no jumps.
#pragma once
#include "matrix.h"

namespace physreal {

// Value [m], slope and curvature [1/m] at a place.
template <class V>
struct Distance {
    V value;
    Vec3<V> slope;
    Mat3<V> curvature;
};

template <class S>
struct DistanceField {
    const S* values;  // [count], z fastest [m]
    Index count[3];
    S origin[3];  // of the first value [m]
    S cell;

    // At places x (V: one or many). Farther than `within` from the surface, and beyond the lattice, the value is `FAR`.
    template <class V>
    Distance<V> at(const Vec3<V>& x, V within) const {
        Distance<V> found = {splat<V>(FAR), {}, {}};
        for (int l = 0; l < LaneTraits<V>::COUNT; l++) {
            Index base[3];
            Spline splines[3];
            if (!near(x, l, lane(within, l), base, splines)) continue;
            put_lane(found, l, base, splines);
        }
        return found;
    }

private:
    static constexpr S FAR = S(1e3);  // m
    static constexpr S MARGIN = S(1.5);  // cells: from a place to the nearest value, and what the splines smooth

    // Weights of three values, and their derivatives by the place in cells.
    struct Spline {
        S weight[3], slope[3];
        Spline() = default;
        explicit Spline(S f)  // from the first value, 1/2 to 3/2
            : weight{S(0.5) * (S(1.5) - f) * (S(1.5) - f), S(0.75) - (f - 1) * (f - 1), S(0.5) * (f - S(0.5)) * (f - S(0.5))},
              slope{f - S(1.5), 2 - 2 * f, f - S(0.5)} {}
        static S curvature(int i) { return i == 1 ? S(-2) : S(1); }
    };

    template <class V>
    static S lane(const V& value, int l) {
        if constexpr (LaneTraits<V>::COUNT == 1)
            return value;
        else
            return value[l];
    }
    template <class V>
    static void set(V& value, int l, S to) {
        if constexpr (LaneTraits<V>::COUNT == 1)
            value = to;
        else
            value[l] = to;
    }

    S value(Index i, Index j, Index k) const { return values[(i * count[1] + j) * count[2] + k]; }

    template <class V>
    bool near(const Vec3<V>& x, int l, S within, Index (&base)[3], Spline (&splines)[3]) const {
        Index middle[3];
        for (int d = 0; d < 3; d++) {
            const S place = (lane(x[d], l) - origin[d]) / cell + S(0.5);
            if (!(place >= 1 && place < S(count[d] - 1))) return false;  // nor where x is not a number
            middle[d] = Index(place);
            base[d] = middle[d] - 1;
            splines[d] = Spline(place - S(0.5) - S(base[d]));
        }
        return value(middle[0], middle[1], middle[2]) < within + MARGIN * cell;
    }

    template <class V>
    void put_lane(Distance<V>& found, int l, const Index (&base)[3], const Spline (&s)[3]) const {
        S value_here = 0, slope[3] = {}, curvature[6] = {};  // xx, yy, zz, xy, yz, zx
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                S along = 0, by = 0, bent = 0;
                for (int k = 0; k < 3; k++) {
                    const S own = value(base[0] + i, base[1] + j, base[2] + k);
                    along += s[2].weight[k] * own;
                    by += s[2].slope[k] * own;
                    bent += Spline::curvature(k) * own;
                }
                const S wx = s[0].weight[i], wy = s[1].weight[j], dx = s[0].slope[i], dy = s[1].slope[j];
                value_here += wx * wy * along;
                slope[0] += dx * wy * along;
                slope[1] += wx * dy * along;
                slope[2] += wx * wy * by;
                curvature[0] += Spline::curvature(i) * wy * along;
                curvature[1] += wx * Spline::curvature(j) * along;
                curvature[2] += wx * wy * bent;
                curvature[3] += dx * dy * along;
                curvature[4] += wx * dy * by;
                curvature[5] += dx * wy * by;
            }
        set(found.value, l, value_here);
        for (int d = 0; d < 3; d++) {
            const int e = (d + 1) % 3;
            set(found.slope[d], l, slope[d] / cell);
            set(found.curvature.m[4 * d], l, curvature[d] / (cell * cell));
            set(found.curvature.m[3 * d + e], l, curvature[3 + d] / (cell * cell));
            set(found.curvature.m[3 * e + d], l, curvature[3 + d] / (cell * cell));
        }
    }
};

// That of a frame's solids.
template <class Frame>
inline auto distance_field(const Frame& f) {
    using Field = DistanceField<decltype(f.solid_cell + 0)>;
    return Field{f.solid_distance,
                 {f.solid_count[0], f.solid_count[1], f.solid_count[2]},
                 {f.solid_origin[0], f.solid_origin[1], f.solid_origin[2]},
                 f.solid_cell};
}

}  // namespace physreal
