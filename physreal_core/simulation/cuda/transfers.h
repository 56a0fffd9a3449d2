// Transfers between one particle and its 27 nodes with quadratic B-splines (APIC). Distances and derivatives are per
// cell.
//
// A particle's contribution to a node is w q + sum_a (d_a w) A_a + sum_a (d_a d_a w) B_a, its `Field`; what it takes
// from the nodes are sums of their values with the weights and their derivatives. One is the other's adjoint.
#pragma once
#include "adder.h"
#include "matrix.h"

namespace physreal {

// Where a particle lies in a box of stored nodes, origin and count as six integers; z runs fastest.
template <class S>
struct Place {
    bool inside;           // all 27 nodes are stored; false for a position that is not a number
    int base, row, layer;  // storage index of the base node, and steps from there along y and x
    S w[3][3], dw[3][3];   // weights and their derivatives [axis][node]
    S fraction[3];         // distance from the base node, in [1/2, 3/2)

    Place(const Vec3<S>& x, const S* offset, S cells_per_metre, const int* box) {
        int cell[3];
        inside = true;
        UNROLLED for (int d = 0; d < 3; ++d) {
            const S r = (x[d] - offset[d]) * cells_per_metre - S(box[d]);
            inside = inside && r >= S(0.5) && r < S(box[3 + d]) - S(1.5);
            cell[d] = int(r - S(0.5));
            const S f = fraction[d] = r - S(cell[d]);
            w[d][0] = S(0.5) * (S(1.5) - f) * (S(1.5) - f);
            w[d][1] = S(0.75) - (f - 1) * (f - 1);
            w[d][2] = S(0.5) * (f - S(0.5)) * (f - S(0.5));
            dw[d][0] = f - S(1.5);
            dw[d][1] = -2 * (f - 1);
            dw[d][2] = f - S(0.5);
        }
        row = box[5];
        layer = box[4] * box[5];
        base = cell[0] * layer + cell[1] * row + cell[2];
    }

    // APIC's moment 4 sum_i w_i v_i o_a, with o the offset from the particle, is d_a v + skew_a d_a d_a v.
    S skew(int a) const {
        const S s = fraction[a] - 1;
        return s * (S(0.5) - 2 * s * s);
    }
    S skew_slope(int a) const {
        const S s = fraction[a] - 1;
        return S(0.5) - 6 * s * s;
    }
};

// Second derivatives of the weights, the same everywhere in a cell.
template <class S>
inline S curvature(int node) {
    return node == 1 ? S(-2) : S(1);
}

template <class S>
inline Vec4<S> column(const Mat3<S>& A, int a) {
    return {{A(0, a), A(1, a), A(2, a), 0}};
}
template <class S>
inline Vec3<S> three(const Vec4<S>& a) {
    return {{a[0], a[1], a[2]}};
}

template <class S>
struct Field {
    Vec4<S> q;
    Mat3<S> A, B;  // columns: shares of the weight's first and second derivatives along x, y, z
    Mat3<S> apic;  // the share of A that is scattered with the nodes' offsets

    // q: (momentum, mass) or their likes; apic: its columns are scattered with four times weight and offset along the
    // axes; gradient: with the weight's derivatives.
    Field(const Vec3<S>& momentum, S mass, const Mat3<S>& apic, const Mat3<S>& gradient, const Place<S>& at)
        : q{{momentum[0], momentum[1], momentum[2], mass}}, A(apic + gradient), apic(apic) {
        for (int a = 0; a < 3; ++a)
            for (int c = 0; c < 3; ++c) B(c, a) = at.skew(a) * apic(c, a);
    }

    // grid: the rollout's first node.
    void scatter(Vec4<S>* grid, const Place<S>& at) const {
        const Vec4<S> ax = column(A, 0), ay = column(A, 1), az = column(A, 2);
        const Vec4<S> bx = column(B, 0), by = column(B, 1), bz = column(B, 2);
        const Adder<S> adder(at.base);
        Vec4<S>* first = grid + at.base;
        UNROLLED for (int i = 0; i < 3; ++i) {
            const Vec4<S> qi = at.w[0][i] * q + at.dw[0][i] * ax + curvature<S>(i) * bx;
            UNROLLED for (int j = 0; j < 3; ++j) {
                Vec4<S>* nodes = first + i * at.layer + j * at.row;
                const Vec4<S> qj = at.w[1][j] * qi + at.w[0][i] * (at.dw[1][j] * ay + curvature<S>(j) * by);
                const S wij = at.w[0][i] * at.w[1][j];
                const Vec4<S> across = wij * az, bent = wij * bz;
                UNROLLED for (int k = 0; k < 3; ++k)
                    adder.add(nodes + k, at.w[2][k] * qj + at.dw[2][k] * across + curvature<S>(k) * bent);
            }
        }
    }
};

// Sums of node values with the weights, and their derivatives by the axes in the name. What is not used costs nothing
// once compiled.
template <class S>
struct Derivatives {
    using V = Vec4<S>;
    V value = {}, x = {}, y = {}, z = {}, xx = {}, yy = {}, zz = {}, xy = {}, xz = {}, yz = {};
    V xxy = {}, xxz = {}, yyx = {}, yyz = {}, zzx = {}, zzy = {};

