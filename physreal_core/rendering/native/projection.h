// EWA projection (Zwicker et al. 2001) of Gaussians in the world onto the image and its adjoint, 16 Gaussians at a time.
// With r_i the camera's axes in the world and J the Jacobian of the projection, the footprint is M C M^T, M = J [r_0 r_1 r_2]^T.
#pragma once

#include "scene.h"

namespace physreal {

template <class S> struct Axis { Row<S> x, y, z; };

template <class S> inline Row<S> dot(const Axis<S>& a, const Axis<S>& b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
template <class S> inline Axis<S> operator+(const Axis<S>& a, const Axis<S>& b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
template <class S> inline Axis<S> operator*(Row<S> s, const Axis<S>& a) { return {s * a.x, s * a.y, s * a.z}; }

template <class S> struct Symmetric { Row<S> xx, xy, xz, yy, yz, zz; };

template <class S> inline Axis<S> operator*(const Symmetric<S>& C, const Axis<S>& a)
{
    return {C.xx * a.x + C.xy * a.y + C.xz * a.z, C.xy * a.x + C.yy * a.y + C.yz * a.z,
            C.xz * a.x + C.yz * a.y + C.zz * a.z};
}

// Entry `column` of 16 successive rows; rows past the last repeat it.
template <class S> inline Row<S> gather(const S* rows, int stride, int column, long long first, long long count)
{
    Row<S> lanes;
    for (int i = 0; i < TILE; ++i)
        lanes[i] = rows[(first + i < count ? first + i : count - 1) * stride + column];
    return lanes;
}

// 16 Gaussians on their way to the image.
template <class S> struct Projection
{
    Axis<S> axes[3];          // the camera's, in the world
    Axis<S> from_camera;      // mean - camera centre, in the world
    Row<S> x, y, z, inverse;  // in the camera's frame [m], and 1 / z
    Row<S> x_jacobian, y_jacobian;  // x / z and y / z kept near the field of view
    Symmetric<S> C;
    Row<S> J00, J02, J11, J12;
    Axis<S> M0, M1, CM0, CM1;

    Projection(const Scene<S>& s, long long first)
    {
        const S* P = s.pose;
        for (int i = 0; i < 3; ++i)
            axes[i] = {Row<S>(P[i]), Row<S>(P[4 + i]), Row<S>(P[8 + i])};
        const auto mean = [&](int i) { return gather(s.means, 3, i, first, s.count) - P[4 * i + 3]; };
        const auto covariance = [&](int i) { return gather(s.covariances, 9, i, first, s.count); };
        from_camera = {mean(0), mean(1), mean(2)};
        C = {covariance(0), S(0.5) * (covariance(1) + covariance(3)), S(0.5) * (covariance(2) + covariance(6)),
             covariance(4), S(0.5) * (covariance(5) + covariance(7)), covariance(8)};
        x = dot(axes[0], from_camera), y = dot(axes[1], from_camera), z = dot(axes[2], from_camera);
        inverse = S(1) / z;
        x_jacobian = clamp(x * inverse, s.x_low, s.x_high), y_jacobian = clamp(y * inverse, s.y_low, s.y_high);
        J00 = s.fx * inverse, J11 = s.fy * inverse, J02 = -J00 * x_jacobian, J12 = -J11 * y_jacobian;
        M0 = J00 * axes[0] + J02 * axes[2], M1 = J11 * axes[1] + J12 * axes[2];
        CM0 = C * M0, CM1 = C * M1;
    }

    static Row<S> clamp(Row<S> value, S low, S high) { return min<S, TILE>(max<S, TILE>(value, low), high); }
};

// Splats, tile boxes and this thread's number of pairs.
template <class S> void project(const Scene<S>& s, int thread)
{
    const Share blocks((s.count + TILE - 1) / TILE, thread, s.threads);
    long long pairs = 0;
    for (long long block = blocks.first; block < blocks.end; ++block) {
        const long long first = block * TILE;
        const Projection<S> p(s, first);
        const Row<S> opacity = gather(s.opacities, 1, 0, first, s.count);
        const Row<S> xx = dot(p.M0, p.CM0) + s.low_pass, xy = dot(p.M0, p.CM1), yy = dot(p.M1, p.CM1) + s.low_pass;
        const Row<S> determinant = xx * yy - xy * xy, scale = S(1.4426950408889634) / determinant;
        const Row<S> u = s.fx * p.x * p.inverse + s.cx, v = s.fy * p.y * p.inverse + s.cy;
        const Row<S> spread = S(2) * log<S, TILE>(opacity / s.alpha_min);
        const Row<S> half_x = sqrt<S, TILE>(spread * xx), half_y = sqrt<S, TILE>(spread * yy), width2 = determinant / yy;
        // Clamped before the cast: a far-off centre must not overflow an integer.
        const Row<S> left = Projection<S>::clamp(u - half_x, S(0), S(s.width));
        const Row<S> right = Projection<S>::clamp(u + half_x, S(-1), S(s.width - 1));
        const Row<S> top = Projection<S>::clamp(v - half_y, S(0), S(s.height));
        const Row<S> bottom = Projection<S>::clamp(v + half_y, S(-1), S(s.height - 1));
        const Row<S> first_x = __builtin_elementwise_ceil(left), last_x = __builtin_elementwise_floor(right);
        const Row<S> first_y = __builtin_elementwise_ceil(top), last_y = __builtin_elementwise_floor(bottom);
        // Written so that NaN anywhere means: not drawn.
        const RowMask<S> drawn = (p.z >= s.near) & (opacity >= s.alpha_min) & (determinant > S(0)) & (first_x <= last_x) &
                                 (first_y <= last_y);
        for (int i = 0; i < TILE && first + i < s.count; ++i) {
            if (!drawn[i]) {
                s.boxes[first + i] = {0, -1, 0, -1};
                continue;
            }
            const S* colour = s.colours + 3 * (first + i);
            s.splats[first + i] = {
                u[i], v[i], S(-0.5) * yy[i] * scale[i], xy[i] * scale[i], S(-0.5) * xx[i] * scale[i],
                opacity[i], S(-0.72134752044448170) * spread[i],
                xy[i] / yy[i], spread[i] * width2[i], width2[i] / yy[i],
                {colour[0], colour[1], colour[2], p.z[i]}, {}};
            const TileBox box = {int(first_x[i]) / TILE, int(last_x[i]) / TILE, int(first_y[i]) / TILE,
                                 int(last_y[i]) / TILE};
            s.boxes[first + i] = box;
            pairs += (long long)(box.right - box.left + 1) * (box.bottom - box.top + 1);
        }
    }
    s.pairs[thread] = pairs;
}

// Adjoint of `project`, from the moments of all threads. Everything is written, zeros where nothing was drawn.
template <class S> void project_adjoint(const Scene<S>& s, int thread)
{
    const Share blocks((s.count + TILE - 1) / TILE, thread, s.threads);
    Axis<S> axes_bar[3] = {}, centre_bar = {};
    for (long long block = blocks.first; block < blocks.end; ++block) {
        const long long first = block * TILE;
        const int valid = int(s.count - first < TILE ? s.count - first : TILE);
        RowMask<S> drawn = {};
        Row<S> m[FEATURES + 4] = {};
        Row<S> opacity = {}, u_factor = {}, uv_factor = {}, v_factor = {};
        for (int i = 0; i < valid; ++i) {
            const TileBox& box = s.boxes[first + i];
            if (box.left > box.right)
                continue;
            drawn[i] = -1;
            for (int t = 0; t < s.threads; ++t)
                for (int k = 0; k < FEATURES + 4; ++k)
                    m[k][i] += s.moments[(t * s.count + first + i) * MOMENTS + k];
            const Splat<S>& splat = s.splats[first + i];
            const S to_conic = S(-1.3862943611198906);  // -2 ln 2
            opacity[i] = splat.opacity;
            u_factor[i] = to_conic * splat.xx, v_factor[i] = to_conic * splat.yy;
            uv_factor[i] = S(0.5) * to_conic * splat.xy;
        }
        Axis<S> mean_bar = {};
        Symmetric<S> C_bar = {};
        if (any<S, TILE>(drawn)) {
            const Projection<S> p(s, first);
            // K is the inverse of the footprint; d loss / d footprint = -K G K with G = d loss / d K.
            const Row<S> Kxx = u_factor, Kxy = uv_factor, Kyy = v_factor;
            const Row<S> u_bar = opacity * (Kxx * m[Q_X] + Kxy * m[Q_Y]), v_bar = opacity * (Kxy * m[Q_X] + Kyy * m[Q_Y]);
            const Row<S> Gxx = S(-0.5) * opacity * m[Q_XX], Gxy = S(-0.5) * opacity * m[Q_XY],
                         Gyy = S(-0.5) * opacity * m[Q_YY];
            const Row<S> a = Gxx * Kxx + Gxy * Kxy, b = Gxx * Kxy + Gxy * Kyy, c = Gxy * Kxx + Gyy * Kxy,
                         d = Gxy * Kxy + Gyy * Kyy;
            const Row<S> Sxx = -(Kxx * a + Kxy * c), Sxy = -(Kxx * b + Kxy * d), Syy = -(Kxy * b + Kyy * d);
            const Axis<S> A = Sxx * p.M0 + Sxy * p.M1, B = Sxy * p.M0 + Syy * p.M1;
            C_bar = {p.M0.x * A.x + p.M1.x * B.x, p.M0.x * A.y + p.M1.x * B.y, p.M0.x * A.z + p.M1.x * B.z,
                     p.M0.y * A.y + p.M1.y * B.y, p.M0.y * A.z + p.M1.y * B.z, p.M0.z * A.z + p.M1.z * B.z};
            const Row<S> two = S(2);
            const Axis<S> M0_bar = two * (Sxx * p.CM0 + Sxy * p.CM1), M1_bar = two * (Sxy * p.CM0 + Syy * p.CM1);
            const Row<S> J00_bar = dot(M0_bar, p.axes[0]), J02_bar = dot(M0_bar, p.axes[2]);
            const Row<S> J11_bar = dot(M1_bar, p.axes[1]), J12_bar = dot(M1_bar, p.axes[2]);
            const Row<S> x_free = p.x * p.inverse, y_free = p.y * p.inverse, none = S(0);
            // Inside the clamp J02 = -J00 x / z follows the mean; at it, J02 follows 1 / z alone.
            const Row<S> x_slope = ((x_free > s.x_low) & (x_free < s.x_high)) ? -J02_bar * p.J00 * p.inverse : none;
            const Row<S> y_slope = ((y_free > s.y_low) & (y_free < s.y_high)) ? -J12_bar * p.J11 * p.inverse : none;
            const Row<S> x_bar = u_bar * p.J00 + x_slope, y_bar = v_bar * p.J11 + y_slope;
            const Row<S> z_bar = m[FEATURES + 3] - x_slope * x_free - y_slope * y_free -
                                 p.inverse * (J00_bar * p.J00 + J02_bar * p.J02 + J11_bar * p.J11 + J12_bar * p.J12 +
                                              u_bar * p.J00 * p.x + v_bar * p.J11 * p.y);
            mean_bar = x_bar * p.axes[0] + y_bar * p.axes[1] + z_bar * p.axes[2];
            // Lanes that were not drawn may hold anything: the camera sums over lanes.
            const auto kept = [&](const Axis<S>& v) -> Axis<S> {
                return {drawn ? v.x : none, drawn ? v.y : none, drawn ? v.z : none};
            };
            centre_bar = centre_bar + kept(mean_bar);
            axes_bar[0] = axes_bar[0] + kept(x_bar * p.from_camera + p.J00 * M0_bar);
            axes_bar[1] = axes_bar[1] + kept(y_bar * p.from_camera + p.J11 * M1_bar);
            axes_bar[2] = axes_bar[2] + kept(z_bar * p.from_camera + p.J02 * M0_bar + p.J12 * M1_bar);
        }
        for (int i = 0; i < valid; ++i) {
            const long long g = first + i;
            const S keep = drawn[i] ? S(1) : S(0);
            const Row<S> mean[3] = {mean_bar.x, mean_bar.y, mean_bar.z};
            const Row<S> C[9] = {C_bar.xx, C_bar.xy, C_bar.xz, C_bar.xy, C_bar.yy, C_bar.yz, C_bar.xz, C_bar.yz, C_bar.zz};
            for (int k = 0; k < 3; ++k)
                s.means_bar[3 * g + k] = keep ? mean[k][i] : S(0), s.colours_bar[3 * g + k] = m[FEATURES + k][i];
            for (int k = 0; k < 9; ++k)
                s.covariances_bar[9 * g + k] = keep ? C[k][i] : S(0);
            s.opacities_bar[g] = m[Q][i];
        }
    }
    S* pose_bar = s.pose_bar + 12 * thread;
    for (int i = 0; i < 3; ++i) {
        pose_bar[i] = sum<S, TILE>(axes_bar[i].x), pose_bar[4 + i] = sum<S, TILE>(axes_bar[i].y);
        pose_bar[8 + i] = sum<S, TILE>(axes_bar[i].z);
    }
    pose_bar[3] = -sum<S, TILE>(centre_bar.x), pose_bar[7] = -sum<S, TILE>(centre_bar.y);
    pose_bar[11] = -sum<S, TILE>(centre_bar.z);
}

}  // namespace physreal
