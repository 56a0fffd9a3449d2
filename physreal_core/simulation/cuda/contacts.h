// Contact of a body with itself in all rollouts at once.
//
// Every few substeps the pairs within the distance and a margin are listed; each that touches leaves forces at its corners, or adjoints. Threads
// list and add up in any order. What they add up are whole numbers of small units, whose sum does not depend on the order, so that a rerun
// gives the same bytes. What is listed does not change the result, as long as no vertex goes farther than half the margin before pairs are listed anew:
// the host learns how far they went (`contact_moved`), and repeats the frame with more lists where that was too far.
#pragma once
#include "contact.h"
#include "forces.h"

namespace physreal {

// CHUNK points, faces or edges lie beside each other (contacts.py): of the balls around such chunks most are apart. There is a thread for PAIRS pairs
// for which there is room.

inline void add_to(Index* sum, Index value) {
#if defined(__CUDA_ARCH__)
    atomicAdd((unsigned long long*)sum, (unsigned long long)value);
#else
    *sum += value;
#endif
}
inline int next_of(int* count) {
#if defined(__CUDA_ARCH__)
    return atomicAdd(count, 1);
#else
    return (*count)++;
#endif
}
inline void raise_to(int* entry, int value) {
#if defined(__CUDA_ARCH__)
    atomicMax(entry, value);
#else
    if (value > *entry) *entry = value;
#endif
}
// Of numbers that are not negative: their bits rise with them.
inline void raise_to(float* entry, float value) {
    if (!(value > *entry)) return;
#if defined(__CUDA_ARCH__)
    atomicMax((int*)entry, __float_as_int(value));
#else
    *entry = value;
#endif
}

// A number as a multiple of a unit.
template <class S>
inline Index in_units(S value, double unit) {
    const double many = double(value) / unit;
    return Index(many < 0 ? many - 0.5 : many + 0.5);
}

// What a rollout's particles, or vertices, learn of contact.
template <class S>
struct ContactSums {
    enum : int { X_BAR, V_BAR = 3, MODULUS_BAR = 6, COUNT = 7 };  // of the adjoint; a force comes first, too

    const Frame<S>& f;
    const int rollout;

    Index* of(Index p) const { return f.contact_sums + COUNT * p; }
    // The largest number of the forces' adjoint after a substep.
    float& largest(int slot) const { return f.contact_largest[2 * rollout + (slot & 1)]; }

    double force_unit() const { return f.contact_scale[rollout] * f.contact_distance * 0x1p-50; }
    // Of an entry of the adjoint.
    double bar_unit(int slot, int entry) const {
        const double bar = double(largest(slot)) * 0x1p-44, stiffness = f.contact_scale[rollout];
        if (entry == MODULUS_BAR) return bar * f.contact_size * f.contact_distance;
        return bar * stiffness * (entry < V_BAR ? 1.0 : f.contact_distance / f.layer_speed);
    }
    double friction_unit(int slot) const {
        return double(largest(slot)) * 0x1p-44 * f.contact_scale[rollout] * f.contact_distance;
    }

    Vec3<S> take_force(Index p) const {
        Vec3<S> sum;
        for (int d = 0; d < 3; ++d) sum[d] = S(double(take(of(p)[d])) * force_unit());
        return sum;
    }

    // Adds what pairs left of the substep in a slot to the adjoints of the state before it, and to those of Young's modulus and friction.
    void add_bars(Index p, int own, int slot, Vec3<S>& x_bar, Vec3<S>& v_bar) const {
        for (int d = 0; d < 3; ++d) {
            x_bar[d] += take_bar(p, X_BAR + d, slot);
            v_bar[d] += take_bar(p, V_BAR + d, slot);
        }
        f.bars[bar::youngs_modulus * f.stride + p] += take_bar(p, MODULUS_BAR, slot);
        if (own == 0) f.node_sums[(node_sum::layer_friction * f.rollouts + rollout) * f.nodes] += take_friction(slot);
    }

