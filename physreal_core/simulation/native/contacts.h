// Contact of a body with itself, one thread's share: which pairs may touch, their forces, and the adjoint.
//
// Pairs within the distance and a margin are listed anew whenever the vertices may have moved by the margin against each other. So no pair
// that touches is missed, and which pairs are listed does not change the result. A thread lists those of its own vertices and edges. Most of
// them cannot touch yet. Every few substeps those near are kept apart: those that may touch before any vertex has moved by `horizon_`. Of
// these, only the ones are looked at whose own vertices have moved far enough, and those that touch are put together, so that the forces are
// worked out for blocks of pairs that all have one. Every step keeps the pairs' order, in which vertices add up the forces.
#pragma once
#include "barrier.h"
#include "contact.h"
#include "rows.h"

namespace physreal {

// FACE: corners of what points touch, 3 of a shell's or a volume's triangles, 2 of a rod's segments. UNLIKE: whether vertices differ in reach.
template <class S, int FACE, bool UNLIKE>
class Contacts : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Rows::first_, Rows::frame_, Rows::last_, Rows::lanes_from, Rows::padded_end;
    static constexpr int FACES = FACE == 3 ? POINT_TRIANGLE : POINT_SEGMENT, X = 0, VELOCITY = 3, LEFT = 28;
    // Rows of pairs: their corners, their numbers among those listed, and their places among those near.
    static constexpr int ROWS = 6, NUMBER = 4, PLACE = 5;
    static constexpr S AHEAD = 16;            // substeps that one look at all listed pairs is to serve
    static constexpr S SHORTEST = S(1) / 64;  // of the margin: the least horizon
    static constexpr S CAUTION = S(0.98);     // share of the way between two things after which they may touch, see squared_distance_of_edges

public:
    Contacts(const Frame<S>& frame, int thread, Barrier& barrier) : Rows(frame, thread), thread_(thread), barrier_(barrier) {}

    bool on() const { return frame_.contact_distance > 0; }

    // How far the thread's own vertices have come against the body's drift, since pairs were listed and since those near were kept apart; and,
    // since the latter, how long their paths are.
    // after: the state after the substep that led here, or in the adjoint leads away from here.
    void measure(const S* now, const S* after, Index substep) const {
        const Index since[2] = {listed_at_, near_at_};
        const auto drift = [&](int d, Index substeps) { return splat<V>(frame_.dt * S(substeps) * frame_.contact_drift[d]); };
        V most[2] = {};
        for (Index p = first_; p < last_; p += LANES) {
            V squared[2] = {}, step = {};
            for (int d = 0; d < 3; d++) {
                for (int r = 0; r < 2; r++) {
                    const V from = load<S, LANES>(place(r) + d * frame_.stride + p) + drift(d, substep - since[r]);
                    const V way = load<S, LANES>(now + (X + d) * frame_.stride + p) - from;
                    squared[r] += way * way;
                }
                const V way = splat<V>(frame_.dt) * load<S, LANES>(after + (VELOCITY + d) * frame_.stride + p) - drift(d, 1);
                step += way * way;
            }
            for (int r = 0; r < 2; r++) {
                for (int l = lanes_from(p); l < LANES; l++) squared[r][l] = 0;  // what fills the last block does not count
                most[r] = max(most[r], squared[r]);
            }
            store(frame_.path + p, (at_near_ ? V{} : load<S, LANES>(frame_.path + p)) + sqrt(step));
        }
        for (int r = 0; r < 2; r++) {
            S squared = 0;
            for (int l = 0; l < LANES; l++) squared = max(squared, most[r][l]);
            farthest(substep, thread_, r) = sqrt(squared);
        }
    }

    // All threads, which have measured: lists pairs, and keeps those near apart, where the ones from before no longer hold.
    void update(const S* now, Index substep) {
        S moved = listed_ ? farthest(substep, 0) : S(0), moved_near = listed_ ? farthest(substep, 1) : S(0);
        at_near_ = true;
        if (!listed_ || 2 * moved >= frame_.contact_margin) {
            moved = 0;
            put_place(0, now);
            find(now);
            listed_ = true;
            listed_at_ = substep;
        } else if (moved_near <= horizon_) {
            at_near_ = false;
            return;
        }
        const S steps = S(substep > near_at_ ? substep - near_at_ : near_at_ - substep);
        horizon_ = max(SHORTEST * frame_.contact_margin, steps > 0 ? AHEAD * moved_near / steps : S(0));
        put_place(1, now);
        near_at_ = substep;
        keep_near<FACES>(0, now, moved + horizon_);
        keep_near<EDGES>(1, now, moved + horizon_);
    }

