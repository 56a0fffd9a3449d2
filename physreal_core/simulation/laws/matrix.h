// 3-vectors and 3x3 matrices; cofactor, polar rotation and its adjoint, exact where singular values repeat.
#pragma once

#include "number.h"

namespace physreal {

template <class V>
struct Vec3 {
    V v[3];
    V& operator[](int i) { return v[i]; }
    const V& operator[](int i) const { return v[i]; }
};

// Row-major.
template <class V>
struct Mat3 {
    V m[9];
    V& operator()(int i, int j) { return m[3 * i + j]; }
    const V& operator()(int i, int j) const { return m[3 * i + j]; }
};

template <class V>
inline V dot(const Vec3<V>& a, const Vec3<V>& b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
template <class V>
inline Vec3<V> operator+(const Vec3<V>& a, const Vec3<V>& b) {
    return {{a[0] + b[0], a[1] + b[1], a[2] + b[2]}};
}
template <class V>
inline Vec3<V> operator-(const Vec3<V>& a, const Vec3<V>& b) {
    return {{a[0] - b[0], a[1] - b[1], a[2] - b[2]}};
}
template <class V>
inline Vec3<V> operator*(V s, const Vec3<V>& a) {
    return {{s * a[0], s * a[1], s * a[2]}};
}

// a b^T.
template <class V>
inline Mat3<V> outer(const Vec3<V>& a, const Vec3<V>& b) {
    Mat3<V> C;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) C(i, j) = a[i] * b[j];
    return C;
}

template <class V>
inline Mat3<V> diagonal(const Vec3<V>& d) {
    Mat3<V> A = {};
    for (int i = 0; i < 3; ++i) A(i, i) = d[i];
    return A;
}

template <class V>
inline Mat3<V> identity_times(V s) {
    return diagonal<V>({{s, s, s}});
}

template <class V>
inline Mat3<V>& operator+=(Mat3<V>& A, const Mat3<V>& B) {
    for (int i = 0; i < 9; ++i) A.m[i] += B.m[i];
    return A;
}
template <class V>
inline Mat3<V> operator+(Mat3<V> A, const Mat3<V>& B) {
    return A += B;
}

template <class V>
inline Mat3<V> operator-(const Mat3<V>& A, const Mat3<V>& B) {
    Mat3<V> C;
    for (int i = 0; i < 9; ++i) C.m[i] = A.m[i] - B.m[i];
    return C;
}

// s: a V, or a scalar for all of its lanes.
template <class T, class V>
inline Mat3<V> operator*(T s, const Mat3<V>& A) {
    Mat3<V> B;
    for (int i = 0; i < 9; ++i) B.m[i] = s * A.m[i];
    return B;
}

template <class V>
inline Mat3<V> operator*(const Mat3<V>& A, const Mat3<V>& B) {
    Mat3<V> C;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) C(i, j) = A(i, 0) * B(0, j) + A(i, 1) * B(1, j) + A(i, 2) * B(2, j);
    return C;
}

template <class V>
inline Vec3<V> operator*(const Mat3<V>& A, const Vec3<V>& b) {
    Vec3<V> c;
    for (int i = 0; i < 3; ++i) c[i] = A(i, 0) * b[0] + A(i, 1) * b[1] + A(i, 2) * b[2];
    return c;
}

template <class V>
inline Mat3<V> transpose(const Mat3<V>& A) {
    Mat3<V> B;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) B(i, j) = A(j, i);
    return B;
}

template <class V>
inline Mat3<V> symmetric(const Mat3<V>& A) {
    Mat3<V> B;
    for (int i = 0; i < 3; ++i) {
        B(i, i) = A(i, i);
        for (int j = 0; j < i; ++j) B(i, j) = B(j, i) = Scalar<V>(0.5) * (A(i, j) + A(j, i));
    }
    return B;
}

// A B where it is known to be symmetric: six entries, mirrored.
template <class V>
inline Mat3<V> symmetric_product(const Mat3<V>& A, const Mat3<V>& B) {
    Mat3<V> C;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j <= i; ++j) C(i, j) = C(j, i) = A(i, 0) * B(0, j) + A(i, 1) * B(1, j) + A(i, 2) * B(2, j);
    return C;
}

template <class V>
inline V trace(const Mat3<V>& A) {
    return A(0, 0) + A(1, 1) + A(2, 2);
}

