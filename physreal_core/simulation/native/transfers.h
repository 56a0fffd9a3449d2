// Transfers between particles and grid nodes with quadratic B-splines (APIC), one particle after the other, its 27
// nodes as nine rows of three nodes: 4 scalars (momentum x, y, z and mass, or velocity) a node, a fourth node of weight
// zero fills the vector.
//
// A particle's contribution to node (i, j, k) of its stencil is w_ijk (q + i a_x + j a_y + k a_z): affine in the node.
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

// Four scalars for each particle of a block: written or read as four vectors of lanes, or particle by particle.
template <class S>
class NodeBlock {
    using V = Lanes<S>;
    using Pair = Lanes<S, 2 * LANES>;
    using All = Lanes<S, 4 * LANES>;

public:
    NodeBlock() : values_{} {}
    NodeBlock(V a, V b, V c, V d) {
        Count<2 * LANES> twice;
        write(values_, interleaved(interleaved(a, b, twice), interleaved(c, d, twice), Count<4 * LANES>()));
    }

    Node<S> operator[](int lane) const { return read<Node<S>>(values_ + 4 * lane); }
    void set(int lane, Node<S> value) { write(values_ + 4 * lane, value); }

    // The scalar `c` of all particles.
    template <int c>
    V lanes() const {
        return every_fourth<c>(read<Pair>(values_), read<Pair>(values_ + 2 * LANES), Count<LANES>());
    }

private:
    alignas(64) S values_[4 * LANES];