    // Keeps the adjoint of the forces after a substep for the pairs.
    void keep(Index p, int slot, const Vec3<S>& force_bar) const {
        reinterpret_cast<Vec4<S>*>(f.contact_force_bar)[p] = {{force_bar[0], force_bar[1], force_bar[2], 0}};
        for (int d = 0; d < 3; ++d) raise_to(&largest(slot), float(force_bar[d] < 0 ? -force_bar[d] : force_bar[d]));
    }

    // Tells how far a particle has come since pairs were listed.
    void follow(Index p, const Vec3<S>& x) const {
        const S* from = f.contact_place + 3 * p;
        const Vec3<S> way = x - Vec3<S>{{from[0], from[1], from[2]}};
        raise_to(f.contact_moved, float(sqrt(dot(way, way))));
    }

private:
    S take_bar(Index p, int entry, int slot) const { return S(double(take(of(p)[entry])) * bar_unit(slot, entry)); }
    S take_friction(int slot) const { return S(double(take(f.contact_friction_bar[rollout])) * friction_unit(slot)); }
    static Index take(Index& sum) {
        const Index value = sum;
        sum = 0;
        return value;
    }
};

// One of the pairs of a rollout, or one of the threads that look for them. FACE, UNLIKE: see native/contacts.h.
template <class S, int FACE, bool UNLIKE>
class ContactOfRollout {
    static constexpr int FACES = FACE == 3 ? POINT_TRIANGLE : POINT_SEGMENT;
    using Corners = Vec3<S>[4];
    const Frame<S>& f_;

public:
    explicit ContactOfRollout(const Frame<S>& f) : f_(f) {}

    // Before pairs are listed; thread: of the vertices of all rollouts.
    void clear(int thread, int slot) const {
        const S* from = f_.x + 3 * (Index(f_.first[0] + slot) * f_.stride + thread);
        for (int d = 0; d < 3; ++d) f_.contact_place[3 * Index(thread) + d] = from[d];
        if (thread < 2 * f_.rollouts) f_.pair_count[thread] = 0;
        if (thread < f_.rollouts) f_.chunk_pair_count[thread] = 0;
        const int own = chunks();
        if (thread < own * f_.rollouts) bound(thread / own, thread % own, slot);
    }

    // Pairs of chunks that are near each other; thread: of the pairs of all chunks of all rollouts.
    void match(int thread) const {
        const int all = chunks(), rollout = thread / (all * all), one = thread / all % all, other = thread % all;
        const bool faces = one < point_chunks() && other >= point_chunks() && other < edge_chunk(0);
        if (!(faces || (one >= edge_chunk(0) && other >= one)) || !near(rollout, one, other)) return;
        const int number = next_of(f_.chunk_pair_count + rollout);
        if (number >= f_.chunk_pair_capacity) return raise_to(f_.pairs_needed + 1, number + 1);
        f_.chunk_pairs[rollout * f_.chunk_pair_capacity + number] = all * one + other;
    }

    // Thread: of the room for pairs of chunks, times the things of one chunk.
    void list(int thread, int slot) const {
        const int lane = thread % CHUNK, number = int(thread / CHUNK % f_.chunk_pair_capacity);
        const int rollout = int(thread / CHUNK / f_.chunk_pair_capacity);
        if (number >= f_.chunk_pair_count[rollout]) return;
        const int pair = f_.chunk_pairs[rollout * f_.chunk_pair_capacity + number], one = pair / chunks(), other = pair % chunks();
        if (one < point_chunks())
            list_faces(rollout, slot, CHUNK * one + lane, other - point_chunks());
        else
            list_edges(rollout, slot, CHUNK * (one - edge_chunk(0)) + lane, other - edge_chunk(0));
    }

    // Before the adjoint of a frame; thread: of the rollouts.
    void begin_adjoint(int thread) const {
        for (int slot = 0; slot < 2; ++slot) ContactSums<S>{f_, thread}.largest(slot) = 0;
    }

    // Leaves forces of the state in a slot; thread: of those that go through pairs.
    void forward(int thread, int slot) const {
        with_pair(thread, [&](auto kind, int rollout, const int* pair) { this->template leave_forces<decltype(kind)::KIND>(rollout, slot, pair); });
    }

