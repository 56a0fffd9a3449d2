// Transfers between particles and grid nodes with quadratic B-splines, one particle after the other, its 27 nodes as
// nine rows of three nodes: 4 scalars a node, a fourth node of weight zero fills the vector.
//
// Distances are in cells; d_a w is a weight's derivative by the particle's place along axis a.
// A particle's contribution to a node is w q + sum_a (d_a w) g_a, its `Field`; what it takes from the nodes are sums of
// their values with the weights and their derivatives, its `Moments`. One is the other's adjoint.
#pragma once
#include "lanes.h"
#include "matrix.h"

namespace physreal {

template <class S>
using Node = Lanes<S, 4>;
template <class S>
using Row = Lanes<S, 16>;

template <class Vector, class S>
inline Vector read(const S* from) {
    Vector v;
    __builtin_memcpy(&v, from, sizeof v);
    return v;
}

template <class Vector, class S>
inline void write(S* to, Vector v) {
    __builtin_memcpy(to, &v, sizeof v);
}

// A node's four scalars at each of the row's four nodes.
template <class S>
inline Row<S> repeat(Node<S> q) {
    return __builtin_shufflevector(q, q, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
}

// Each of four scalars at all four places of one of the row's nodes.
template <class S>
inline Row<S> spread(Node<S> w) {
    return __builtin_shufflevector(w, w, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
}

template <int... I>
struct Indices {};
template <class T, T... I>
struct IndexSequence {
    using type = Indices<I...>;
};
template <int N>
using Count = typename __make_integer_seq<IndexSequence, int, N>::type;

// Four scalars for each particle of a block: written or read as four vectors of lanes, or particle by particle. Vector
// e of the memory holds particles e, 4 + e, 8 + e, ..., so that all shuffles stay within four neighbouring lanes.
template <class S>
class NodeBlock {
    using V = Lanes<S>;

public:
    NodeBlock() : values_{} {}
    NodeBlock(V a, V b, V c, V d) {
        const V ab[2] = {woven<0>(a, b), woven<2>(a, b)}, cd[2] = {woven<0>(c, d), woven<2>(c, d)};
        for (int e = 0; e < 2; e++) {
            store(values_[2 * e], halves<0>(ab[e], cd[e]));
            store(values_[2 * e + 1], halves<2>(ab[e], cd[e]));
        }
    }

    Node<S> operator[](int lane) const { return read<Node<S>>(&values_[lane % 4][lane / 4 * 4]); }
    void set(int lane, Node<S> value) { write(&values_[lane % 4][lane / 4 * 4], value); }

    // The scalar `c` of all particles.
    template <int c>
    V lanes() const {
        const V first = woven<c / 2 * 2>(load(values_[0]), load(values_[1]));
        const V second = woven<c / 2 * 2>(load(values_[2]), load(values_[3]));
        return halves<c % 2 * 2>(first, second);
    }

private:
    alignas(64) S values_[4][LANES];

    // Of every four lanes two, from `first` on: of both vectors in turn, or those of one before those of the other.
    template <int first>
    static V woven(V x, V y) {
        return woven<first>(x, y, Count<LANES>());
    }
    template <int first, int... I>
    static V woven(V x, V y, Indices<I...>) {
        return __builtin_shufflevector(x, y, (I / 4 * 4 + first + I % 4 / 2 + I % 2 * LANES)...);
    }
    template <int first>
    static V halves(V x, V y) {
        return halves<first>(x, y, Count<LANES>());
    }
    template <int first, int... I>
    static V halves(V x, V y, Indices<I...>) {
        return __builtin_shufflevector(x, y, (I / 4 * 4 + first + I % 2 + I % 4 / 2 * LANES)...);
    }
};

template <class S>
inline Node<S> first_node(Row<S> r) {
    return __builtin_shufflevector(r, r, 0, 1, 2, 3);
}
template <class S>
inline Node<S> second_node(Row<S> r) {
    return __builtin_shufflevector(r, r, 4, 5, 6, 7);
}
template <class S>
inline Node<S> third_node(Row<S> r) {
    return __builtin_shufflevector(r, r, 8, 9, 10, 11);
}

// The nodes: (i, j, k) stands at offset + cell (i, j, k); z runs fastest.
template <class S>
struct Box {
    S offset[3], cells_per_metre;
    int count[3];

    int nodes() const { return count[0] * count[1] * count[2]; }
    int row(int i, int j) const {
        return 4 * (i * count[1] + j) * count[2];
    }  // scalars from node (0, 0, 0) to (i, j, 0)
};

// Weights of one particle's stencil along each axis, or their derivatives by the particle's position.
template <class S>
struct AxisWeights {
    S x[3], y[3];
    Node<S> z;  // the fourth is zero
};

// Where a block of LANES particles lies in the box.
template <class S>
struct Stencil {
    using V = Lanes<S>;

    int base[LANES];  // storage index of the base node

    Stencil(const V (&x)[3], const Box<S>& box) {
        using Whole = decltype(V{} < V{});
        using Ints = Lanes<int>;
        Whole base_cell[3];
        for (int d = 0; d < 3; d++) {
            V r = (x[d] - box.offset[d]) * box.cells_per_metre;
            base_cell[d] = __builtin_convertvector(r - S(0.5), Whole);
            V f = r - __builtin_convertvector(base_cell[d], V);
            V w[3] = {S(0.5) * (S(1.5) - f) * (S(1.5) - f), S(0.75) - (f - S(1)) * (f - S(1)),
                      S(0.5) * (f - S(0.5)) * (f - S(0.5))};
            V dw[3] = {f - S(1.5), S(-2) * (f - S(1)), f - S(0.5)};
            if (d == 2) {
                weight_.z = NodeBlock<S>(w[0], w[1], w[2], V{});
                slope_.z = NodeBlock<S>(dw[0], dw[1], dw[2], V{});
            } else {
                for (int o = 0; o < 3; o++) {
                    store(weight_.xy[3 * d + o], w[o]);
                    store(slope_.xy[3 * d + o], dw[o]);
                }
            }
        }
        Whole first = (base_cell[0] * box.count[1] + base_cell[1]) * box.count[2] + base_cell[2];
        write(base, __builtin_convertvector(first, Ints));
    }

    // Bits of the lanes whose particle has this base node.
    unsigned lanes_at(int node) const { return bits(load(base) == node); }

    AxisWeights<S> weights(int lane) const { return weight_.of(lane); }
    AxisWeights<S> slopes(int lane) const { return slope_.of(lane); }

private:
    struct WeightBlock {
        alignas(64) S xy[6][LANES];  // row 3 axis + node
        NodeBlock<S> z;

        AxisWeights<S> of(int l) const {
            return {{xy[0][l], xy[1][l], xy[2][l]}, {xy[3][l], xy[4][l], xy[5][l]}, z[l]};
        }
    };
    WeightBlock weight_, slope_;
};

// What one particle adds to its nodes: q, and along each axis the share of the first derivatives.
template <class S>
struct Field {
    Node<S> q, gradient[3];
};

// Fields of a block of particles.
template <class S>
struct FieldBlock {
    using V = Lanes<S>;

    // q and its fourth number are scattered with the weights, the columns of A with their derivatives.
    FieldBlock(const Vec3<V>& q, V fourth, const Mat3<V>& A)
        : q_(q[0], q[1], q[2], fourth), gradient_{column(A, 0), column(A, 1), column(A, 2)} {}

    Field<S> of(int l) const { return {q_[l], {gradient_[0][l], gradient_[1][l], gradient_[2][l]}}; }

private:
    NodeBlock<S> q_, gradient_[3];

    static NodeBlock<S> column(const Mat3<V>& A, int a) { return {A(0, a), A(1, a), A(2, a), V{}}; }
};

// Adds fields to a grid; neighbours in the order of the particles share a cell, and their sum is written once.
template <class S>
class Scatter {
public:
    Scatter(S* grid, const Box<S>& box) : grid_(grid), box_(box) {}

    // The block's first `count` particles, those of a cell one after the other, and before all those of the last cell.
    void add(const FieldBlock<S>& fields, const Stencil<S>& at, int count) {
        unsigned left = (1u << count) - 1, group = left & at.lanes_at(base_);
        for (;;) {
            left &= ~group;
            for (; group != 0; group &= group - 1) {
                const int l = __builtin_ctz(group);
                add(fields.of(l), at.weights(l), at.slopes(l));
            }
            if (left == 0) return;
            flush();
            base_ = at.base[__builtin_ctz(left)];
            group = left & at.lanes_at(base_);
        }
    }

    // To be called once more after the last particle.
    void flush() {
        if (base_ >= 0) {
            S* first = grid_ + 4 * Index(base_);
            for (int i = 0; i < 3; i++)
                for (int j = 0; j < 3; j++) {
                    S* row = first + box_.row(i, j);
                    write(row, read<Row<S>>(row) + sum_[3 * i + j]);
                }
        }
        for (int r = 0; r < 9; r++) sum_[r] = Row<S>{};
    }

private:
    S* grid_;
    const Box<S>& box_;
    int base_ = -1;
    Row<S> sum_[9] = {};

    void add(const Field<S>& field, const AxisWeights<S>& w, const AxisWeights<S>& dw) {
        const Row<S> wz = spread<S>(w.z);
        const Row<S> p = wz * repeat<S>(field.q) + spread<S>(dw.z) * repeat<S>(field.gradient[2]);
        const Row<S> px = wz * repeat<S>(field.gradient[0]), py = wz * repeat<S>(field.gradient[1]);
        for (int i = 0; i < 3; i++) {
            const Row<S> along = w.x[i] * p + dw.x[i] * px, across = w.x[i] * py;
            for (int j = 0; j < 3; j++) sum_[3 * i + j] += w.y[j] * along + dw.y[j] * across;
        }
    }
};

// Sums over the stencil of a node's values times the weights, and times their derivatives by the axes in the name.
template <class T>
struct Derivatives {
    T value, x, y, z;
};

template <class S>
inline Derivatives<Node<S>> gather(const S* first, const Box<S>& box, const AxisWeights<S>& w,
                                   const AxisWeights<S>& dw) {
    Row<S> s = {}, sx = {}, sy = {};
    for (int i = 0; i < 3; i++) {
        const Row<S> r0 = read<Row<S>>(first + box.row(i, 0)), r1 = read<Row<S>>(first + box.row(i, 1));
        const Row<S> r2 = read<Row<S>>(first + box.row(i, 2));
        const Row<S> t = w.y[0] * r0 + (w.y[1] * r1 + w.y[2] * r2);
        s += w.x[i] * t;
        sx += dw.x[i] * t;
        sy += w.x[i] * (dw.y[0] * r0 + (dw.y[1] * r1 + dw.y[2] * r2));
    }
    auto sum = [](const Row<S>& r, const Node<S>& z) {
        return z[0] * first_node<S>(r) + (z[1] * second_node<S>(r) + z[2] * third_node<S>(r));
    };
    return {sum(s, w.z), sum(sx, w.z), sum(sy, w.z), sum(s, dw.z)};
}

// What `gather` gave for a block of particles.
template <class S>
class MomentBlock {
    using V = Lanes<S>;

public:
    void set(int l, const Derivatives<Node<S>>& d) {
        rows_[0].set(l, d.value);
        rows_[1].set(l, d.x);
        rows_[2].set(l, d.y);
        rows_[3].set(l, d.z);
    }

    Vec3<V> value() const { return vector(0); }
    V fourth_value() const { return rows_[0].template lanes<3>(); }

    // Columns: first derivatives along x, y, z.
    Mat3<V> gradient() const {
        Mat3<V> A;
        for (int c = 0; c < 3; c++) {
            const Vec3<V> column = vector(1 + c);
            for (int r = 0; r < 3; r++) A(r, c) = column[r];
        }
        return A;
    }

private:
    NodeBlock<S> rows_[4];

    Vec3<V> vector(int row) const {
        return {{rows_[row].template lanes<0>(), rows_[row].template lanes<1>(), rows_[row].template lanes<2>()}};
    }
};

}  // namespace physreal
