// Two simplices of a body's surface that come nearer than they reach (surface.py): a point and a triangle, a point and a segment, two edges.
//
// The way between their nearest points is g = from + a D0 + b D1 = sum_c s_c x_c over four corners x, with a and b such that g is shortest:
// on edges places along either, on a triangle along two of its sides, of a segment there is no b. Which of a and b are free depends on where
// the nearest point lies: within a triangle both, on its border one combination, at a corner none.
// With depth = R - |g| > 0 the energy is W k depth^2 / 2. R is the sum of both things' reach at the nearest points, that of corners the same
// on all of a thin body, or linear between those of a volume's. W is 1 where a point takes part. Of two edges it is
//     W = bump(a) bump(b) crossing(sin^2 of the angle between them) ,
// which fades towards their ends, where points and faces meet, and towards parallel edges, which have no nearest points.
// Friction acts against the difference u of the velocities across g: mu N u / |u|, with N = W k depth, smoothed below a speed e as by Li et
// al. (ACM TOG 39, 2020, "Incremental potential contact"): mu N (2 - |u| / e) u / e.
#pragma once
#include "vectors.h"

namespace physreal {

enum ContactKind : int { POINT_TRIANGLE, POINT_SEGMENT, EDGES };

// Products of D0 and D1 with each other, and minus theirs with `from`.
template <class T>
struct Products {
    T A00, A01, A11, r0, r1;
};

// The part of a triangle or segment on which the nearest point lies: all of it, or a border from (a, b) along (da, db), or a corner.
template <class V>
struct Part {
    Mask<V> whole;
    V a = {}, b = {}, da = {}, db = {};

    void set(Mask<V> mask, Scalar<V> a_, Scalar<V> b_, Scalar<V> da_, Scalar<V> db_) {
        whole = whole & ~mask;
        a = select(mask, splat<V>(a_), a);
        b = select(mask, splat<V>(b_), b);
        da = select(mask, splat<V>(da_), da);
        db = select(mask, splat<V>(db_), db);
    }
};

// Ericson, Real-Time Collision Detection (2005), 5.1.5; the part that he asks for first is set last.
template <class V, class T>
inline Part<V> part_of_triangle(const Products<T>& of) {
    const T zero = {}, r0 = of.r0, r1 = of.r1;
    const T second0 = r0 - of.A00, second1 = r1 - of.A01, third0 = r0 - of.A01, third1 = r1 - of.A11;  // from the other corners
    Part<V> part = {zero <= zero};
    part.set((second0 * third1 <= third0 * second1) & (second1 >= second0) & (third0 >= third1), 1, 0, -1, 1);
    part.set((third0 * r1 <= r0 * third1) & (r1 >= zero) & (third1 <= zero), 0, 0, 0, 1);
    part.set((third1 >= zero) & (third0 <= third1), 0, 1, 0, 0);
    part.set((r0 * second1 <= second0 * r1) & (r0 >= zero) & (second0 <= zero), 0, 0, 1, 0);
    part.set((second0 >= zero) & (second1 <= second0), 1, 0, 0, 0);
    part.set((r0 <= zero) & (r1 <= zero), 0, 0, 0, 0);
    return part;
}

template <class V, class T>
inline Part<V> part_of_segment(const Products<T>& of) {
    Part<V> part = {of.r0 < of.r0, {}, {}, splat<V>(1), {}};
    part.set(of.r0 >= of.A00, 1, 0, 0, 0);
    part.set(of.r0 <= T{}, 0, 0, 0, 0);
    return part;
}

// Square of the shortest way of point x[0] to the segment from x[i] to x[j].
template <class V>
inline V squared_way(const Vec3<V> (&x)[4], int i, int j) {
    const Vec3<V> edge = x[j] - x[i], to = x[0] - x[i];
    const V t = max(V{}, min(splat<V>(1), dot(to, edge) / dot(edge, edge)));
    const Vec3<V> way = to - t * edge;
    return dot(way, way);
}

// Square of the distance between edges x[0] x[1] and x[2] x[3]: one of a point of either where their lines' nearest points lie outside, or
// where the edges are parallel but for 0.001 rad. There the result may be too large by as much of an edge. Such a pair has no force before its
// corners have moved by a tenth of an edge in all, so one that wakes after 0.98 of the way to go wakes in time.
template <class V>
inline V squared_distance_of_edges(const Vec3<V> (&x)[4]) {
    const Vec3<V> swapped[4] = {x[2], x[0], x[1], x[3]}, end[4] = {x[3], x[0], x[1], x[2]};
    const Vec3<V> other[4] = {x[1], x[1], x[2], x[3]}, own[4] = {x[0], x[1], x[2], x[3]};
    V least = min(min(squared_way(swapped, 1, 2), squared_way(end, 1, 2)), min(squared_way(own, 2, 3), squared_way(other, 2, 3)));
    const Vec3<V> u = x[1] - x[0], v = x[3] - x[2], w = x[0] - x[2];
    const V uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), wu = dot(w, u), wv = dot(w, v);
    const V whole = uu * vv - uv * uv, a = uv * wv - vv * wu, b = uu * wv - uv * wu;
    const Mask<V> inside = (a > V{}) & (a < whole) & (b > V{}) & (b < whole) & (whole > Scalar<V>(1e-6) * (uu * vv));
    const V volume = dot(w, cross(u, v));
    return select(inside, volume * volume / select(inside, whole, splat<V>(1)), least);
}

