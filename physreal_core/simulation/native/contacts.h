// Contact of a thin body with itself, one thread's share: which pairs may touch, their forces, and the adjoint.
//
// Pairs within the distance and a margin are found anew whenever the vertices may have moved by the margin against each other. So no pair
// that touches is missed, and which pairs are listed does not change the result. A thread lists those of its own vertices and edges. A listed
// pair sleeps until its vertices may have moved by the distance between them; only those awake are looked at.
#pragma once
#include "barrier.h"
#include "contact.h"
#include "rows.h"

namespace physreal {

// FACE: corners of what points touch, 3 of a shell's triangles, 2 of a rod's segments.
template <class S, int FACE>
class Contacts : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Rows::first_, Rows::last_;
    static constexpr int FACES = FACE == 3 ? POINT_TRIANGLE : POINT_SEGMENT, X = 0, VELOCITY = 3, LEFT = 28;

public:
    Contacts(const ThinFrame<S>& frame, int thread, Barrier& barrier)
        : Rows(frame, thread), frame_(frame), thread_(thread), barrier_(barrier) {}

    bool on() const { return frame_.contact_distance > 0; }

    // A thread's own vertices move at most at this speed against the body's drift in a substep.
    void note_speed(Index substep, S squared) const { frame_.speeds[substep * frame_.threads + thread_] = sqrt(squared); }
    S drifting(const Vec3<S>& v) const {
        const S *d = frame_.contact_drift, x = v[0] - d[0], y = v[1] - d[1], z = v[2] - d[2];
        return x * x + y * y + z * z;
    }

    // All threads: lists the pairs anew where those from before no longer hold. between: the substep between then and now; -1 at first.
    void update(const S* now, Index between) {
        if (between >= 0) {
            S fastest = 0;
            for (Index t = 0; t < frame_.threads; t++) {
                const S speed = frame_.speeds[between * frame_.threads + t];
                if (speed > fastest) fastest = speed;
            }
            moved_ += frame_.dt * fastest;
            if (2 * moved_ < frame_.contact_margin) return;
        }
        moved_ = 0;
        find(now);
    }

    void leave_forces(const S* now) const {
        for_touching<FACES>(0, now, [&](auto pair) { leave_forces_of(pair, now); });
        for_touching<EDGES>(1, now, [&](auto pair) { leave_forces_of(pair, now); });
    }

    // In: frame.force_bar. Leaves adjoints of x, v and Young's modulus at the corners; friction_bar grows.
    void leave_adjoints(const S* now, S& friction_bar) const {
        for_touching<FACES>(0, now, [&](auto pair) { leave_adjoints_of(pair, now, friction_bar); });
        for_touching<EDGES>(1, now, [&](auto pair) { leave_adjoints_of(pair, now, friction_bar); });
    }

    // Calls visit(vertex, first of the rows that were left there for it, distance of rows, corner) for the thread's own vertices.
    template <class Visit>
    void for_left(Visit visit) const {
        for (Index n = 0; n < 2 * frame_.threads; n++) {  // faces first, whoever listed them
            const Index list = n < frame_.threads ? 2 * n : 2 * (n - frame_.threads) + 1, count = frame_.pairs_awake[list];
            const int *pairs = pairs_of(list), *awake = awake_of(list), *touching = touching_of(list);
            const S* left = left_of(list);
            for (Index b = 0; b < count; b += LANES) {
                if (!touching[b / LANES]) continue;
                for (Index i = b; i < min_of(b + LANES, count); i++)
                    for (int c = 0; c < 4; c++) {
                        const Index p = pairs[4 * awake[i] + c];
                        if (p >= first_ && p < last_) visit(p, left + i, frame_.pair_capacity, c);
                    }
            }
        }
    }

private:
    const ThinFrame<S>& frame_;
    Index thread_;
    Barrier& barrier_;
    S moved_ = 0;