// Double contraction A : B.
template <class V>
inline V dot(const Mat3<V>& A, const Mat3<V>& B) {
    V sum = A.m[0] * B.m[0];
    for (int i = 1; i < 9; ++i) sum += A.m[i] * B.m[i];
    return sum;
}

// Derivative of the determinant: F^-T det F.
template <class V>
inline Mat3<V> cofactor(const Mat3<V>& F) {
    Mat3<V> C;
    for (int i = 0; i < 3; ++i) {
        const int i1 = (i + 1) % 3, i2 = (i + 2) % 3;
        for (int j = 0; j < 3; ++j) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            C(i, j) = F(i1, j1) * F(i2, j2) - F(i1, j2) * F(i2, j1);
        }
    }
    return C;
}

// det F from F and its cofactor.
template <class V>
inline V determinant(const Mat3<V>& F, const Mat3<V>& C) {
    return F(0, 0) * C(0, 0) + F(1, 0) * C(1, 0) + F(2, 0) * C(2, 0);
}
template <class V>
inline V determinant(const Mat3<V>& F) {
    return determinant(F, cofactor(F));
}

// NaN in the lanes where J <= 0 (or is NaN), 1 elsewhere.
template <class V>
inline V one_where_positive(V J) {
    return select(J > Scalar<V>(0), splat<V>(1), splat<V>(not_a_number<Scalar<V>>()));
}

// Change of a Newton or Jacobi iterate below which the next, quadratically smaller one is rounding.
template <class S>
constexpr S ITERATE_TOLERANCE = sizeof(S) == 4 ? S(2e-4) : S(1e-8);

// R of F = R U; NaN in the lanes where det F <= 0, so that an inverted particle is seen and not reflected.
// Newton's iteration X <- (g X + X^-T / g) / 2 with Higham's Frobenius scaling g (SIAM J. Sci. Stat. Comput. 7(4),
// 1986) until X is near: at most about nine steps however ill-conditioned F is, four at moderate strain. All lanes go
// on until the last of them has converged.
template <class V>
inline Mat3<V> polar_rotation(const Mat3<V>& F) {
    using S = Scalar<V>;
    constexpr int MOST_STEPS = 16;
    constexpr S FAR = 0.1, CONVERGED = ITERATE_TOLERANCE<S> * ITERATE_TOLERANCE<S>;
    Mat3<V> X = one_where_positive(determinant(F)) * F;
    V change = splat<V>(FAR);
    for (int step = 0; step < MOST_STEPS && any(change >= CONVERGED); ++step) {
        const Mat3<V> C = cofactor(X);
        const V inverse_J = S(1) / determinant(X, C);
        V g = splat<V>(1);
        if (any(change >= FAR)) g = select(change >= FAR, sqrt(sqrt(dot(C, C) / dot(X, X)) * inverse_J), g);
        const V of_X = S(0.5) * g, of_C = S(0.5) * inverse_J / g;
        change = V{};
        for (int i = 0; i < 9; ++i) {
            const V Y = of_X * X.m[i] + of_C * C.m[i];
            const V difference = Y - X.m[i];
            change += difference * difference;
            X.m[i] = Y;
        }
    }
    return X;
}

// F_bar of R = polar_rotation(F): dR = R [w]x with (tr(U) I - U) w = axl(R^T dF - dF^T R), a symmetric matrix.
template <class V>
inline Mat3<V> polar_rotation_adjoint(const Mat3<V>& F, const Mat3<V>& R, const Mat3<V>& R_bar) {
    const Mat3<V> U = symmetric_product(transpose(R), F);
    const Mat3<V> W = transpose(R) * R_bar;
    const Vec3<V> axial = {{W(2, 1) - W(1, 2), W(0, 2) - W(2, 0), W(1, 0) - W(0, 1)}};
    const Mat3<V> K = identity_times(trace(U)) - U;
    const Mat3<V> C = cofactor(K);
    const Vec3<V> w = (Scalar<V>(1) / determinant(K, C)) * (C * axial);  // C symmetric, as K is
    Mat3<V> F_bar;                                                       // R [w]x
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) {
            const int j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            F_bar(i, j) = R(i, j1) * w[j2] - R(i, j2) * w[j1];
        }
    return F_bar;
}

}  // namespace physreal