// What friction between layers follows from.
template <class V>
struct LayerFriction {
    V coefficient, speed;  // speed: below which it is smoothed [m/s]
    V softening;           // which grows with the largest friction, so that steps are stable [m/s/N]
};

// UNLIKE: whether corners differ in their reach.
template <int KIND, bool UNLIKE, class T, class V>
class Contact {
    using S = Scalar<V>;
    static constexpr S SHALLOW = S(0.01), STEEP = S(0.1);  // sin^2 between which edges come to count as crossing
    static constexpr int I = KIND == EDGES ? 0 : 2, J = KIND == EDGES ? 2 : 1;  // D0 = x[1] - x[I], D1 = x[J] - x[3]

public:
    Contact(const Vec3<T> (&x)[4], const V (&reach)[4]) {
        const T one = constant(1);
        const Vec3<T> from = x[0] - x[J];
        D_[0] = x[1] - x[I];
        of_.A00 = dot(D_[0], D_[0]);
        of_.r0 = -dot(D_[0], from);
        if constexpr (KIND != POINT_SEGMENT) {
            D_[1] = x[J] - x[3];
            of_.A01 = dot(D_[0], D_[1]);
            of_.A11 = dot(D_[1], D_[1]);
            of_.r1 = -dot(D_[1], from);
        }
        if constexpr (KIND == EDGES)
            place_on_edges();
        else
            place_on_part(KIND == POINT_TRIANGLE ? part_of_triangle<V>(of_) : part_of_segment<V>(of_));
        way_ = from + a_ * D_[0] + b_ * D_[1];
        s_[0] = one;
        s_[J] = s_[J] - one;
        s_[1] = s_[1] + a_;
        s_[I] = s_[I] - a_;
        s_[J] = s_[J] + b_;
        s_[3] = s_[3] - b_;
        const T squared = dot(way_, way_) + constant(S(1e-20));
        per_length_ = inverse_sqrt(squared);
        length_ = squared * per_length_;
        const T deep = reach_at_nearest(reach) - length_;
        depth_ = select(deep > T{}, deep, T{});
    }

    // Lanes in which there is a force.
    Mask<V> touches() const {
        const Mask<V> near = depth_ > T{};
        if constexpr (KIND != EDGES) return near;
        const T one = constant(1);
        return near & crosses_ & (a_ > T{}) & (a_ < one) & (b_ > T{}) & (b_ < one);
    }