    void leave_forces(const S* now) const {
        for_touching<FACES>(0, now, [&](const auto& block) { leave_forces_of(block, now); });
        for_touching<EDGES>(1, now, [&](const auto& block) { leave_forces_of(block, now); });
    }

    // In: frame.force_bar. Leaves adjoints of x, v and Young's modulus at the corners; friction_bar grows.
    void leave_adjoints(const S* now, S& friction_bar) const {
        for_touching<FACES>(0, now, [&](const auto& block) { leave_adjoints_of(block, now, friction_bar); });
        for_touching<EDGES>(1, now, [&](const auto& block) { leave_adjoints_of(block, now, friction_bar); });
    }

    // Sums of the forces of a substep at the thread's own vertices, in frame.contact_force.
    void add_up_forces() const {
        this->clear(frame_.contact_force, 3);
        S *x = frame_.contact_force, *y = x + frame_.stride, *z = y + frame_.stride;
        for_left([=](Index p, const S* left, int corner) {
            const S* from = left + 3 * corner * LANES;
            x[p] += from[0];
            y[p] += from[LANES];
            z[p] += from[2 * LANES];
        });
    }

    // Where the adjoint of a vector of each vertex stands: steps from one axis and from one vertex to the next.
    struct VectorBar {
        S* first;
        Index axis, vertex;
    };

    // Adds to the adjoints of x, in rows, of v and of Young's modulus, at the thread's own vertices.
    void add_up_adjoints(S* x_bar, VectorBar v_bar, S* modulus_bar) const {
        for_left([=](Index p, const S* left, int corner) {
            for (int d = 0; d < 3; d++) {
                x_bar[d * frame_.stride + p] += left[(3 * corner + d) * LANES];
                v_bar.first[d * v_bar.axis + p * v_bar.vertex] += left[(12 + 3 * corner + d) * LANES];
            }
            modulus_bar[p] += left[(24 + corner) * LANES];
        });
    }

private:
    Index thread_;
    Barrier& barrier_;
    bool listed_ = false, at_near_ = false;  // at_near_: whether vertices are where they were when pairs near were kept apart
    Index listed_at_ = 0, near_at_ = 0;      // substeps
    S horizon_ = 0;  // lists of pairs near hold until a vertex is farther from where it was

    // Calls visit(vertex, first of the rows of LANES that were left there for it, corner) for the thread's own vertices.
    template <class Visit>
    void for_left(Visit visit) const {
        const Index first = first_, last = last_;
        for (Index n = 0; n < 2 * frame_.threads; n++) {  // faces first, whoever listed them
            const bool faces = n < frame_.threads;
            const Index list = faces ? 2 * n : 2 * (n - frame_.threads) + 1, count = frame_.pairs_touch[list];
            const int corners = faces ? FACE + 1 : 4;
            for (Index i = 0; i < count; i++) {
                const Index lane = i & (LANES - 1);
                const S* left = left_of(list) + LEFT * (i - lane) + lane;
                for (int c = 0; c < corners; c++) {
                    const Index p = touching_of(list)[c * frame_.pair_capacity + i];
                    if (p >= first && p < last) visit(p, left, c);
                }
            }
        }
    }

    // Where vertices were when pairs were listed, and when those near were kept apart.
    S* place(int which) const { return frame_.places + 3 * which * frame_.stride; }
    void put_place(int which, const S* now) const {
        for (int d = 0; d < 3; d++)
            for (Index p = first_; p < padded_end(); p++) place(which)[d * frame_.stride + p] = now[(X + d) * frame_.stride + p];
    }
    S& farthest(Index substep, Index thread, int which) const { return frame_.farthest[2 * (substep * frame_.threads + thread) + which]; }
    S farthest(Index substep, int which) const {
        S all = 0;
        for (Index t = 0; t < frame_.threads; t++) all = max(all, farthest(substep, t, which));
        return all;
    }

