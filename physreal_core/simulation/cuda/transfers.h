// Transfers between one particle and its 27 nodes with quadratic B-splines. Distances and derivatives are per cell.
//
// A particle's contribution to a node is w q + sum_a (d_a w) A_a, its `Field`; what it takes from the nodes are sums of
// their values with the weights and their derivatives. One is the other's adjoint.
#pragma once
#include "matrix.h"
#include "parts.h"

namespace physreal {

// Where a particle lies on the grid, `count` nodes along x, y, z; z runs fastest. cell: the lowest of its nodes along each.
template <class S>
struct Place {
    int base, row, layer;  // index of the base node, and steps from there along y and x
    S w[3][3], dw[3][3];   // weights and their derivatives [axis][node]

    Place(const Vec3<S>& x, const int* cell, const S* offset, S cells_per_metre, const Index* count) {
        UNROLLED for (int d = 0; d < 3; ++d) {
            const S f = (x[d] - offset[d]) * cells_per_metre - S(cell[d]);  // in [1/2, 3/2)
            w[d][0] = S(0.5) * (S(1.5) - f) * (S(1.5) - f);
            w[d][1] = S(0.75) - (f - 1) * (f - 1);
            w[d][2] = S(0.5) * (f - S(0.5)) * (f - S(0.5));
            dw[d][0] = f - S(1.5);
            dw[d][1] = -2 * (f - 1);
            dw[d][2] = f - S(0.5);
        }
        row = int(count[2]);
        layer = int(count[1] * count[2]);
        base = cell[0] * layer + cell[1] * row + cell[2];
    }
};

template <class S>
inline Vec4<S> column(const Mat3<S>& A, int a) {
    return {{A(0, a), A(1, a), A(2, a), 0}};
}

// q: scattered with the weights; the columns of A with their derivatives along x, y, z.
template <class S>
struct Field {
    Vec4<S> q;
    Mat3<S> A;

    Field(const Vec3<S>& q, S fourth, const Mat3<S>& A) : q{{q[0], q[1], q[2], fourth}}, A(A) {}

    void scatter(const Parts<S>& parts, const Place<S>& at) const {
        const Vec4<S> ax = column(A, 0), ay = column(A, 1), az = column(A, 2);
        UNROLLED for (int i = 0; i < 3; ++i) {
            const Vec4<S> qi = at.w[0][i] * q + at.dw[0][i] * ax, yi = at.w[0][i] * ay, zi = at.w[0][i] * az;
            UNROLLED for (int j = 0; j < 3; ++j) {
                const Vec4<S> qj = at.w[1][j] * qi + at.dw[1][j] * yi, zj = at.w[1][j] * zi;
                UNROLLED for (int k = 0; k < 3; ++k) parts.leave((3 * i + j) * 3 + k, at.w[2][k] * qj + at.dw[2][k] * zj);
            }
        }
    }
};

// Sums of node values with the weights, and their derivatives by the axes in the name.
template <class S>
struct Derivatives {
    using V = Vec4<S>;
    V value = {}, x = {}, y = {}, z = {};

    // grid: the rollout's first node.
    Derivatives(const V* grid, const Place<S>& at) {
        const V* first = grid + at.base;
        UNROLLED for (int i = 0; i < 3; ++i) {
            V plane = {}, plane_y = {}, plane_z = {};
            UNROLLED for (int j = 0; j < 3; ++j) {
                const V* n = first + i * at.layer + j * at.row;
                const V a = n[0], b = n[1], c = n[2];
                const V line = at.w[2][0] * a + at.w[2][1] * b + at.w[2][2] * c;
                const V line_z = at.dw[2][0] * a + at.dw[2][1] * b + at.dw[2][2] * c;
                plane += at.w[1][j] * line, plane_y += at.dw[1][j] * line, plane_z += at.w[1][j] * line_z;
            }
            value += at.w[0][i] * plane, x += at.dw[0][i] * plane;
            y += at.w[0][i] * plane_y, z += at.w[0][i] * plane_z;
        }
    }

    // Columns: first derivatives along x, y, z.
    Mat3<S> gradient() const { return {{x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]}}; }
};

}  // namespace physreal