    int* pairs_of(Index list) const { return frame_.pairs + 4 * list * frame_.pair_capacity; }
    int* awake_of(Index list) const { return frame_.awake + list * frame_.pair_capacity; }
    S* wake_of(Index list) const { return frame_.pairs_wake + list * frame_.pair_capacity; }
    S* by_modulus_of(Index list) const { return frame_.pairs_by_modulus + list * frame_.pair_capacity; }
    int* touching_of(Index list) const { return frame_.pairs_touch + list * (frame_.pair_capacity / LANES); }
    S* left_of(Index list) const { return frame_.pairs_left + LEFT * list * frame_.pair_capacity; }

    static Vec3<S> at(const S* rows, Index stride, Index p) { return {{rows[p], rows[stride + p], rows[2 * stride + p]}}; }

    // --- which pairs are awake

    // Numbers of the listed pairs that are, the last one filling the last block.
    Index wake_up(Index list) const {
        const Index count = frame_.pairs_listed[list];
        const S* wake = wake_of(list);
        int* awake = awake_of(list);
        Index found = 0;
        for (Index b = 0; b < count; b += LANES) {
            if (!any(load<S, LANES>(wake + b) <= splat<V>(moved_))) continue;
            for (Index i = b; i < min_of(b + LANES, count); i++)
                if (wake[i] <= moved_) awake[found++] = int(i);
        }
        frame_.pairs_awake[list] = found;
        for (Index i = found; i % LANES; i++) awake[i] = awake[found - 1];
        return found;
    }

    // What the vertices may move before two things at a distance touch: each half of the way.
    S sleep(S distance) const {
        const S way = distance - frame_.contact_distance;
        return way > 0 ? S(0.4999) * way : S(0);
    }

    // A block of pairs that touch; b is its place among those awake.
    template <int KIND_>
    struct Block {
        static constexpr int KIND = KIND_;
        Index list, b;
        const int* corners[LANES];  // of each pair
        Vec3<V> x[4];
    };

    // Calls visit(block) for the blocks with a pair that touches, and sends others to sleep.
    template <int KIND, class Visit>
    void for_touching(int which, const S* now, Visit visit) const {
        Block<KIND> block;
        block.list = 2 * thread_ + which;
        const Index count = wake_up(block.list);
        const int* awake = awake_of(block.list);
        S* wake = wake_of(block.list);
        for (Index b = 0; b < count; b += LANES) {
            block.b = b;
            for (int l = 0; l < LANES; l++) block.corners[l] = pairs_of(block.list) + 4 * awake[b + l];
            for (int c = 0; c < 4; c++) block.x[c] = corner(now + X * frame_.stride, block, c);
            const Contact<KIND, V, V> contact(block.x, block.x, splat<V>(frame_.contact_distance));
            const auto touch = contact.touches();
            touching_of(block.list)[b / LANES] = any(touch);
            if (any(touch)) visit(block);
            if (all(touch)) continue;
            const V distance = KIND == EDGES ? sqrt(squared_distance_of_edges(block.x)) : contact.length();
            for (int l = 0; l < LANES; l++)
                if (!touch[l]) wake[awake[b + l]] = moved_ + sleep(distance[l]);
        }
    }

    // --- forces

    template <class Pairs>
    Vec3<V> corner(const S* rows, const Pairs& block, int c) const {
        Vec3<V> value;
        for (int l = 0; l < LANES; l++) {
            const S* from = rows + block.corners[l][c];
            for (int d = 0; d < 3; d++) value[d][l] = from[d * frame_.stride];
        }
        return value;
    }

    // A pair's stiffness [N/m] is that by Young's modulus times the sum of its corners' moduli.
    template <class Pairs>
    V by_modulus(const Pairs& block) const {
        V value;
        for (int l = 0; l < LANES; l++) value[l] = by_modulus_of(block.list)[awake_of(block.list)[block.b + l]];
        return value;
    }
    template <class Pairs>
    V modulus_sum(const Pairs& block) const {
        const S* E = frame_.constants + constant::youngs_modulus * frame_.stride;
        V sum = {};
        for (int l = 0; l < LANES; l++)
            for (int c = 0; c < (Pairs::KIND == POINT_SEGMENT ? 3 : 4); c++) sum[l] += E[block.corners[l][c]];
        return sum;
    }

