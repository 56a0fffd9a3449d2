// EWA projection (Zwicker et al. 2001) of Gaussians in the world onto the image, and its adjoint. V is one number or
// lanes of them. With r_i the camera's axes in the world and J the projection's Jacobian, the footprint is M C M^T with
// M = J [r_0 r_1 r_2]^T.
#pragma once

#include "scene.h"

namespace physreal {

template <class V> struct Axis {
  V x, y, z;
};

template <class V> inline V dot(const Axis<V>& a, const Axis<V>& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class V> inline Axis<V> operator+(const Axis<V>& a, const Axis<V>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <class V> inline Axis<V> scaled(V s, const Axis<V>& a) { return {s * a.x, s * a.y, s * a.z}; }

template <class V> struct Symmetric {
  V xx, xy, xz, yy, yz, zz;
};

template <class V> inline Axis<V> operator*(const Symmetric<V>& C, const Axis<V>& a) {
  return {C.xx * a.x + C.xy * a.y + C.xz * a.z, C.xy * a.x + C.yy * a.y + C.yz * a.z,
          C.xz * a.x + C.yz * a.y + C.zz * a.z};
}

template <class V> inline V clamped(V value, V low, V high) {
  value = value < low ? low : value;
  return value > high ? high : value;
}

// From the world to the footprint.
template <class S, class V> struct Projection {
  Axis<V> axes[3];      // the camera's, in the world
  Axis<V> from_camera;  // mean - camera centre, in the world
  V x, y, z, inverse;   // in the camera's frame [m], and 1 / z
  Symmetric<V> C;
  V J00, J02, J11, J12;
  Axis<V> M0, M1, CM0, CM1;

  // entry(array, stride, column) gives a number of the Gaussian from an array of `stride` numbers each.
  template <class Entry> Projection(const Scene<S>& s, Entry&& entry) {
    const S* P = s.pose;
    for (int i = 0; i < 3; ++i) axes[i] = {V(P[i]), V(P[4 + i]), V(P[8 + i])};
    from_camera = {entry(s.means, 3, 0) - V(P[3]), entry(s.means, 3, 1) - V(P[7]), entry(s.means, 3, 2) - V(P[11])};
    const auto mixed = [&](int a, int b) -> V {
      return V(S(0.5)) * (entry(s.covariances, 9, a) + entry(s.covariances, 9, b));
    };
    C = {entry(s.covariances, 9, 0), mixed(1, 3), mixed(2, 6),
         entry(s.covariances, 9, 4), mixed(5, 7), entry(s.covariances, 9, 8)};
    x = dot(axes[0], from_camera), y = dot(axes[1], from_camera), z = dot(axes[2], from_camera);
    inverse = V(S(1)) / z;
    J00 = V(s.fx) * inverse, J11 = V(s.fy) * inverse;
    J02 = -J00 * clamped<V>(x * inverse, V(s.x_low), V(s.x_high));
    J12 = -J11 * clamped<V>(y * inverse, V(s.y_low), V(s.y_high));
    M0 = scaled(J00, axes[0]) + scaled(J02, axes[2]), M1 = scaled(J11, axes[1]) + scaled(J12, axes[2]);
    CM0 = C * M0, CM1 = C * M1;
  }
};

// The Gaussian on the image, and the pixels that its box takes in.
template <class S, class V> struct Outline {
  V u, v, xx, xy, yy, determinant, spread, left, right, top, bottom;

  Outline(const Scene<S>& s, const Projection<S, V>& p, V opacity) {
    u = V(s.fx) * p.x * p.inverse + V(s.cx), v = V(s.fy) * p.y * p.inverse + V(s.cy);
    xx = dot(p.M0, p.CM0) + V(s.low_pass), xy = dot(p.M0, p.CM1), yy = dot(p.M1, p.CM1) + V(s.low_pass);
    determinant = xx * yy - xy * xy;
    spread = V(S(2)) * log(opacity / V(s.alpha_min));  // d^2 at which alpha reaches the threshold
    const V half_x = sqrt(spread * xx), half_y = sqrt(spread * yy);
    // Clamped before they are cast to integers: a far-off centre must not overflow.
    left = ceil(clamped<V>(u - half_x, V(S(0)), V(S(s.width))));
    right = floor(clamped<V>(u + half_x, V(S(-1)), V(S(s.width - 1))));
    top = ceil(clamped<V>(v - half_y, V(S(0)), V(S(s.height))));
    bottom = floor(clamped<V>(v + half_y, V(S(-1)), V(S(s.height - 1))));
  }

  // Comparisons written so that NaN anywhere means: not drawn.
  auto drawn(const Scene<S>& s, V z, V opacity) const {
    return (z >= V(s.near)) & (opacity >= V(s.alpha_min)) & (determinant > V(S(0))) & (left <= right) & (top <= bottom);
  }
};

template <class S>
inline Splat<S> make_splat(S u, S v, S xx, S xy, S yy, S determinant, S spread, S opacity, S z, const S* colour) {
  const S scale = S(1.4426950408889634) / determinant, width2 = determinant / yy;  // log2 e
  return {u,
          v,
          S(-0.5) * yy * scale,
          xy * scale,
          S(-0.5) * xx * scale,
          opacity,
          S(-0.72134752044448170) * spread,
          xy / yy,
          spread * width2,
          width2 / yy,
          {colour[0], colour[1], colour[2], z},
          {}};
}

template <class S> inline TileBox tile_box(S left, S right, S top, S bottom) {
  return {int(left) / TILE, int(right) / TILE, int(top) / TILE, int(bottom) / TILE};
}

// Adjoint of `Projection` and the conic: from the moments to the Gaussian's mean and covariance and the camera's pose.
template <class S, class V> struct ProjectionBar {
  Axis<V> mean;
  Symmetric<V> C;
  Axis<V> axes[3];

  // Kxx, Kxy, Kyy: inverse of the footprint; d loss / d footprint = -K G K with G = d loss / d K.
  ProjectionBar(const Scene<S>& s, const Projection<S, V>& p, V opacity, V Kxx, V Kxy, V Kyy, const V (&m)[USED]) {
    const V u_bar = opacity * (Kxx * m[Q_X] + Kxy * m[Q_Y]), v_bar = opacity * (Kxy * m[Q_X] + Kyy * m[Q_Y]);
    const V half = V(S(-0.5)) * opacity, two = V(S(2)), none = V(S(0));
    const V Gxx = half * m[Q_XX], Gxy = half * m[Q_XY], Gyy = half * m[Q_YY];
    const V a = Gxx * Kxx + Gxy * Kxy, b = Gxx * Kxy + Gxy * Kyy, c = Gxy * Kxx + Gyy * Kxy, d = Gxy * Kxy + Gyy * Kyy;
    const V Sxx = -(Kxx * a + Kxy * c), Sxy = -(Kxx * b + Kxy * d), Syy = -(Kxy * b + Kyy * d);
    const Axis<V> A = scaled(Sxx, p.M0) + scaled(Sxy, p.M1), B = scaled(Sxy, p.M0) + scaled(Syy, p.M1);
    C = {p.M0.x * A.x + p.M1.x * B.x, p.M0.x * A.y + p.M1.x * B.y, p.M0.x * A.z + p.M1.x * B.z,
         p.M0.y * A.y + p.M1.y * B.y, p.M0.y * A.z + p.M1.y * B.z, p.M0.z * A.z + p.M1.z * B.z};
    const Axis<V> M0 = scaled<V>(two * Sxx, p.CM0) + scaled<V>(two * Sxy, p.CM1);
    const Axis<V> M1 = scaled<V>(two * Sxy, p.CM0) + scaled<V>(two * Syy, p.CM1);
    const V J00 = dot(M0, p.axes[0]), J02 = dot(M0, p.axes[2]), J11 = dot(M1, p.axes[1]), J12 = dot(M1, p.axes[2]);
    const V x_ratio = p.x * p.inverse, y_ratio = p.y * p.inverse;
    // Within its bounds J02 = -J00 x / z follows the mean; at them it follows 1 / z alone.
    const V x_slope = ((x_ratio > V(s.x_low)) & (x_ratio < V(s.x_high))) ? -J02 * p.J00 * p.inverse : none;
    const V y_slope = ((y_ratio > V(s.y_low)) & (y_ratio < V(s.y_high))) ? -J12 * p.J11 * p.inverse : none;
    const V x = u_bar * p.J00 + x_slope, y = v_bar * p.J11 + y_slope;
    const V z =
        m[FEATURES + 3] - x_slope * x_ratio - y_slope * y_ratio -
        p.inverse * (J00 * p.J00 + J02 * p.J02 + J11 * p.J11 + J12 * p.J12 + u_bar * p.J00 * p.x + v_bar * p.J11 * p.y);
    mean = scaled(x, p.axes[0]) + scaled(y, p.axes[1]) + scaled(z, p.axes[2]);
    axes[0] = scaled(x, p.from_camera) + scaled(p.J00, M0);
    axes[1] = scaled(y, p.from_camera) + scaled(p.J11, M1);
    axes[2] = scaled(z, p.from_camera) + scaled(p.J02, M0) + scaled(p.J12, M1);
  }
};

// The inverse of the footprint from a splat's falloff, xx, xy, yy.
template <class S> inline void conic(const Splat<S>& splat, S (&K)[3]) {
  const S factor = S(-1.3862943611198906);  // -2 ln 2
  K[0] = factor * splat.xx, K[1] = S(0.5) * factor * splat.xy, K[2] = factor * splat.yy;
}

}  // namespace physreal
