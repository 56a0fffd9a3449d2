// Transfers between particles and grid nodes with quadratic B-splines (APIC), one particle after the other, its 27
// nodes as nine rows of three nodes: 4 scalars (momentum x, y, z and mass, or velocity) a node, a fourth node of weight
// zero fills the vector.
//
// A particle's contribution to node (i, j, k) of its stencil is w_ijk (q + i a_x + j a_y + k a_z): affine in the node.
#pragma once
#include "lanes.h"
#include "matrix.h"

namespace physreal {

using Index = long long;

template <class S> using Node = S __attribute__((vector_size(4 * sizeof(S))));
template <class S> using Row = S __attribute__((vector_size(16 * sizeof(S))));

template <class Vector, class S> inline Vector read(const S* from) {
  Vector v;
  __builtin_memcpy(&v, from, sizeof v);
  return v;
}

template <class Vector, class S> inline void write(S* to, Vector v) { __builtin_memcpy(to, &v, sizeof v); }

// A node's four scalars at each of the row's four nodes.
template <class S> inline Row<S> repeat(Node<S> q) {
  return __builtin_shufflevector(q, q, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3);
}

// One factor for each of the row's three nodes, zero for the fourth.
template <class S> inline Row<S> per_node(const S (&w)[3]) {
  Node<S> v = {w[0], w[1], w[2], 0};
  return __builtin_shufflevector(v, v, 0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
}

template <class S> inline Node<S> first_node(Row<S> r) { return __builtin_shufflevector(r, r, 0, 1, 2, 3); }
template <class S> inline Node<S> second_node(Row<S> r) { return __builtin_shufflevector(r, r, 4, 5, 6, 7); }
template <class S> inline Node<S> third_node(Row<S> r) { return __builtin_shufflevector(r, r, 8, 9, 10, 11); }

template <class S> inline S sum_of(Node<S> v) { return (v[0] + v[1]) + (v[2] + v[3]); }

// The stored nodes: node (i, j, k) stands at offset + cell (origin + (i, j, k)); z runs fastest.
template <class S> struct Box {
  S offset[3], cells_per_metre;
  int origin[3], count[3];

  int nodes() const { return count[0] * count[1] * count[2]; }
  int row(int i, int j) const { return 4 * (i * count[1] + j) * count[2]; }  // scalars from node (0, 0, 0) to (i, j, 0)
};

// Weights of one particle's stencil along each axis, or their derivatives by the particle's position in cells.
template <class S> struct AxisWeights {
  S x[3], y[3], z[3];
};

// Where a block of LANES particles lies in the box.
template <class S> struct Stencil {
  using V = Lanes<S>;

  V fraction[3];  // distance from the base node [cells], in [1/2, 3/2)
  decltype(V{} < V{}) inside;  // all 27 nodes are stored; false for a position that is not a number
  int base[LANES];  // storage index of the base node

  Stencil(const V (&x)[3], const Box<S>& box) {
    using Whole = decltype(inside);
    using Ints = int __attribute__((vector_size(sizeof(int) * LANES)));
    Whole base_cell[3];
    inside = x[0] == x[0];
    for (int d = 0; d < 3; d++) {
      V r = (x[d] - box.offset[d]) * box.cells_per_metre - S(box.origin[d]);
      inside &= (r >= S(0.5)) & (r < S(box.count[d]) - S(1.5));
      base_cell[d] = __builtin_convertvector(r - S(0.5), Whole);
      V f = r - __builtin_convertvector(base_cell[d], V);
      fraction[d] = f;
      store(&weight_[3 * d][0], S(0.5) * (S(1.5) - f) * (S(1.5) - f));
      store(&weight_[3 * d + 1][0], S(0.75) - (f - S(1)) * (f - S(1)));
      store(&weight_[3 * d + 2][0], S(0.5) * (f - S(0.5)) * (f - S(0.5)));
      store(&slope_[3 * d][0], f - S(1.5));
      store(&slope_[3 * d + 1][0], S(-2) * (f - S(1)));
      store(&slope_[3 * d + 2][0], f - S(0.5));
    }
    Whole first = (base_cell[0] * box.count[1] + base_cell[1]) * box.count[2] + base_cell[2];
    write(base, __builtin_convertvector(first, Ints));
  }

  AxisWeights<S> weights(int lane) const { return of(weight_, lane); }
  AxisWeights<S> slopes(int lane) const { return of(slope_, lane); }

 private:
  alignas(64) S weight_[9][LANES];  // row 3 axis + node
  alignas(64) S slope_[9][LANES];

  static AxisWeights<S> of(const S (&a)[9][LANES], int l) {
    return {{a[0][l], a[1][l], a[2][l]}, {a[3][l], a[4][l], a[5][l]}, {a[6][l], a[7][l], a[8][l]}};
  }
};

// One particle's affine field on its stencil: q + k a_z along a row, and the steps to the next row in x and in y.
template <class S> struct Affine {
  Row<S> base, along_x, along_y;
};

// Fields of a block of particles: q = (momentum, mass) or their likes at the base node, and the columns of A.
template <class S> struct AffineBlock {
  using V = Lanes<S>;

  // momentum: at the particle; the field there is momentum, and A its gradient per cell.
  AffineBlock(const Vec3<V>& momentum, V mass, const Mat3<V>& A, const V (&fraction)[3]) {
    for (int c = 0; c < 3; c++) {
      V moved = A(c, 0) * fraction[0] + A(c, 1) * fraction[1] + A(c, 2) * fraction[2];
      store(&q_[c][0], momentum.v[c] - moved);
      for (int d = 0; d < 3; d++) store(&A_[3 * d + c][0], A(c, d));
    }
    store(&q_[3][0], mass);
  }

  Affine<S> of(int l) const {
    const Row<S> step = {0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 0, 0, 0, 0};
    Node<S> q = {q_[0][l], q_[1][l], q_[2][l], q_[3][l]};
    Node<S> x = {A_[0][l], A_[1][l], A_[2][l], 0}, y = {A_[3][l], A_[4][l], A_[5][l], 0};
    Node<S> z = {A_[6][l], A_[7][l], A_[8][l], 0};
    return {repeat<S>(q) + step * repeat<S>(z), repeat<S>(x), repeat<S>(y)};
  }

 private:
  alignas(64) S q_[4][LANES];
  alignas(64) S A_[9][LANES];  // row 3 axis + component
};

// Adds fields to a grid; neighbours in the order of the particles share a cell, and their sum is written once.
template <class S> class Scatter {
 public:
  Scatter(S* grid, const Box<S>& box) : grid_(grid), box_(box) {}

  void add(int base, const Affine<S>& field, const AxisWeights<S>& w) {
    if (base != base_) {
      flush();
      base_ = base;
    }
    Row<S> wz = per_node(w.z);
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
template <class S> struct Moments {
  Node<S> sum, x, y, z;
};

template <class S> inline Moments<S> gather(const S* first, const Box<S>& box, const AxisWeights<S>& w) {
  Row<S> sum[3], y = {};
  for (int i = 0; i < 3; i++) {
    Row<S> r0 = read<Row<S>>(first + box.row(i, 0)), r1 = w.y[1] * read<Row<S>>(first + box.row(i, 1));
    Row<S> r2 = w.y[2] * read<Row<S>>(first + box.row(i, 2));
    sum[i] = w.y[0] * r0 + (r1 + r2);
    y += w.x[i] * (r1 + (r2 + r2));
  }
  Row<S> x1 = w.x[1] * sum[1], x2 = w.x[2] * sum[2];
  Row<S> total = w.x[0] * sum[0] + (x1 + x2), x = x1 + (x2 + x2);
  auto along_z = [&](Row<S> r) { return w.z[0] * first_node<S>(r) + (w.z[1] * second_node<S>(r) + w.z[2] * third_node<S>(r)); };
  Node<S> z1 = w.z[1] * second_node<S>(total), z2 = w.z[2] * third_node<S>(total);
  return {w.z[0] * first_node<S>(total) + (z1 + z2), along_z(x), along_z(y), z1 + (z2 + z2)};
}

// Derivative of sum_n w_n (g_n . field_n) by the weights' own position in cells, field held fixed; g the grid.
template <class S>
inline void weight_gradient(
    const S* first, const Box<S>& box, const Affine<S>& field, const AxisWeights<S>& w, const AxisWeights<S>& dw, S (&out)[3]) {
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
  Row<S> wz = per_node(w.z);
  auto total = [](Row<S> r) { return sum_of<S>(first_node<S>(r) + (second_node<S>(r) + third_node<S>(r))); };
  out[0] = total(wz * gx);
  out[1] = total(wz * gy);
  out[2] = total(per_node(dw.z) * gz);
}

// What `gather` gave for a block of particles, put back into lanes: the sum and the gradient per cell about the particle.
template <class S> struct MomentBlock {
  using V = Lanes<S>;

  void set(int l, const Moments<S>& m) {
    for (int c = 0; c < 3; c++) {
      rows_[c][l] = m.sum[c];
      rows_[3 + c][l] = m.x[c];
      rows_[6 + c][l] = m.y[c];
      rows_[9 + c][l] = m.z[c];
    }
  }

  Vec3<V> sum() const { return {{load(&rows_[0][0]), load(&rows_[1][0]), load(&rows_[2][0])}}; }

  // sum_n w_n g_n (n - particle)^T
  Mat3<V> about_particle(const V (&fraction)[3]) const {
    Mat3<V> B;
    Vec3<V> s = sum();
    for (int c = 0; c < 3; c++)
      for (int d = 0; d < 3; d++) B(c, d) = load(&rows_[3 + 3 * d + c][0]) - fraction[d] * s.v[c];
    return B;
  }

 private:
  alignas(64) S rows_[12][LANES] = {};
};

}  // namespace physreal