    // Lanes in which `length` is that of the shortest way: all but of parallel edges.
    Mask<V> distinct() const { return KIND == EDGES ? crosses_ : depth_ >= T{}; }

    // How far the nearest points are apart; of edges those of their lines.
    T length() const { return length_; }

    // Energy over stiffness.
    T energy() const { return constant(S(0.5)) * weight() * depth_ * depth_; }

    // Subtracts the energy's derivative by x from f. As the way is shortest, places do not matter but for the weight and the reach.
    void forces(V stiffness, Vec3<T> (&f)[4]) const {
        const T k = lifted<T>(stiffness);
        const Vec3<T> push = (k * weight() * depth_ * per_length_) * way_;
        for (int c = 0; c < 4; ++c) f[c] = f[c] + s_[c] * push;
        if constexpr (KIND == EDGES || UNLIKE) {
            Vec3<T> x_bar[4] = {};
            const T by_reach = k * weight() * depth_;
            pull_back({}, by_reach * lifted<T>(reach_by_a_), by_reach * lifted<T>(reach_by_b_),
                      constant(S(0.5)) * k * depth_ * depth_, x_bar);
            for (int c = 0; c < 4; ++c) f[c] = f[c] - x_bar[c];
        }
    }

    // The rest is for T = V. v: velocities of the corners. Adds to f.
    void friction(V stiffness, const LayerFriction<V>& law, const Vec3<V> (&v)[4], Vec3<V> (&f)[4]) const {
        const Slide slide(*this, stiffness, law, v);
        const Vec3<V> pull = (law.coefficient * slide.normal * slide.over) * slide.across;
        for (int c = 0; c < 4; ++c) f[c] = f[c] - s_[c] * pull;
    }

    // From the adjoint f_bar of the forces; adds to the others.
    void friction_adjoint(V stiffness, const LayerFriction<V>& law, const Vec3<V> (&v)[4], const Vec3<V> (&f_bar)[4],
                          Vec3<V> (&x_bar)[4], Vec3<V> (&v_bar)[4], V& stiffness_bar, V& coefficient_bar) const {
        const Slide slide(*this, stiffness, law, v);
        const V mu = law.coefficient, N = slide.normal;
        const Vec3<V> pull = (mu * N * slide.over) * slide.across;
        Vec3<V> pull_bar = {};
        V s_bar[4];
        for (int c = 0; c < 4; ++c) {
            pull_bar = pull_bar - s_[c] * f_bar[c];
            s_bar[c] = -dot(f_bar[c], pull);
        }
        const V size_bar = dot(pull_bar, slide.across), over_bar = mu * N * size_bar;
        const V e_bar = over_bar * slide.over_by_e;
        Vec3<V> across_bar = (mu * N * slide.over) * pull_bar + (over_bar * slide.over_by_speed * slide.per_speed) * slide.across;
        coefficient_bar += N * slide.over * size_bar + e_bar * law.softening * N;
        const V N_bar = mu * slide.over * size_bar + e_bar * law.softening * mu;
        const Vec3<V> n = slide.n, u_bar = across_bar - dot(n, across_bar) * n;
        const V un = dot(slide.u, n), bn = dot(across_bar, n);
        const Vec3<V> n_bar = (-bn) * slide.u - un * across_bar;
        for (int c = 0; c < 4; ++c) {
            v_bar[c] = v_bar[c] + s_[c] * u_bar;
            s_bar[c] += dot(v[c], u_bar);
        }
        const V W = weight();
        const V depth_bar = select(touches(), N_bar * W * stiffness, V{});
        const Vec3<V> way_bar = per_length_ * (n_bar - dot(n, n_bar) * n) - depth_bar * n;
        stiffness_bar += N_bar * W * depth_;
        const V a_bar = s_bar[1] - s_bar[I] + dot(D_[0], way_bar) + depth_bar * reach_by_a_;
        const V b_bar = s_bar[J] - s_bar[3] + dot(D_[1], way_bar) + depth_bar * reach_by_b_;
        pull_back(way_bar, a_bar, b_bar, N_bar * stiffness * depth_, x_bar);
    }

private:
    Products<T> of_;
    Vec3<T> D_[2] = {}, way_;
    T a_ = {}, b_ = {}, G00_, G01_ = {}, G11_ = {};  // G: what a and b change with minus the products of D and the way
    T s_[4] = {}, per_length_, length_, depth_;
    V reach_by_a_ = {}, reach_by_b_ = {};  // derivatives of the sum of both things' reach
    T per_squares_;  // of edges: over the product of their squared lengths
    Mask<V> crosses_;

