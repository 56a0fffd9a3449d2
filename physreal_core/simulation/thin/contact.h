// Two simplices of thin bodies that come nearer than a distance (contact.py): a point and a triangle, a point and a segment, two edges.
//
// The way between their nearest points is g = sum_c s_c x_c over four corners, where s = base + a first + b second, with a and b such that g
// is shortest. Which of a and b are free depends on where the nearest point lies: within a triangle both, on its border one, at a corner none.
// With depth = distance - |g| > 0 the energy is W k depth^2 / 2. W is 1 where a point takes part. Of two edges it is
//     W = bump(a) bump(b) crossing(sin^2 of the angle between them) ,
// which fades towards their ends, where points and faces meet, and towards parallel edges, which have no nearest points.
// Friction acts against the difference u of the velocities across g: mu N u / |u|, with N = W k depth, smoothed below a speed e as by Li et
// al. (ACM TOG 39, 2020, "Incremental potential contact"): mu N (2 - |u| / e) u / e.
#pragma once
#include "elements.h"

namespace physreal {

enum ContactKind : int { POINT_TRIANGLE, POINT_SEGMENT, EDGES };

// How s may change: see above.
template <class V>
struct Freedom {
    V base[4] = {}, first[4] = {}, second[4] = {};
};

template <class V>
inline V chosen(Mask<V> mask, Scalar<V> where_set, Scalar<V> elsewhere) {
    return select(mask, splat<V>(where_set), splat<V>(elsewhere));
}

// Of point x[0] and the segment from corner i to j.
template <class V>
inline Freedom<V> segment_freedom(const Vec3<V> (&x)[4], int i, int j) {
    const Vec3<V> edge = x[j] - x[i];
    const V along = dot(x[0] - x[i], edge), length = dot(edge, edge);
    const Mask<V> before = along <= Scalar<V>(0), behind = along >= length;
    Freedom<V> f;
    f.base[0] = splat<V>(1);
    f.base[i] = chosen<V>(behind, 0, -1);
    f.base[j] = chosen<V>(behind, -1, 0);
    f.first[i] = chosen<V>(before | behind, 0, 1);
    f.first[j] = chosen<V>(before | behind, 0, -1);
    return f;
}

// Square of the shortest way of point x[0] to the segment.
template <class V>
inline V squared_way(const Vec3<V> (&x)[4], int i, int j) {
    const Vec3<V> edge = x[j] - x[i], to = x[0] - x[i];
    const V t = max(V{}, min(splat<V>(1), dot(to, edge) / dot(edge, edge)));
    const Vec3<V> way = to - t * edge;
    return dot(way, way);
}

template <class V>
inline void take(Freedom<V>& into, Mask<V> mask, const Freedom<V>& other) {
    for (int c = 0; c < 4; ++c) {
        into.base[c] = select(mask, other.base[c], into.base[c]);
        into.first[c] = select(mask, other.first[c], into.first[c]);
        into.second[c] = select(mask, other.second[c], into.second[c]);
    }
}

template <class V>
inline Freedom<V> triangle_freedom(const Vec3<V> (&x)[4]) {
    const Vec3<V> e = x[2] - x[1], f = x[3] - x[1], w = x[0] - x[1];
    const V ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), we = dot(w, e), wf = dot(w, f);
    const V p = ff * we - ef * wf, q = ee * wf - ef * we, whole = ee * ff - ef * ef;
    const Mask<V> inside = (p > Scalar<V>(0)) & (q > Scalar<V>(0)) & (p + q < whole);
    Freedom<V> border = segment_freedom(x, 1, 2);
    V nearest = squared_way(x, 1, 2);
    for (int i = 2; i < 4; ++i) {
        const int j = i == 2 ? 3 : 1;
        const V way = squared_way(x, i, j);
        take(border, way < nearest, segment_freedom(x, i, j));
        nearest = min(nearest, way);
    }
    Freedom<V> within;
    const Scalar<V> base[4] = {1, -1, 0, 0}, first[4] = {0, 1, -1, 0}, second[4] = {0, 1, 0, -1};
    for (int c = 0; c < 4; ++c) {
        within.base[c] = splat<V>(base[c]);
        within.first[c] = splat<V>(first[c]);
        within.second[c] = splat<V>(second[c]);
    }
    take(border, inside, within);
    return border;
}

template <int KIND, class V>
inline Freedom<V> freedom_of(const Vec3<V> (&x)[4]) {
    if constexpr (KIND == POINT_TRIANGLE) return triangle_freedom(x);
    if constexpr (KIND == POINT_SEGMENT) return segment_freedom(x, 1, 2);
    Freedom<V> f;
    const Scalar<V> base[4] = {1, 0, -1, 0}, first[4] = {-1, 1, 0, 0}, second[4] = {0, 0, 1, -1};
    for (int c = 0; c < 4; ++c) {
        f.base[c] = splat<V>(base[c]);
        f.first[c] = splat<V>(first[c]);
        f.second[c] = splat<V>(second[c]);
    }
    return f;
}

