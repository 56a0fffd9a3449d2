// The logarithmic (Hencky) strain eps = log V of F = V R in its principal frame, and isotropic functions of it.
//
// The principal frame comes from one-sided Jacobi rotations of the rows of F (Hestenes 1958): nothing is squared, small
// singular values keep their relative accuracy, and repeated ones need no special case. Derivatives of matrix logarithm
// and exponential follow Daleckii and Krein: in the principal frame, entries times divided differences. Written through
// d / sinh(d) these have no cancellation and the right limit where two values meet.
#pragma once

#include "matrix.h"

namespace physreal {

// V = Q exp(eps) Q^T. NaN in `eps` where det F <= 0.
template <class V>
struct Principal {
    Mat3<V> Q;        // columns: principal directions
    Mat3<V> A;        // Q^T F, with orthogonal rows
    Vec3<V> squares;  // of the singular values: exp(2 eps)
    Vec3<V> eps;
};

// Turns rows i, j of A, and columns i, j of Q with them, until the rows are orthogonal; the sine of the angle.
template <class V>
inline V jacobi_rotation(Mat3<V>& A, Mat3<V>& Q, int i, int j) {
    using S = Scalar<V>;
    constexpr S ROUNDING = sizeof(S) == 4 ? S(2e-7) : S(4e-16);
    const V a = A(i, 0) * A(i, 0) + A(i, 1) * A(i, 1) + A(i, 2) * A(i, 2);
    const V b = A(j, 0) * A(j, 0) + A(j, 1) * A(j, 1) + A(j, 2) * A(j, 2);
    const V c = A(i, 0) * A(j, 0) + A(i, 1) * A(j, 1) + A(i, 2) * A(j, 2);
    const V difference = b - a, twice = S(2) * c;
    const V adjacent = abs(difference) + sqrt(difference * difference + twice * twice);
    const V opposite = select(difference < S(0), -twice, twice);
    const V inverse = inverse_sqrt(adjacent * adjacent + opposite * opposite);
    // rows that are orthogonal already stay: the angle would be noise where a and b are equal
    const Mask<V> turns = c * c > ROUNDING * ROUNDING * a * b;
    const V cosine = select(turns, adjacent * inverse, splat<V>(1)), sine = select(turns, opposite * inverse, V{});
    for (int k = 0; k < 3; ++k) {
        const V row = A(i, k), column = Q(k, i);
        A(i, k) = cosine * row - sine * A(j, k);
        A(j, k) = cosine * A(j, k) + sine * row;
        Q(k, i) = cosine * column - sine * Q(k, j);
        Q(k, j) = cosine * Q(k, j) + sine * column;
    }
    return abs(sine);
}

template <class V>
inline Principal<V> principal(const Mat3<V>& F) {
    using S = Scalar<V>;
    constexpr int MOST_SWEEPS = 10;
    Principal<V> p;
    p.A = F;
    p.Q = identity_times(splat<V>(1));
    V turned = splat<V>(1);
    for (int sweep = 0; sweep < MOST_SWEEPS && any(turned >= ITERATE_TOLERANCE<S>); ++sweep) {
        turned = jacobi_rotation(p.A, p.Q, 0, 1);
        turned += jacobi_rotation(p.A, p.Q, 0, 2);
        turned += jacobi_rotation(p.A, p.Q, 1, 2);
    }
    // singular values alone would hide an inversion
    const V proper = one_where_positive(determinant(F));
    for (int i = 0; i < 3; ++i) {
        p.squares[i] = proper * (p.A(i, 0) * p.A(i, 0) + p.A(i, 1) * p.A(i, 1) + p.A(i, 2) * p.A(i, 2));
        p.eps[i] = S(0.5) * log(p.squares[i]);
    }
    return p;
}

// Daleckii and Krein: (eps_i - eps_j) / (s_i^2 - s_j^2), half the divided difference of the logarithm at the squares of
// the singular values; with z = (a - b) / (a + b) it is atanh(z) / z / (a + b), without cancellation where they meet.
template <class V>
inline V log_difference(const Principal<V>& p, int i, int j) {
    using S = Scalar<V>;
    constexpr int TERMS = sizeof(S) == 4 ? 4 : 9;  // of atanh's series, for |z| < 0.1
    const V difference = p.squares[i] - p.squares[j], inverse_sum = S(1) / (p.squares[i] + p.squares[j]);
    const V z = difference * inverse_sum;
    V series = splat<V>(S(1) / S(2 * TERMS - 1));
    for (int k = TERMS - 2; k >= 0; --k) series = series * (z * z) + S(1) / S(2 * k + 1);
    const V apart = (p.eps[i] - p.eps[j]) / difference;
    return select(abs(z) < S(0.1), series * inverse_sum, apart);
}

// F_bar of eps = log V, its adjoint eps_bar given in the principal frame and symmetric.
template <class V>
inline Mat3<V> log_strain_adjoint(const Principal<V>& p, const Mat3<V>& eps_bar) {
    using S = Scalar<V>;
    Mat3<V> b_bar;  // twice the adjoint of F F^T, in the principal frame
    for (int i = 0; i < 3; ++i) {
        b_bar(i, i) = eps_bar(i, i) / p.squares[i];
        for (int j = 0; j < i; ++j) b_bar(i, j) = b_bar(j, i) = S(2) * log_difference(p, i, j) * eps_bar(i, j);
    }
    return p.Q * (b_bar * p.A);
}

// Q diag(d) Q^T.
template <class V>
inline Mat3<V> from_principal(const Mat3<V>& Q, const Vec3<V>& d) {
    Mat3<V> scaled;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j) scaled(i, j) = Q(i, j) * d[j];
    return symmetric_product(scaled, transpose(Q));
}

// A symmetric matrix in the principal frame: Q^T A Q.
template <class V>
inline Mat3<V> to_principal(const Mat3<V>& Q, const Mat3<V>& A) {
    return symmetric_product(transpose(Q), A * Q);
}

}  // namespace physreal