    // Leaves what the forces' adjoint, which stands in contact_force_bar, adds to those of the state in a slot.
    void backward(int thread, int slot) const {
        if (thread < f_.rollouts) ContactSums<S>{f_, thread}.largest(slot + 1) = 0;  // for the substep before
        with_pair(thread, [&](auto kind, int rollout, const int* pair) { this->template leave_adjoints<decltype(kind)::KIND>(rollout, slot, pair); });
    }

private:
    template <int KIND_>
    struct Kind {
        static constexpr int KIND = KIND_;
    };

    // Chunks of points come first, then those of faces and of edges.
    static int chunks_of(Index count) { return int((count + CHUNK - 1) / CHUNK); }
    int point_chunks() const { return chunks_of(f_.contact_points); }
    int edge_chunk(int number) const { return point_chunks() + chunks_of(f_.contact_faces) + number; }
    int chunks() const { return edge_chunk(chunks_of(f_.contact_edges)); }
    const int* face(int i) const { return f_.contact_face + FACE * i; }
    const int* edge(int i) const { return f_.contact_edge + 2 * i; }
    Index vertex(int rollout, int own) const { return Index(rollout) * f_.particles + own; }
    Vec3<S> place(const S* states, int rollout, int slot, int own) const {
        const S* from = states + 3 * (Index(f_.first[0] + slot) * f_.stride + vertex(rollout, own));
        return {{from[0], from[1], from[2]}};
    }
    void corners(const S* states, int rollout, int slot, const int* pair, Corners& values) const {
        for (int c = 0; c < 4; ++c) values[c] = place(states, rollout, slot, pair[c]);
    }
    int* pairs(int which, int rollout) const { return f_.pairs + 4 * (Index(which) * f_.rollouts + rollout) * f_.pair_capacity; }

    template <class Use>
    void with_pair(int thread, Use use) const {
        const int step = int((f_.pair_capacity + PAIRS - 1) / PAIRS), list = thread / step;
        const int which = list / int(f_.rollouts), rollout = list % int(f_.rollouts);
        const int listed = f_.pair_count[list], count = listed < f_.pair_capacity ? listed : int(f_.pair_capacity);
        for (int number = thread % step; number < count; number += step) {
            const int* pair = pairs(which, rollout) + 4 * Index(number);
            if (which == 0)
                use(Kind<FACES>(), rollout, pair);
            else
                use(Kind<EDGES>(), rollout, pair);
        }
    }

    // --- which pairs may touch

    S* ball(int rollout, int chunk) const { return f_.contact_balls + 4 * (Index(rollout) * chunks() + chunk); }
    void bound(int rollout, int chunk, int slot) const {
        const bool points = chunk < point_chunks(), edges = chunk >= edge_chunk(0);
        const int* things = points ? f_.contact_point : edges ? f_.contact_edge : f_.contact_face;
        const int corners = points ? 1 : edges ? 2 : FACE, first = points ? 0 : edges ? edge_chunk(0) : point_chunks();
        const int all = int(points ? f_.contact_points : edges ? f_.contact_edges : f_.contact_faces);
        const int begin = CHUNK * (chunk - first), end = begin + CHUNK < all ? begin + CHUNK : all;
        const Vec3<S> middle = place(f_.x, rollout, slot, things[corners * ((begin + end) / 2)]);
        S squared = 0;
        FOUR_AT_A_TIME for (int i = corners * begin; i < corners * end; ++i) {
            const Vec3<S> way = place(f_.x, rollout, slot, things[i]) - middle;
            squared = max(squared, dot(way, way));
        }
        S* to = ball(rollout, chunk);
        for (int d = 0; d < 3; ++d) to[d] = middle[d];
        to[3] = sqrt(squared);
    }
    S reach() const { return f_.contact_distance + 2 * f_.contact_margin; }
    bool near(int rollout, int one, int other) const {
        const S *a = ball(rollout, one), *b = ball(rollout, other);
        const Vec3<S> way = {{a[0] - b[0], a[1] - b[1], a[2] - b[2]}};
        const S most = reach() + a[3] + b[3];
        return dot(way, way) <= most * most;
    }