    LayerFriction<V> friction() const {
        return {splat<V>(frame_.layer_friction), splat<V>(frame_.layer_speed), splat<V>(frame_.layer_softening * frame_.dt)};
    }

    template <class Pairs>
    void leave_forces_of(const Pairs& block, const S* now) const {
        const Contact<Pairs::KIND, V, V> contact(block.x, block.x, splat<V>(frame_.contact_distance));
        Vec3<V> v[4], f[4] = {};
        for (int c = 0; c < 4; c++) v[c] = corner(now + VELOCITY * frame_.stride, block, c);
        const V k = by_modulus(block) * modulus_sum(block);
        contact.forces(k, f);
        contact.friction(k, friction(), v, f);
        S* left = left_of(block.list) + block.b;
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) store(left + (3 * c + d) * frame_.pair_capacity, f[c][d]);
    }

    template <class Pairs>
    void leave_adjoints_of(const Pairs& block, const S* now, S& friction_bar) const {
        const Contact<Pairs::KIND, V, V> contact(block.x, block.x, splat<V>(frame_.contact_distance));
        Vec3<V> v[4], bar[4], x_bar[4] = {}, v_bar[4] = {};
        for (int c = 0; c < 4; c++) {
            v[c] = corner(now + VELOCITY * frame_.stride, block, c);
            bar[c] = corner(frame_.force_bar, block, c);
        }
        const V per_modulus = by_modulus(block), k = per_modulus * modulus_sum(block);
        V k_bar = {}, coefficient_bar = {};
        contact.friction_adjoint(k, friction(), v, bar, x_bar, v_bar, k_bar, coefficient_bar);
        normal_adjoint<Pairs::KIND>(block.x, bar, k, x_bar, k_bar);
        const Index lanes = min_of(LANES, frame_.pairs_awake[block.list] - block.b);
        for (Index l = 0; l < lanes; l++) friction_bar += coefficient_bar[l];
        S* left = left_of(block.list) + block.b;
        const Index stride = frame_.pair_capacity;
        for (int c = 0; c < 4; c++) {
            for (int d = 0; d < 3; d++) {
                store(left + (3 * c + d) * stride, x_bar[c][d]);
                store(left + (12 + 3 * c + d) * stride, v_bar[c][d]);
            }
            store(left + (24 + c) * stride, Pairs::KIND == POINT_SEGMENT && c == 3 ? V{} : per_modulus * k_bar);
        }
    }

    // The energy's second derivatives are symmetric, so the adjoint of x is the slope of the forces along that of the forces.
    template <int KIND>
    void normal_adjoint(const Vec3<V> (&x)[4], const Vec3<V> (&bar)[4], V k, Vec3<V> (&x_bar)[4], V& k_bar) const {
        Vec3<Dual<V>> moved[4], f[4] = {};
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) moved[c][d] = {x[c][d], bar[c][d]};
        const Contact<KIND, Dual<V>, V> contact(x, moved, splat<V>(frame_.contact_distance));
        contact.forces(k, f);
        k_bar -= contact.energy().slope;
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) x_bar[c][d] += f[c][d].slope;
    }

    // --- which pairs may touch

    // Faces or edges as balls in the cells of a grid; all threads read what the first has sorted.
    struct Bins {
        const ThinFrame<S>& f;
        int which;
        Index items() const { return which ? f.contact_edges : f.contact_faces; }
        int corners() const { return which ? 2 : FACE; }
        const int* item(Index i) const { return (which ? f.contact_edge : f.contact_face) + corners() * i; }
        S* ball(Index i) const { return f.balls + 4 * (which * f.contact_faces + i); }
        S* box() const { return f.bin_boxes + 8 * which; }  // lower corner, width, cells along each axis, largest radius
        int* first() const { return f.bins + which * (f.bin_cells + 1); }
        int* cell() const { return f.bins + 2 * (f.bin_cells + 1) + which * f.contact_faces; }
        int* sorted() const { return cell() + f.contact_faces + f.contact_edges; }

        static int clamped(S place, S cells) { return place >= 1 ? (place < cells ? int(place) : int(cells) - 1) : 0; }
        int along(const S* point, int d) const { return clamped((point[d] - box()[d]) / box()[3], box()[4 + d]); }
        Index number(int i, int j, int k) const { return (Index(i) * int(box()[5]) + j) * int(box()[6]) + k; }

        void sort(const S* x, Index stride, S reach) const {
            S low[3], high[3], radius = 0;
            for (Index i = 0; i < items(); i++) {
                S* b = ball(i);
                measure(x, stride, item(i), b);
                if (b[3] > radius) radius = b[3];
                for (int d = 0; d < 3; d++) {
                    if (i == 0 || b[d] < low[d]) low[d] = b[d];
                    if (i == 0 || b[d] > high[d]) high[d] = b[d];
                }
            }
            lay(low, high, reach + 2 * radius);
            box()[7] = radius;
            count();
        }
        void measure(const S* x, Index stride, const int* at_, S* b) const {
            for (int d = 0; d < 3; d++) {
                b[d] = 0;
                for (int c = 0; c < corners(); c++) b[d] += x[d * stride + at_[c]] / corners();
            }
            S squared = 0;
            for (int c = 0; c < corners(); c++) {
                S own = 0;
                for (int d = 0; d < 3; d++) own += (x[d * stride + at_[c]] - b[d]) * (x[d * stride + at_[c]] - b[d]);
                if (own > squared) squared = own;
            }
            b[3] = sqrt(squared);
        }
        // Cells at least as wide as things reach, and not more than there is room for.
        void lay(const S* low, const S* high, S width) const {
            S cells[3], all = 1;
            for (int turn = 0; turn < 300; turn++, width *= S(1.26)) {
                all = 1;
                for (int d = 0; d < 3; d++) all *= cells[d] = (high[d] - low[d]) / width + 1;
                if (all <= f.bin_cells) break;
            }
            const bool fits = all <= f.bin_cells;  // not where a place is not a number
            for (int d = 0; d < 3; d++) {
                box()[d] = low[d];
                box()[4 + d] = fits ? S(Index(cells[d])) : S(1);
            }
            box()[3] = width;
        }
        void count() const {
            const Index cells = number(int(box()[4]) - 1, int(box()[5]) - 1, int(box()[6]) - 1) + 1;
            int* begin = first();
            for (Index c = 0; c <= cells; c++) begin[c] = 0;
            for (Index i = 0; i < items(); i++) {
                const S* b = ball(i);
                cell()[i] = int(number(along(b, 0), along(b, 1), along(b, 2)));
                begin[cell()[i] + 1]++;
            }
            for (Index c = 0; c < cells; c++) begin[c + 1] += begin[c];
            for (Index i = items() - 1; i >= 0; i--) sorted()[--begin[cell()[i] + 1]] = int(i);
            // now begin[c + 1] is where cell c begins
        }
        // Calls visit(item) for those whose balls come within reach of a ball.
        template <class Visit>
        void near(const S* point, S reach, Visit visit) const {
            const S *b = box(), *balls = ball(0), x = point[0], y = point[1], z = point[2];
            const int *begin = first(), *order = sorted();
            const Index cells = number(int(b[4]) - 1, int(b[5]) - 1, int(b[6]) - 1) + 1, all = items();
            int low[3], high[3];
            for (int d = 0; d < 3; d++) {
                low[d] = clamped((point[d] - reach - b[7] - b[d]) / b[3], b[4 + d]);
                high[d] = clamped((point[d] + reach + b[7] - b[d]) / b[3], b[4 + d]);
            }
            for (int i = low[0]; i <= high[0]; i++)
                for (int j = low[1]; j <= high[1]; j++)
                    for (int k = low[2]; k <= high[2]; k++) {
                        const Index c = number(i, j, k);
                        const Index end = c + 2 <= cells ? Index(begin[c + 2]) : all;
                        for (Index n = begin[c + 1]; n < end; n++) {
                            const S *other = balls + 4 * order[n], most = reach + other[3];
                            const S dx = x - other[0], dy = y - other[1], dz = z - other[2];
                            if (dx * dx + dy * dy + dz * dz <= most * most) visit(Index(order[n]));
                        }
                    }
        }
    };

    void find(const S* now) const {
        const S reach = frame_.contact_distance + frame_.contact_margin;
        const Bins faces{frame_, 0}, edges{frame_, 1};
        const S* x = now + X * frame_.stride;
        if (thread_ == 0) {
            faces.sort(x, frame_.stride, reach);
            edges.sort(x, frame_.stride, reach);
        }
        barrier_.wait();
        find_faces(x, reach, faces);
        find_edges(x, reach, edges);
        barrier_.wait();
    }

    void find_faces(const S* x, S reach, const Bins& faces) const {
        const Index list = 2 * thread_;
        Index count = 0;
        for (Index p = first_; p < last_; p++) {
            const Vec3<S> point = at(x, frame_.stride, p);
            faces.near(point.v, reach, [&](Index face) {
                const int* f = faces.item(face);
                int pair[4] = {int(p), f[0], f[1], f[FACE - 1]};
                for (int c = 0; c < FACE; c++)
                    if (neighbours(p, f[c])) return;
                Vec3<S> corners[4];
                for (int c = 0; c < 4; c++) corners[c] = at(x, frame_.stride, pair[c]);
                const Contact<FACES, S, S> contact(corners, corners, reach);
                if (contact.touches()) put(list, count++, pair, contact.length(), frame_.contact_weight[p] / (FACE + 1));
            });
        }
        finish(list, count);
    }

    void find_edges(const S* x, S reach, const Bins& edges) const {
        const Index list = 2 * thread_ + 1;
        Index count = 0;
        const Index end = share_of(frame_.contact_edges, thread_ + 1, frame_.threads);
        for (Index own = share_of(frame_.contact_edges, thread_, frame_.threads); own < end; own++) {
            const int* e = edges.item(own);
            const S* ball = edges.ball(own);
            edges.near(ball, reach + ball[3], [&](Index other) {
                if (other <= own) return;
                const int* o = edges.item(other);
                int pair[4] = {e[0], e[1], o[0], o[1]};
                if (neighbours(e[0], o[0]) || neighbours(e[0], o[1]) || neighbours(e[1], o[0]) || neighbours(e[1], o[1])) return;
                Vec3<S> corners[4];
                for (int c = 0; c < 4; c++) corners[c] = at(x, frame_.stride, pair[c]);
                const S squared = squared_distance_of_edges(corners);
                if (squared > reach * reach) return;
                S weight = frame_.contact_weight[pair[0]];
                for (int c = 1; c < 4; c++) weight = min(weight, frame_.contact_weight[pair[c]]);
                put(list, count++, pair, sqrt(squared), weight / 4);
            });
        }
        finish(list, count);
    }

    // Whether vertices hang together so closely that they may always be near each other.
    bool neighbours(Index p, Index q) const {
        for (Index n = frame_.near_first[p]; n < frame_.near_first[p + 1]; n++)
            if (frame_.near[n] == q) return true;
        return false;
    }

    // share: of the body's stiffness by modulus that falls to each corner.
    void put(Index list, Index place, const int (&pair)[4], S distance, S share) const {
        if (place >= frame_.pair_capacity) return;
        for (int c = 0; c < 4; c++) pairs_of(list)[4 * place + c] = pair[c];
        wake_of(list)[place] = sleep(distance);
        by_modulus_of(list)[place] = frame_.contact_size * share;
    }
    void finish(Index list, Index count) const {
        if (count > frame_.pairs_needed[list]) frame_.pairs_needed[list] = count;
        frame_.pairs_listed[list] = min_of(count, frame_.pair_capacity);
    }
};

}  // namespace physreal