    // grid: the rollout's first node.
    Derivatives(const V* grid, const Place<S>& at) {
        const V* first = grid + at.base;
        UNROLLED for (int i = 0; i < 3; ++i) {
            const Plane on(first + i * at.layer, at);
            const S w = at.w[0][i], dw = at.dw[0][i], c = curvature<S>(i);
            value += w * on.value, y += w * on.y, z += w * on.z, yy += w * on.yy;
            yz += w * on.yz, zz += w * on.zz, yyz += w * on.yyz, zzy += w * on.zzy;
            x += dw * on.value, xy += dw * on.y, xz += dw * on.z, yyx += dw * on.yy, zzx += dw * on.zz;
            xx += c * on.value, xxy += c * on.y, xxz += c * on.z;
        }
    }

    // Columns: first derivatives along x, y, z.
    Mat3<S> gradient() const { return columns(x, y, z); }
    // Sums with four times weight and offset from the particle: of velocities APIC's C, per cell.
    Mat3<S> offset_moments(const Place<S>& at) const {
        return columns(x + at.skew(0) * xx, y + at.skew(1) * yy, z + at.skew(2) * zz);
    }
    // Derivative by the position of the products of a scattered field with the nodes' values.
    Vec3<S> slope(const Field<S>& field, const Place<S>& at) const {
        const V ax = column(field.A, 0), ay = column(field.A, 1), az = column(field.A, 2);
        const V bx = column(field.B, 0), by = column(field.B, 1), bz = column(field.B, 2);
        const V& q = field.q;
        return {{at.skew_slope(0) * dot(column(field.apic, 0), xx) + dot(q, x) + dot(ax, xx) + dot(ay, xy) +
                     dot(az, xz) + dot(by, yyx) + dot(bz, zzx),
                 at.skew_slope(1) * dot(column(field.apic, 1), yy) + dot(q, y) + dot(ax, xy) + dot(ay, yy) +
                     dot(az, yz) + dot(bx, xxy) + dot(bz, zzy),
                 at.skew_slope(2) * dot(column(field.apic, 2), zz) + dot(q, z) + dot(ax, xz) + dot(ay, yz) +
                     dot(az, zz) + dot(bx, xxz) + dot(by, yyz)}};
    }

private:
    struct Line {
        V value, z, zz;
        Line(const V* n, const Place<S>& at) {
            const V a = n[0], b = n[1], c = n[2];
            value = at.w[2][0] * a + at.w[2][1] * b + at.w[2][2] * c;
            z = at.dw[2][0] * a + at.dw[2][1] * b + at.dw[2][2] * c;
            zz = a + S(-2) * b + c;
        }
    };
    struct Plane {
        V value, y, z, yy, yz, zz, yyz, zzy;
        Plane(const V* n, const Place<S>& at) {
            const Line a(n, at), b(n + at.row, at), c(n + 2 * at.row, at);
            const auto weighed = [&](const S* w, const V& p, const V& q, const V& r) {
                return w[0] * p + w[1] * q + w[2] * r;
            };
            value = weighed(at.w[1], a.value, b.value, c.value);
            y = weighed(at.dw[1], a.value, b.value, c.value);
            z = weighed(at.w[1], a.z, b.z, c.z);
            yy = a.value + S(-2) * b.value + c.value;
            yz = weighed(at.dw[1], a.z, b.z, c.z);
            zz = weighed(at.w[1], a.zz, b.zz, c.zz);
            yyz = a.z + S(-2) * b.z + c.z;
            zzy = weighed(at.dw[1], a.zz, b.zz, c.zz);
        }
    };
    static Mat3<S> columns(const V& a, const V& b, const V& c) {
        return {{a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]}};
    }
};

}  // namespace physreal