    int* pairs_of(Index list) const { return frame_.pairs + ROWS * list * frame_.pair_capacity; }
    int* near_of(Index list) const { return frame_.pairs_near + ROWS * list * frame_.pair_capacity; }
    int* touching_of(Index list) const { return frame_.pairs_touching + ROWS * list * frame_.pair_capacity; }
    S* near_wake_of(Index list) const { return frame_.near_wake + list * frame_.pair_capacity; }
    S* wake_of(Index list) const { return frame_.pairs_wake + list * frame_.pair_capacity; }
    S* stiffness_of(Index list) const { return frame_.pairs_stiffness + list * frame_.pair_capacity; }
    S* by_modulus_of(Index list) const { return frame_.pairs_by_modulus + list * frame_.pair_capacity; }
    S* left_of(Index list) const { return frame_.pairs_left + LEFT * list * frame_.pair_capacity; }

    // Appends those of a block of pairs whose bits are set to pairs that come before it.
    void append(int* to, Index& count, const int* block, unsigned set) const {
        for (int r = 0; r < ROWS; r++) put_set(to + r * frame_.pair_capacity + count, block + r * frame_.pair_capacity, set);
        count += __builtin_popcount(set);
    }
    // Repeats the last of `count` pairs until its block is full.
    void fill_block(int* pairs, Index count) const {
        for (Index i = count; i & (LANES - 1); i++)
            for (int r = 0; r < ROWS; r++) pairs[r * frame_.pair_capacity + i] = pairs[r * frame_.pair_capacity + count - 1];
    }
    // Bits of a mask's lanes below `count`.
    template <class M>
    static unsigned bits_below(M mask, Index count) {
        return count < LANES ? bits(mask) & ((1u << count) - 1) : bits(mask);
    }
    // Calls visit(lane) for those set, below `count`.
    template <class M, class Visit>
    static void for_set(M mask, Index count, Visit visit) {
        for (unsigned left = bits_below(mask, count); left; left &= left - 1) visit(__builtin_ctz(left));
    }