    struct Faded {
        T value = {}, slope = {};
    };

    static T constant(S value) { return lifted<T>(splat<V>(value)); }

    // Of both things, where they are nearest.
    T reach_at_nearest(const V (&reach)[4]) {
        if constexpr (!UNLIKE) return lifted<T>(reach[0] + reach[1]);
        const V along = reach[1] - reach[I];
        reach_by_a_ = KIND == EDGES ? along : -along;
        reach_by_b_ = reach[3] - reach[J];
        return lifted<T>(reach[0] + reach[J]) + a_ * lifted<T>(reach_by_a_) + b_ * lifted<T>(reach_by_b_);
    }

    void place_on_part(const Part<V>& part) {
        const T da = lifted<T>(part.da), db = lifted<T>(part.db), a = lifted<T>(part.a), b = lifted<T>(part.b);
        const auto [A00, A01, A11, r0, r1] = of_;
        if constexpr (KIND == POINT_SEGMENT) {
            G00_ = da / A00;
            a_ = a + G00_ * r0;
            return;
        }
        const T border = da * da * A00 + constant(2) * da * db * A01 + db * db * A11;
        const T size = select(part.whole, A00 * A11 - A01 * A01, select(border > T{}, border, constant(1)));
        const T inverse = constant(1) / size;
        G00_ = inverse * select(part.whole, A11, da * da);
        G01_ = inverse * select(part.whole, -A01, da * db);
        G11_ = inverse * select(part.whole, A00, db * db);
        const T to_a = r0 - a * A00 - b * A01, to_b = r1 - a * A01 - b * A11;
        a_ = a + G00_ * to_a + G01_ * to_b;
        b_ = b + G01_ * to_a + G11_ * to_b;
    }

    void place_on_edges() {
        const T squares = of_.A00 * of_.A11, across = squares - of_.A01 * of_.A01;
        crosses_ = across > constant(SHALLOW) * squares;
        const Mask<V> distinct = across > constant(SHALLOW / 2) * squares;
        of_.A01 = select(distinct, of_.A01, T{});
        const T inverse = constant(1) / select(distinct, across, squares);
        G00_ = inverse * of_.A11;
        G01_ = -inverse * of_.A01;
        G11_ = inverse * of_.A00;
        a_ = G00_ * of_.r0 + G01_ * of_.r1;
        b_ = G01_ * of_.r0 + G11_ * of_.r1;
        per_squares_ = constant(1) / squares;
    }

    T weight() const {
        if constexpr (KIND != EDGES) return constant(1);
        return bump(a_).value * bump(b_).value * crossing().value;
    }
    Faded crossing() const { return ramp(constant(1) - of_.A01 * of_.A01 * per_squares_); }

    static Faded bump(T a) {
        const T one = constant(1), other = one - a;
        const Mask<V> within = (a > T{}) & (other > T{});
        const T both = a * other;
        return {select(within, constant(16) * both * both, T{}), select(within, constant(32) * both * (other - a), T{})};
    }
    static Faded ramp(T squared_sine) {
        const T u = (squared_sine - constant(SHALLOW)) * constant(1 / (STEEP - SHALLOW)), one = constant(1);
        const Mask<V> low = u <= T{}, high = u >= one;
        const T value = select(low, T{}, select(high, one, u * u * (constant(3) - constant(2) * u)));
        return {value, select(low | high, T{}, constant(6 / (STEEP - SHALLOW)) * u * (one - u))};
    }