    // Whether two vertices hang together so closely that they never touch.
    bool together(int p, int q) const {
        for (int n = f_.near_first[p]; n < f_.near_first[p + 1]; ++n)
            if (f_.near[n] == q) return true;
        return false;
    }

    void list_faces(int rollout, int slot, int point, int chunk) const {
        if (point >= f_.contact_points) return;
        const int p = f_.contact_point[point], begin = CHUNK * chunk;
        const int end = begin + CHUNK < f_.contact_faces ? begin + CHUNK : int(f_.contact_faces);
        const Vec3<S> x = place(f_.x, rollout, slot, p);
        for (int i = begin; i < end; ++i) {
            const int *own = face(i), pair[4] = {p, own[0], own[1], own[FACE - 1]};
            const S longest = spread(rollout, slot, own, FACE), way = distance_to_first(x, rollout, slot, own);
            if (!(way <= reach() + longest)) continue;
            bool apart = true;
            for (int c = 0; c < FACE; ++c) apart = apart && !together(p, own[c]);
            if (apart) propose<FACES>(0, rollout, slot, pair);
        }
    }

    void list_edges(int rollout, int slot, int e, int chunk) const {
        if (e >= f_.contact_edges) return;
        const int *own = edge(e), begin = CHUNK * chunk;
        const int end = begin + CHUNK < f_.contact_edges ? begin + CHUNK : int(f_.contact_edges);
        const Vec3<S> x = place(f_.x, rollout, slot, own[0]);
        const S length = spread(rollout, slot, own, 2);
        for (int i = begin > e ? begin : e + 1; i < end; ++i) {
            const int *other = edge(i), pair[4] = {own[0], own[1], other[0], other[1]};
            const S way = distance_to_first(x, rollout, slot, other);
            if (!(way <= reach() + length + spread(rollout, slot, other, 2))) continue;
            bool apart = true;
            for (int c = 0; c < 2; ++c) apart = apart && !together(own[0], other[c]) && !together(own[1], other[c]);
            if (apart) propose<EDGES>(1, rollout, slot, pair);
        }
    }

    // From the first corner of a thing to the farthest other one.
    S spread(int rollout, int slot, const int* thing, int count) const {
        S most = 0;
        const Vec3<S> first = place(f_.x, rollout, slot, thing[0]);
        for (int c = 1; c < count; ++c) most = max(most, distance_to_first(first, rollout, slot, thing + c));
        return most;
    }
    S distance_to_first(const Vec3<S>& x, int rollout, int slot, const int* thing) const {
        const Vec3<S> way = x - place(f_.x, rollout, slot, thing[0]);
        return sqrt(dot(way, way));
    }

    template <int KIND>
    void propose(int which, int rollout, int slot, const int* pair) const {
        Corners x;
        corners(f_.x, rollout, slot, pair, x);
        S way;
        if constexpr (KIND == EDGES) {
            way = sqrt(squared_distance_of_edges(x));
        } else {
            const S none[4] = {};
            way = Contact<KIND, UNLIKE, S, S>(x, none).length();
        }
        if (!(way <= reach())) return;
        const int number = next_of(f_.pair_count + which * f_.rollouts + rollout);
        if (number >= f_.pair_capacity) return raise_to(f_.pairs_needed, number + 1);
        for (int c = 0; c < 4; ++c) pairs(which, rollout)[4 * Index(number) + c] = pair[c];
    }

    // --- forces

    template <int KIND>
    static constexpr int corner_count() {
        return KIND == POINT_SEGMENT ? 3 : 4;
    }
    // A pair's stiffness over the sum of the Young's moduli at its corners [m], and that sum [Pa].
    template <int KIND>
    void stiffness(int rollout, const int* pair, S& by_modulus, S& moduli) const {
        S weight = f_.contact_weight[pair[0]];
        moduli = 0;
        for (int c = 0; c < corner_count<KIND>(); ++c) {
            moduli += f_.constants[constant::youngs_modulus * f_.stride + vertex(rollout, pair[c])];
            if (KIND == EDGES) weight = min(weight, f_.contact_weight[pair[c]]);
        }
        by_modulus = f_.contact_size / S(corner_count<KIND>()) * weight;
    }
    void reaches(const int* pair, S (&reach)[4]) const {
        for (int c = 0; c < 4; ++c) reach[c] = UNLIKE ? f_.contact_reach[pair[c]] : S(0.5) * f_.contact_distance;
    }
    LayerFriction<S> friction(int rollout) const {
        return {f_.layer_friction[rollout], f_.layer_speed, f_.layer_softening * f_.timing[0]};
    }