    // Rows of x, y and z, or of another vector, at the corners of a block of pairs; stride: from one corner to the next.
    void corners(const S* rows, const int* block, Index stride, Vec3<V> (&values)[4]) const {
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) values[c][d] = gather<S, LANES>(rows + d * frame_.stride, block + c * stride);
    }
    void corners(const S* rows, const int* block, Vec3<V> (&values)[4]) const { corners(rows, block, frame_.pair_capacity, values); }
    // Largest distance at which a pair touches.
    V distance() const { return splat<V>(frame_.contact_distance); }
    // That of the corners of a block of pairs.
    void reaches(const int* block, V (&values)[4]) const {
        for (int c = 0; c < 4; c++)
            values[c] = UNLIKE ? gather<S, LANES>(frame_.contact_reach, block + c * frame_.pair_capacity) : S(0.5) * distance();
    }

    template <int KIND>
    static V distance_between(const Vec3<V> (&x)[4]) {
        if constexpr (KIND == EDGES) return sqrt(squared_distance_of_edges(x));
        const V none[4] = {};
        return Contact<KIND, UNLIKE, V, V>(x, none).length();
    }

    // --- which pairs are looked at

    // What two things may come nearer before they touch.
    V way_to_go(V apart) const { return max(V{}, CAUTION * (apart - distance())); }

    // The lengths of the corners' paths since pairs near were kept apart, added up.
    V path(const int* block) const {
        V sum = {};
        for (int c = 0; c < 4 && !at_near_; c++) sum += gather<S, LANES>(frame_.path, block + c * frame_.pair_capacity);
        return sum;
    }

    // Keeps the pairs apart that may touch before a vertex is the horizon away from here, or `until` from where it was when they were listed.
    template <int KIND>
    void keep_near(int which, const S* now, S until) const {
        const Index list = 2 * thread_ + which, count = frame_.pairs_listed[list];
        int* near = near_of(list);
        Index tried = 0, found = 0;
        for (Index b = 0; b < count; b += LANES)
            append(near, tried, pairs_of(list) + b, bits_below(load<S, LANES>(wake_of(list) + b) <= splat<V>(2 * until), count - b));
        fill_block(near, tried);
        for (Index b = 0; b < tried; b += LANES) {
            Vec3<V> x[4];
            corners(now + X * frame_.stride, near + b, x);
            const V wake = way_to_go(distance_between<KIND>(x));
            Index place = found;
            append(near, found, near + b, bits_below(wake <= splat<V>(2 * horizon_), tried - b));
            for_set(wake <= splat<V>(2 * horizon_), tried - b, [&](int l) {
                near[PLACE * frame_.pair_capacity + place] = int(place);
                near_wake_of(list)[place++] = wake[l];
            });
        }
        fill_block(near, found);
        frame_.pairs_nearby[list] = found;
    }

    // A block of pairs that touch; b is its place among those.
    template <int KIND_>
    struct Block {
        static constexpr int KIND = KIND_;
        Index list, b;
        const int* corners;  // the first of their rows
    };

    // Calls visit(block) for blocks of all pairs that touch.
    template <int KIND, class Visit>
    void for_touching(int which, const S* now, Visit visit) const {
        const Index list = 2 * thread_ + which;
        int* touching = touching_of(list);
        const Index awake = put_awake(list, touching), count = keep_touching<KIND>(list, now, touching, awake);
        frame_.pairs_touch[list] = count;
        for (Index b = 0; b < count; b += LANES) visit(Block<KIND>{list, b, touching + b});
    }

    // Puts those near together of which the corners have moved as far as to touch.
    Index put_awake(Index list, int* to) const {
        const Index count = frame_.pairs_nearby[list];
        Index found = 0;
        for (Index b = 0; b < count; b += LANES) {
            const auto awake = load<S, LANES>(near_wake_of(list) + b) <= path(near_of(list) + b);
            append(to, found, near_of(list) + b, bits_below(awake, count - b));
        }
        fill_block(to, found);
        return found;
    }

    // Leaves those that touch. Of others it is known anew how far their corners may move, as lines are no farther apart than edges.
    template <int KIND>
    Index keep_touching(Index list, const S* now, int* pairs, Index count) const {
        Index found = 0;
        for (Index b = 0; b < count; b += LANES) {
            Vec3<V> x[4];
            V reach[4];
            corners(now + X * frame_.stride, pairs + b, x);
            reaches(pairs + b, reach);
            const Contact<KIND, UNLIKE, V, V> contact(x, reach);
            const V to_go = select(contact.distinct(), way_to_go(contact.length()), V{});
            scatter<S, LANES>(near_wake_of(list), pairs + PLACE * frame_.pair_capacity + b, path(pairs + b) + to_go);
            append(pairs, found, pairs + b, bits_below(contact.touches(), count - b));
        }
        fill_block(pairs, found);
        return found;
    }

    // --- forces

    LayerFriction<V> friction() const {
        return {splat<V>(frame_.layer_friction), splat<V>(frame_.layer_speed), splat<V>(frame_.layer_softening * frame_.dt)};
    }

    // Of each pair of a block its number among those of all listed.
    template <class Pairs>
    V of_pairs(const S* numbers, const Pairs& block) const {
        return gather<S, LANES>(numbers, block.corners + NUMBER * frame_.pair_capacity);
    }

    template <class Pairs>
    void leave_forces_of(const Pairs& block, const S* now) const {
        Vec3<V> x[4], v[4], f[4] = {};
        V reach[4];
        reaches(block.corners, reach);
        corners(now + X * frame_.stride, block.corners, x);
        corners(now + VELOCITY * frame_.stride, block.corners, v);
        const V k = of_pairs(stiffness_of(block.list), block);
        const Contact<Pairs::KIND, UNLIKE, V, V> contact(x, reach);
        contact.forces(k, f);
        contact.friction(k, friction(), v, f);
        S* left = left_of(block.list) + LEFT * block.b;
        for (int c = 0; c < 4; c++)
            for (int d = 0; d < 3; d++) store(left + (3 * c + d) * LANES, f[c][d]);
    }

    template <class Pairs>
    void leave_adjoints_of(const Pairs& block, const S* now, S& friction_bar) const {
        Vec3<V> x[4], v[4], bar[4], x_bar[4] = {}, v_bar[4] = {};
        V reach[4];
        reaches(block.corners, reach);
        corners(now + X * frame_.stride, block.corners, x);
        corners(now + VELOCITY * frame_.stride, block.corners, v);
        corners(frame_.force_bar, block.corners, bar);
        const V k = of_pairs(stiffness_of(block.list), block), by_modulus = of_pairs(by_modulus_of(block.list), block);
        V k_bar = {}, coefficient_bar = {};
        const Contact<Pairs::KIND, UNLIKE, V, V> contact(x, reach);
        contact.friction_adjoint(k, friction(), v, bar, x_bar, v_bar, k_bar, coefficient_bar);
        normal_adjoint<Pairs::KIND, UNLIKE>(x, bar, reach, k, x_bar, k_bar);
        const Index lanes = min_of(LANES, frame_.pairs_touch[block.list] - block.b);
        for (Index l = 0; l < lanes; l++) friction_bar += coefficient_bar[l];
        S* left = left_of(block.list) + LEFT * block.b;
        for (int c = 0; c < 4; c++) {
            for (int d = 0; d < 3; d++) {
                store(left + (3 * c + d) * LANES, x_bar[c][d]);
                store(left + (12 + 3 * c + d) * LANES, v_bar[c][d]);
            }
            store(left + (24 + c) * LANES, by_modulus * k_bar);
        }
    }

    // --- which pairs may touch

    // Faces or edges as balls in the cells of a grid; all threads read what the first has sorted.
    struct Bins {
        const Frame<S>& f;
        int which;
        Index items() const { return which ? f.contact_edges : f.contact_faces; }
        int corners() const { return which ? 2 : FACE; }
        const int* item(Index i) const { return (which ? f.contact_edge : f.contact_face) + corners() * i; }
        S* ball(Index i) const { return f.balls + 4 * (which * f.contact_faces + i); }
        S* box() const { return f.bin_boxes + 8 * which; }  // lower corner, width, cells along each axis, largest radius
        int* first() const { return f.bins + which * (f.bin_cells + 1); }
        int* cell() const { return f.bins + 2 * (f.bin_cells + 1) + which * f.contact_faces; }
        int* sorted() const { return cell() + f.contact_faces + f.contact_edges; }
        S* sorted_balls() const { return f.sorted_balls + 4 * which * (f.contact_faces + LANES); }  // rows, as they are in the cells
        Index sorted_stride() const { return items() + LANES; }

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
            for (Index i = items() - 1; i >= 0; i--) {
                const Index place = --begin[cell()[i] + 1];
                sorted()[place] = int(i);
                for (int d = 0; d < 4; d++) sorted_balls()[d * sorted_stride() + place] = ball(i)[d];
            }
            // now begin[c + 1] is where cell c begins
        }
        // Calls visit(item) for those behind `after` whose balls come within reach of a ball.
        template <class Visit>
        void near(const S* point, S reach, int after, Visit visit) const {
            const S *b = box(), *balls = sorted_balls();
            const int *begin = first(), *order = sorted();
            const Index cells = number(int(b[4]) - 1, int(b[5]) - 1, int(b[6]) - 1) + 1, all = items(), stride = sorted_stride();
            int low[3], high[3];
            for (int d = 0; d < 3; d++) {
                low[d] = clamped((point[d] - reach - b[7] - b[d]) / b[3], b[4 + d]);
                high[d] = clamped((point[d] + reach + b[7] - b[d]) / b[3], b[4 + d]);
            }
            for (int i = low[0]; i <= high[0]; i++)
                for (int j = low[1]; j <= high[1]; j++) {  // cells along the last axis follow each other
                    const Index behind = number(i, j, high[2]) + 2, end = behind <= cells ? Index(begin[behind]) : all;
                    for (Index n = begin[number(i, j, low[2]) + 1]; n < end; n += LANES) {
                        V squared = {};
                        for (int d = 0; d < 3; d++) {
                            const V way = splat<V>(point[d]) - load<S, LANES>(balls + d * stride + n);
                            squared += way * way;
                        }
                        const V most = splat<V>(reach) + load<S, LANES>(balls + 3 * stride + n);
                        unsigned found = bits_below(squared <= most * most, end - n);
                        if (found) found &= bits(load<int, LANES>(order + n) > after);
                        for (; found; found &= found - 1) visit(order[n + __builtin_ctz(found)]);
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

    // Pairs of which the distance is still to be measured.
    struct Candidates {
        int corners[4 * LANES] = {};
        Index count = 0;
    };

    void find_faces(const S* x, S reach, const Bins& faces) const {
        Candidates candidates;
        Index listed = 0;
        for (Index p = first_; p < last_; p++) {
            if (frame_.contact_weight[p] <= 0) continue;
            const S point[3] = {x[p], x[frame_.stride + p], x[2 * frame_.stride + p]};
            mark(p, 1);
            faces.near(point, reach, -1, [&](Index face) {
                const int* f = faces.item(face);
                for (int c = 0; c < FACE; c++)
                    if (marked()[f[c]]) return;
                propose<FACES>({int(p), f[0], f[1], f[FACE - 1]}, x, reach, candidates, listed);
            });
            mark(p, 0);
        }
        list<FACES>(x, reach, candidates, listed);
        finish(2 * thread_, listed);
    }

    void find_edges(const S* x, S reach, const Bins& edges) const {
        Candidates candidates;
        Index listed = 0;
        const Index end = share_of(frame_.contact_edges, thread_ + 1, frame_.threads);
        for (Index own = share_of(frame_.contact_edges, thread_, frame_.threads); own < end; own++) {
            const int* e = edges.item(own);
            const S* ball = edges.ball(own);
            mark(e[0], 1);
            mark(e[1], 1);
            edges.near(ball, reach + ball[3], int(own), [&](Index other) {
                const int* o = edges.item(other);
                if (marked()[o[0]] || marked()[o[1]]) return;
                propose<EDGES>({e[0], e[1], o[0], o[1]}, x, reach, candidates, listed);
            });
            mark(e[0], 0);
            mark(e[1], 0);
        }
        list<EDGES>(x, reach, candidates, listed);
        finish(2 * thread_ + 1, listed);
    }

    // Vertices that hang together so closely with a thing that they may always be near it.
    int* marked() const { return frame_.marks + thread_ * frame_.particles; }
    void mark(Index p, int value) const {
        for (Index n = frame_.near_first[p]; n < frame_.near_first[p + 1]; n++) marked()[frame_.near[n]] = value;
    }

    struct Corners {
        int vertex[4];
    };
    template <int KIND>
    void propose(const Corners& pair, const S* x, S reach, Candidates& candidates, Index& listed) const {
        for (int c = 0; c < 4; c++) candidates.corners[c * LANES + candidates.count] = pair.vertex[c];
        if (++candidates.count == LANES) list<KIND>(x, reach, candidates, listed);
    }

    // Lists the candidates within reach. A pair's stiffness [N/m] is that by Young's modulus [m] times the sum over its corners, see contact.py.
    template <int KIND>
    void list(const S* x, S reach, Candidates& candidates, Index& listed) const {
        constexpr int CORNERS = KIND == POINT_SEGMENT ? 3 : 4;
        const Index list = 2 * thread_ + (KIND == EDGES);
        Vec3<V> at_corners[4];
        corners(x, candidates.corners, LANES, at_corners);
        const V apart = distance_between<KIND>(at_corners), wake = way_to_go(apart);
        V sum = {}, weight = gather<S, LANES>(frame_.contact_weight, candidates.corners);
        for (int c = 0; c < CORNERS; c++) {
            const int* corner = candidates.corners + c * LANES;
            sum += gather<S, LANES>(frame_.constants + constant::youngs_modulus * frame_.stride, corner);
            if (KIND == EDGES) weight = min(weight, gather<S, LANES>(frame_.contact_weight, corner));
        }
        const V by_modulus = splat<V>(frame_.contact_size / CORNERS) * weight, stiffness = by_modulus * sum;
        for_set(apart <= splat<V>(reach), candidates.count, [&](int l) {
            const Index place = listed++;
            if (place >= frame_.pair_capacity) return;
            int* pair = pairs_of(list) + place;
            for (int c = 0; c < 4; c++) pair[c * frame_.pair_capacity] = candidates.corners[c * LANES + l];
            pair[NUMBER * frame_.pair_capacity] = int(place);
            wake_of(list)[place] = wake[l];
            by_modulus_of(list)[place] = by_modulus[l];
            stiffness_of(list)[place] = stiffness[l];
        });
        candidates.count = 0;
    }
    void finish(Index list, Index count) const {
        if (count > frame_.pairs_needed[list]) frame_.pairs_needed[list] = count;
        frame_.pairs_listed[list] = min_of(count, frame_.pair_capacity);
    }
};

}  // namespace physreal