// Square of the distance between edges x[0] x[1] and x[2] x[3]: one of a point of either where their lines' nearest points lie outside.
template <class V>
inline V squared_distance_of_edges(const Vec3<V> (&x)[4]) {
    const Vec3<V> swapped[4] = {x[2], x[0], x[1], x[3]}, end[4] = {x[3], x[0], x[1], x[2]};
    const Vec3<V> other[4] = {x[1], x[1], x[2], x[3]}, own[4] = {x[0], x[1], x[2], x[3]};
    V least = min(min(squared_way(swapped, 1, 2), squared_way(end, 1, 2)), min(squared_way(own, 2, 3), squared_way(other, 2, 3)));
    const Vec3<V> u = x[1] - x[0], v = x[3] - x[2], w = x[0] - x[2];
    const V uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), wu = dot(w, u), wv = dot(w, v);
    const V whole = uu * vv - uv * uv, a = uv * wv - vv * wu, b = uu * wv - uv * wu;
    const Mask<V> inside = (a > V{}) & (a < whole) & (b > V{}) & (b < whole);
    const V volume = dot(w, cross(u, v));
    return select(inside, volume * volume / select(inside, whole, splat<V>(1)), least);
}

// What friction between layers follows from.
template <class V>
struct LayerFriction {
    V coefficient, speed;  // speed: below which it is smoothed [m/s]
    V softening;           // which grows with the largest friction, so that steps are stable [m/s/N]
};

template <int KIND, class T, class V>
class Contact {
    using S = Scalar<V>;
    static constexpr S SHALLOW = S(0.01), STEEP = S(0.1);  // sin^2 between which edges come to count as crossing

public:
    Contact(const Vec3<V> (&at)[4], const Vec3<T> (&x)[4], V distance) : free_(freedom_of<KIND, V>(at)) {
        const T one = constant(1);
        Vec3<T> from = {};
        for (int c = 0; c < 4; ++c) {
            from = from + lifted<T>(free_.base[c]) * x[c];
            D_[0] = D_[0] + lifted<T>(free_.first[c]) * x[c];
            D_[1] = D_[1] + lifted<T>(free_.second[c]) * x[c];
        }
        A00_ = dot(D_[0], D_[0]) + lifted<T>(fixed(free_.first));
        A11_ = dot(D_[1], D_[1]) + lifted<T>(fixed(free_.second));
        A01_ = dot(D_[0], D_[1]);
        weight_ = one;
        if constexpr (KIND == EDGES) {
            const T squared_sine = one - A01_ * A01_ / (A00_ * A11_);
            cross_ = ramp(squared_sine);
            A01_ = select(squared_sine > constant(SHALLOW / 2), A01_, T{});
        }
        const T whole = A00_ * A11_ - A01_ * A01_, r0 = -dot(D_[0], from), r1 = -dot(D_[1], from);
        inverse_ = one / whole;
        a_ = inverse_ * (A11_ * r0 - A01_ * r1);
        b_ = inverse_ * (A00_ * r1 - A01_ * r0);
        way_ = from + a_ * D_[0] + b_ * D_[1];
        for (int c = 0; c < 4; ++c)
            s_[c] = lifted<T>(free_.base[c]) + a_ * lifted<T>(free_.first[c]) + b_ * lifted<T>(free_.second[c]);
        length_ = sqrt(dot(way_, way_) + constant(S(1e-20)));
        const T deep = lifted<T>(distance) - length_;
        depth_ = select(deep > T{}, deep, T{});
        if constexpr (KIND == EDGES) weight_ = bump(a_).value * bump(b_).value * cross_.value;
    }

    // Lanes in which there is a force.
    Mask<V> touches() const { return (depth_ > T{}) & (weight_ > T{}); }

    // How far the nearest points are apart; of edges those of their lines.
    T length() const { return length_; }

    // Energy over stiffness.
    T energy() const { return constant(S(0.5)) * weight_ * depth_ * depth_; }