    template <int KIND>
    void leave_forces(int rollout, int slot, const int* pair) const {
        Corners x, v, force = {};
        S reach[4], by_modulus, moduli;
        reaches(pair, reach);
        corners(f_.x, rollout, slot, pair, x);
        const Contact<KIND, UNLIKE, S, S> contact(x, reach);
        if (!contact.touches()) return;
        corners(f_.v, rollout, slot, pair, v);
        stiffness<KIND>(rollout, pair, by_modulus, moduli);
        contact.forces(by_modulus * moduli, force);
        contact.friction(by_modulus * moduli, friction(rollout), v, force);
        const ContactSums<S> sums{f_, rollout};
        const double unit = sums.force_unit();
        for (int c = 0; c < corner_count<KIND>(); ++c)
            for (int d = 0; d < 3; ++d) add_to(sums.of(vertex(rollout, pair[c])) + d, in_units(force[c][d], unit));
    }

    template <int KIND>
    void leave_adjoints(int rollout, int slot, const int* pair) const {
        const ContactSums<S> sums{f_, rollout};
        if (!(sums.largest(slot) > 0)) return;
        Corners x, v, bar, x_bar = {}, v_bar = {};
        S reach[4], by_modulus, moduli, k_bar = 0, coefficient_bar = 0;
        reaches(pair, reach);
        corners(f_.x, rollout, slot, pair, x);
        const Contact<KIND, UNLIKE, S, S> contact(x, reach);
        if (!contact.touches()) return;
        corners(f_.v, rollout, slot, pair, v);
        for (int c = 0; c < 4; ++c) bar[c] = three(reinterpret_cast<const Vec4<S>*>(f_.contact_force_bar)[vertex(rollout, pair[c])]);
        stiffness<KIND>(rollout, pair, by_modulus, moduli);
        const S k = by_modulus * moduli;
        contact.friction_adjoint(k, friction(rollout), v, bar, x_bar, v_bar, k_bar, coefficient_bar);
        normal_adjoint<KIND, UNLIKE>(x, bar, reach, k, x_bar, k_bar);
        for (int c = 0; c < corner_count<KIND>(); ++c) {
            Index* sum = sums.of(vertex(rollout, pair[c]));
            for (int d = 0; d < 3; ++d) {
                add_to(sum + sums.X_BAR + d, in_units(x_bar[c][d], sums.bar_unit(slot, sums.X_BAR)));
                add_to(sum + sums.V_BAR + d, in_units(v_bar[c][d], sums.bar_unit(slot, sums.V_BAR)));
            }
            add_to(sum + sums.MODULUS_BAR, in_units(by_modulus * k_bar, sums.bar_unit(slot, sums.MODULUS_BAR)));
        }
        add_to(f_.contact_friction_bar + rollout, in_units(coefficient_bar, sums.friction_unit(slot)));
    }
};

// Entry points: one pair, or one of the threads that look for them, of all rollouts.
template <class S, int FACE, bool UNLIKE>
struct ContactStep {
    using Pairs = ContactOfRollout<S, FACE, UNLIKE>;

    static void clear_pairs(const Frame<S>& f, int thread, int slot) { Pairs(f).clear(thread, slot); }
    static void match_chunks(const Frame<S>& f, int thread) { Pairs(f).match(thread); }
    static void list_pairs(const Frame<S>& f, int thread, int slot) { Pairs(f).list(thread, slot); }
    static void touch(const Frame<S>& f, int thread, int slot) { Pairs(f).forward(thread, slot); }
    static void begin_adjoint(const Frame<S>& f, int thread) { Pairs(f).begin_adjoint(thread); }
    static void touch_adjoint(const Frame<S>& f, int thread, int slot) { Pairs(f).backward(thread, slot); }
};

}  // namespace physreal