    // Adds to x_bar what comes from the adjoints of the way, of a, of b and of the weight W.
    void pull_back(const Vec3<T>& way_bar, T a_bar, T b_bar, T weight_bar, Vec3<T> (&x_bar)[4]) const {
        Vec3<T> D_bar[2] = {};
        if constexpr (KIND == EDGES) {
            const Faded first = bump(a_), second = bump(b_), cross = crossing();
            a_bar = a_bar + weight_bar * first.slope * second.value * cross.value;
            b_bar = b_bar + weight_bar * first.value * second.slope * cross.value;
            const T bar = constant(2) * weight_bar * first.value * second.value * cross.slope * of_.A01 * per_squares_;
            const T both = of_.A01 * per_squares_;
            D_bar[0] = bar * (both * of_.A11 * D_[0] - D_[1]);
            D_bar[1] = bar * (both * of_.A00 * D_[1] - D_[0]);
        }
        const T along = G00_ * a_bar + G01_ * b_bar, beside = G01_ * a_bar + G11_ * b_bar;
        const Vec3<T> kept = way_bar - along * D_[0] - beside * D_[1];
        D_bar[0] = D_bar[0] - along * way_;
        D_bar[1] = D_bar[1] - beside * way_;
        for (int c = 0; c < 4; ++c) x_bar[c] = x_bar[c] + s_[c] * kept;
        x_bar[1] = x_bar[1] + D_bar[0];
        x_bar[I] = x_bar[I] - D_bar[0];
        x_bar[J] = x_bar[J] + D_bar[1];
        x_bar[3] = x_bar[3] - D_bar[1];
    }

    // How the layers slide: mu normal over across is the friction.
    struct Slide {
        V normal, speed, per_speed, over, over_by_speed, over_by_e;
        Vec3<V> n, u = {}, across;

        Slide(const Contact& o, V stiffness, const LayerFriction<V>& law, const Vec3<V> (&v)[4]) {
            normal = o.weight() * stiffness * o.depth_;
            n = o.per_length_ * o.way_;
            for (int c = 0; c < 4; ++c) u = u + o.s_[c] * v[c];
            across = u - dot(u, n) * n;
            const V squared = dot(across, across) + splat<V>(S(1e-20));
            per_speed = inverse_sqrt(squared);
            speed = squared * per_speed;
            const V e = law.speed + law.softening * law.coefficient * normal, inverse = S(1) / e;
            const Mask<V> sticks = speed < e;
            over = select(sticks, (S(2) - speed * inverse) * inverse, per_speed);
            over_by_speed = select(sticks, -inverse * inverse, -per_speed * per_speed);
            over_by_e = select(sticks, S(2) * inverse * inverse * (speed * inverse - S(1)), V{});
        }
    };
};

// From the adjoint `bar` of the forces without friction; adds to those of x and of the stiffness. The energy's second derivatives are symmetric, so
// the adjoint of x is the slope of the forces along that of the forces.
template <int KIND, bool UNLIKE, class V>
inline void normal_adjoint(const Vec3<V> (&x)[4], const Vec3<V> (&bar)[4], const V (&reach)[4], V stiffness, Vec3<V> (&x_bar)[4],
                           V& stiffness_bar) {
    Vec3<Dual<V>> moved[4], f[4] = {};
    for (int c = 0; c < 4; ++c)
        for (int d = 0; d < 3; ++d) moved[c][d] = {x[c][d], bar[c][d]};
    const Contact<KIND, UNLIKE, Dual<V>, V> contact(moved, reach);
    contact.forces(stiffness, f);
    stiffness_bar -= contact.energy().slope;
    for (int c = 0; c < 4; ++c)
        for (int d = 0; d < 3; ++d) x_bar[c][d] += f[c][d].slope;
}

}  // namespace physreal