    // Subtracts the energy's derivative by x from f.
    void forces(V stiffness, Vec3<T> (&f)[4]) const {
        const T k = lifted<T>(stiffness);
        const Vec3<T> way_bar = -(k * weight_ * depth_ / length_) * way_;
        Vec3<T> x_bar[4] = {};
        T s_bar[4] = {};
        pull_back(way_bar, s_bar, constant(S(0.5)) * k * depth_ * depth_, x_bar);
        for (int c = 0; c < 4; ++c) f[c] = f[c] - x_bar[c];
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
        Vec3<V> across_bar = (mu * N * slide.over) * pull_bar + (over_bar * slide.over_by_speed / slide.speed) * slide.across;
        coefficient_bar += N * slide.over * size_bar + e_bar * law.softening * N;
        const V N_bar = mu * slide.over * size_bar + e_bar * law.softening * mu;
        const Vec3<V> n = slide.n, u_bar = across_bar - dot(n, across_bar) * n;
        const V un = dot(slide.u, n), bn = dot(across_bar, n);
        const Vec3<V> n_bar = (-bn) * slide.u - un * across_bar;
        for (int c = 0; c < 4; ++c) {
            v_bar[c] = v_bar[c] + s_[c] * u_bar;
            s_bar[c] += dot(v[c], u_bar);
        }
        const Vec3<V> way_bar = (S(1) / length_) * (n_bar - dot(n, n_bar) * n)
                                - select(touches(), N_bar * weight_ * stiffness, V{}) * n;
        stiffness_bar += N_bar * weight_ * depth_;
        pull_back(way_bar, s_bar, N_bar * stiffness * depth_, x_bar);
    }

private:
    Freedom<V> free_;
    Vec3<T> D_[2] = {}, way_;
    T A00_, A11_, A01_, inverse_, a_, b_, s_[4], length_, depth_, weight_;

    struct Faded {
        T value = {}, slope = {};
    };
    Faded cross_;

    static T constant(S value) { return lifted<T>(splat<V>(value)); }
    // One where a direction is not free, so that it has an inverse.
    static V fixed(const V (&direction)[4]) {
        V size = {};
        for (int c = 0; c < 4; ++c) size += direction[c] * direction[c];
        return select(size > V{}, V{}, splat<V>(1));
    }

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

    // Adds to x_bar what comes from the adjoints of the way, of s and of the weight W.
    void pull_back(const Vec3<T>& way_bar, const T (&s_bar)[4], T weight_bar, Vec3<T> (&x_bar)[4]) const {
        T a_bar = dot(D_[0], way_bar), b_bar = dot(D_[1], way_bar);
        for (int c = 0; c < 4; ++c) {
            a_bar = a_bar + lifted<T>(free_.first[c]) * s_bar[c];
            b_bar = b_bar + lifted<T>(free_.second[c]) * s_bar[c];
        }
        Vec3<T> D_bar[2] = {};
        if constexpr (KIND == EDGES) {
            const Faded first = bump(a_), second = bump(b_);
            a_bar = a_bar + weight_bar * first.slope * second.value * cross_.value;
            b_bar = b_bar + weight_bar * first.value * second.slope * cross_.value;
            const T bar = constant(2) * weight_bar * first.value * second.value * cross_.slope * A01_ / (A00_ * A11_);
            D_bar[0] = bar * (A01_ / A00_ * D_[0] - D_[1]);
            D_bar[1] = bar * (A01_ / A11_ * D_[1] - D_[0]);
        }
        const T along = inverse_ * (A11_ * a_bar - A01_ * b_bar), beside = inverse_ * (A00_ * b_bar - A01_ * a_bar);
        const Vec3<T> kept = way_bar - along * D_[0] - beside * D_[1];
        D_bar[0] = D_bar[0] - along * way_;
        D_bar[1] = D_bar[1] - beside * way_;
        for (int c = 0; c < 4; ++c)
            x_bar[c] = x_bar[c] + s_[c] * kept + lifted<T>(free_.first[c]) * D_bar[0] + lifted<T>(free_.second[c]) * D_bar[1];
    }

    // How the layers slide: mu normal over across is the friction.
    struct Slide {
        V normal, speed, over, over_by_speed, over_by_e;
        Vec3<V> n, u = {}, across;

        Slide(const Contact& o, V stiffness, const LayerFriction<V>& law, const Vec3<V> (&v)[4]) {
            normal = o.weight_ * stiffness * o.depth_;
            n = (S(1) / o.length_) * o.way_;
            for (int c = 0; c < 4; ++c) u = u + o.s_[c] * v[c];
            across = u - dot(u, n) * n;
            speed = sqrt(dot(across, across) + splat<V>(S(1e-20)));
            const V e = law.speed + law.softening * law.coefficient * normal, inverse = S(1) / e;
            const Mask<V> sticks = speed < e;
            over = select(sticks, (S(2) - speed * inverse) * inverse, S(1) / speed);
            over_by_speed = select(sticks, -inverse * inverse, -S(1) / (speed * speed));
            over_by_e = select(sticks, S(2) * inverse * inverse * (speed * inverse - S(1)), V{});
        }
    };
};

}  // namespace physreal