    template <int... I>
    static Pair interleaved(V a, V b, Indices<I...>) {
        return __builtin_shufflevector(a, b, (I / 2 + I % 2 * LANES)...);
    }
    template <int... I>
    static All interleaved(Pair ab, Pair cd, Indices<I...>) {
        return __builtin_shufflevector(ab, cd, (I / 4 * 2 + I % 2 + I / 2 % 2 * 2 * LANES)...);
    }
    template <int c, int... I>
    static V every_fourth(Pair first, Pair second, Indices<I...>) {
        return __builtin_shufflevector(first, second, (4 * I + c)...);
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

// The stored nodes: node (i, j, k) stands at offset + cell (origin + (i, j, k)); z runs fastest.
template <class S>
struct Box {
    S offset[3], cells_per_metre;
    int origin[3], count[3];

    int nodes() const { return count[0] * count[1] * count[2]; }
    int row(int i, int j) const {
        return 4 * (i * count[1] + j) * count[2];
    }  // scalars from node (0, 0, 0) to (i, j, 0)
};

// Weights of one particle's stencil along each axis, or their derivatives by the particle's position in cells.
template <class S>
struct AxisWeights {
    S x[3], y[3];
    Node<S> z;  // the fourth is zero
};

// Where a block of LANES particles lies in the box.
template <class S>
struct Stencil {
    using V = Lanes<S>;

    V fraction[3];               // distance from the base node [cells], in [1/2, 3/2)
    decltype(V{} < V{}) inside;  // all 27 nodes are stored; false for a position that is not a number
    int base[LANES];             // storage index of the base node

    Stencil(const V (&x)[3], const Box<S>& box) {
        using Whole = decltype(inside);
        using Ints = Lanes<int>;
        Whole base_cell[3];
        inside = x[0] == x[0];
        for (int d = 0; d < 3; d++) {
            V r = (x[d] - box.offset[d]) * box.cells_per_metre - S(box.origin[d]);
            inside &= (r >= S(0.5)) & (r < S(box.count[d]) - S(1.5));
            base_cell[d] = __builtin_convertvector(r - S(0.5), Whole);
            V f = r - __builtin_convertvector(base_cell[d], V);
            fraction[d] = f;
            V w[3] = {S(0.5) * (S(1.5) - f) * (S(1.5) - f), S(0.75) - (f - S(1)) * (f - S(1)),
                      S(0.5) * (f - S(0.5)) * (f - S(0.5))};
            V dw[3] = {f - S(1.5), S(-2) * (f - S(1)), f - S(0.5)};
            if (d == 2) {
                weight_.z = NodeBlock<S>(w[0], w[1], w[2], V{});
                slope_.z = NodeBlock<S>(dw[0], dw[1], dw[2], V{});
            } else {
                for (int o = 0; o < 3; o++) {
                    store(&weight_.xy[3 * d + o][0], w[o]);
                    store(&slope_.xy[3 * d + o][0], dw[o]);
                }
            }
        }
        Whole first = (base_cell[0] * box.count[1] + base_cell[1]) * box.count[2] + base_cell[2];
        write(base, __builtin_convertvector(first, Ints));
    }

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

// One particle's affine field on its stencil: q + k a_z along a row, and the steps to the next row in x and in y.
template <class S>
struct Affine {
    Row<S> base, along_x, along_y;
};

// Fields of a block of particles: q = (momentum, mass) or their likes at the base node, and the columns of A.
template <class S>
struct AffineBlock {
    using V = Lanes<S>;

    // momentum: at the particle; the field there is momentum, and A its gradient per cell.
    AffineBlock(const Vec3<V>& momentum, V mass, const Mat3<V>& A, const V (&fraction)[3])
        : q_(at_base(momentum, A, fraction, 0), at_base(momentum, A, fraction, 1), at_base(momentum, A, fraction, 2),
             mass),
          x_(A(0, 0), A(1, 0), A(2, 0), V{}),
          y_(A(0, 1), A(1, 1), A(2, 1), V{}),
          z_(A(0, 2), A(1, 2), A(2, 2), V{}) {}

    Affine<S> of(int l) const {
        const Row<S> step = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0, 0, 0, 0};
        return {repeat<S>(q_[l]) + step * repeat<S>(z_[l]), repeat<S>(x_[l]), repeat<S>(y_[l])};
    }

private:
    NodeBlock<S> q_, x_, y_, z_;

    static V at_base(const Vec3<V>& momentum, const Mat3<V>& A, const V (&fraction)[3], int c) {
        return momentum[c] - (A(c, 0) * fraction[0] + A(c, 1) * fraction[1] + A(c, 2) * fraction[2]);
    }
};

// Adds fields to a grid; neighbours in the order of the particles share a cell, and their sum is written once.
template <class S>
class Scatter {
public:
    Scatter(S* grid, const Box<S>& box) : grid_(grid), box_(box) {}

    void add(int base, const Affine<S>& field, const AxisWeights<S>& w) {
        if (base != base_) {
            flush();
            base_ = base;
        }
        Row<S> wz = spread<S>(w.z);
        Row<S> p = wz * field.base, px = wz * field.along_x, py = wz * field.along_y;
        for (int i = 0; i < 3; i++) {
            Row<S> q = w.x[i] * p, qy = w.x[i] * py;
            for (int j = 0; j < 3; j++) {
                sum_[3 * i + j] += w.y[j] * q;
                q += qy;
            }
            p += px;
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
};

// Sum over the stencil of weight times node, and its first moments along x, y, z in cells from the base node.
template <class S>
struct Moments {
    Node<S> sum, x, y, z;
};

template <class S>
inline Moments<S> gather(const S* first, const Box<S>& box, const AxisWeights<S>& w) {
    Row<S> sum[3], y = {};
    for (int i = 0; i < 3; i++) {
        Row<S> r0 = read<Row<S>>(first + box.row(i, 0)), r1 = w.y[1] * read<Row<S>>(first + box.row(i, 1));
        Row<S> r2 = w.y[2] * read<Row<S>>(first + box.row(i, 2));
        sum[i] = w.y[0] * r0 + (r1 + r2);
        y += w.x[i] * (r1 + (r2 + r2));
    }
    Row<S> x1 = w.x[1] * sum[1], x2 = w.x[2] * sum[2];
    Row<S> total = w.x[0] * sum[0] + (x1 + x2), x = x1 + (x2 + x2);
    auto along_z = [&](Row<S> r) {
        return w.z[0] * first_node<S>(r) + (w.z[1] * second_node<S>(r) + w.z[2] * third_node<S>(r));
    };
    Node<S> z1 = w.z[1] * second_node<S>(total), z2 = w.z[2] * third_node<S>(total);
    return {w.z[0] * first_node<S>(total) + (z1 + z2), along_z(x), along_z(y), z1 + (z2 + z2)};
}

// Derivative of sum_n w_n (g_n . field_n) by the particle's position in cells, through the weights alone; g is the
// grid. Four parts of each component, to be summed.
template <class S>
struct WeightGradient {
    Node<S> x, y, z;
};

template <class S>
inline WeightGradient<S> weight_gradient(const S* first, const Box<S>& box, const Affine<S>& field,
                                         const AxisWeights<S>& w, const AxisWeights<S>& dw) {
    Row<S> gx = {}, gy = {}, gz = {}, p = field.base;
    for (int i = 0; i < 3; i++) {
        Row<S> q = p, along = {}, across = {};
        for (int j = 0; j < 3; j++) {
            Row<S> z = q * read<Row<S>>(first + box.row(i, j));
            along += w.y[j] * z;
            across += dw.y[j] * z;
            q += field.along_y;
        }
        gx += dw.x[i] * along;
        gy += w.x[i] * across;
        gz += w.x[i] * along;
        p += field.along_x;
    }
    Row<S> wz = spread<S>(w.z);
    auto parts = [](Row<S> r) { return first_node<S>(r) + (second_node<S>(r) + third_node<S>(r)); };
    return {parts(wz * gx), parts(wz * gy), parts(spread<S>(dw.z) * gz)};
}

template <class S>
class GradientBlock {
public:
    void set(int l, const WeightGradient<S>& g) {
        x_.set(l, g.x);
        y_.set(l, g.y);
        z_.set(l, g.z);
    }
    Vec3<Lanes<S>> value() const { return {{total(x_), total(y_), total(z_)}}; }

private:
    NodeBlock<S> x_, y_, z_;

    static Lanes<S> total(const NodeBlock<S>& b) {
        return (b.template lanes<0>() + b.template lanes<1>()) + (b.template lanes<2>() + b.template lanes<3>());
    }
};

// What `gather` gave for a block of particles: the sum, and the gradient per cell about the particle.
template <class S>
class MomentBlock {
    using V = Lanes<S>;

public:
    void set(int l, const Moments<S>& m) {
        sum_.set(l, m.sum);
        moment_[0].set(l, m.x);
        moment_[1].set(l, m.y);
        moment_[2].set(l, m.z);
    }

    Vec3<V> sum() const { return vector(sum_); }
    V fourth_sum() const { return sum_.template lanes<3>(); }

    // sum_n w_n g_n (n - particle)^T
    Mat3<V> about_particle(const V (&fraction)[3]) const {
        Mat3<V> B;
        Vec3<V> s = sum();
        for (int d = 0; d < 3; d++) {
            Vec3<V> m = vector(moment_[d]);
            for (int c = 0; c < 3; c++) B(c, d) = m[c] - fraction[d] * s[c];
        }
        return B;
    }

private:
    NodeBlock<S> sum_, moment_[3];

    static Vec3<V> vector(const NodeBlock<S>& b) {
        return {{b.template lanes<0>(), b.template lanes<1>(), b.template lanes<2>()}};
    }
};

}  // namespace physreal
