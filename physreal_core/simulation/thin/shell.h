// A triangle of a shell with its three neighbours (shell.py): St. Venant-Kirchhoff membrane, bending by the angles over its edges.
//
// Corners 0, 1, 2; corner 3 + e is the neighbour's over edge e, which is opposite to corner e.
#pragma once
#include "elements.h"

namespace physreal {

template <class T, class V>
class Shell {
public:
    static constexpr int FACE = 3, CORNERS = 6, FRAMES = 0, CONSTANTS = shell::COUNT, STRAINS = 6;
    static constexpr int STIFFNESS = shell_stiffness::COUNT, STRETCHING = shell_stiffness::bending;

    // x: of a free edge's missing neighbour any vertex.
    Shell(const Vec3<T> (&x)[CORNERS], const V (&constants)[CONSTANTS]) {
        for (int i = 0; i < 4; ++i) inverse_[i] = constants[shell::inverse + i];
        area_ = constants[shell::area];
        const Vec3<T> first = x[1] - x[0], second = x[2] - x[0];
        for (int c = 0; c < 2; ++c)
            F_[c] = lifted<T>(inverse_[c]) * first + lifted<T>(inverse_[2 + c]) * second;
        const T half = lifted<T>(splat<V>(Scalar<V>(0.5))), one = lifted<T>(splat<V>(Scalar<V>(1)));
        strain_[0] = half * (dot(F_[0], F_[0]) - one);
        strain_[1] = half * (dot(F_[1], F_[1]) - one);
        strain_[2] = dot(F_[0], F_[1]);
        const Vec3<T> normal = cross(first, second);
        const T per_square = one / dot(normal, normal);
        for (int e = 0; e < 3; ++e) {
            width_[e] = constants[shell::width + e];
            hinged_[e] = constants[shell::neighbour + e];
            bend(e, x[e], x[(e + 1) % 3], x[(e + 2) % 3], x[3 + e], normal, per_square, constants);
        }
    }

    void strains(T (&e)[STRAINS]) const {
        for (int i = 0; i < 3; ++i) e[i] = strain_[i], e[3 + i] = bent_[i];
    }

    void pull(const T (&s)[STRAINS], Vec3<T> (&f)[CORNERS]) const {
        const Vec3<T> P[2] = {s[0] * F_[0] + s[2] * F_[1], s[2] * F_[0] + s[1] * F_[1]};
        const Vec3<T> f1 = lifted<T>(inverse_[0]) * P[0] + lifted<T>(inverse_[1]) * P[1];
        const Vec3<T> f2 = lifted<T>(inverse_[2]) * P[0] + lifted<T>(inverse_[3]) * P[1];
        f[0] = f[0] + (f1 + f2);
        f[1] = f[1] - f1;
        f[2] = f[2] - f2;
        for (int e = 0; e < 3; ++e) {
            const T moment = lifted<T>(width_[e]) * s[3 + e];
            f[e] = f[e] - moment * own_[e];
            f[3 + e] = f[3 + e] - moment * opposite_[e];
            f[(e + 1) % 3] = f[(e + 1) % 3] - moment * start_[e];
            f[(e + 2) % 3] = f[(e + 2) % 3] - moment * end_[e];
        }
    }

    template <class U>
    void stress(const V (&stiffness)[STIFFNESS], const U (&e)[STRAINS], U (&s)[STRAINS]) const {
        const auto k = [&](int row) { return lifted<U>(stiffness[row]); };
        const U area = lifted<U>(area_);
        const U C11 = k(shell_stiffness::membrane), C22 = k(shell_stiffness::membrane + 1);
        const U C12 = k(shell_stiffness::membrane + 2), C33 = k(shell_stiffness::membrane + 3);
        const U C13 = k(shell_stiffness::membrane + 4), C23 = k(shell_stiffness::membrane + 5);
        s[0] = area * (C11 * e[0] + C12 * e[1] + C13 * e[2]);
        s[1] = area * (C12 * e[0] + C22 * e[1] + C23 * e[2]);
        s[2] = area * (C13 * e[0] + C23 * e[1] + C33 * e[2]);
        for (int i = 0; i < 3; ++i) {
            s[3 + i] = k(shell_stiffness::bending + i) * e[3 + i];
            for (int o = 1; o < 3; ++o) {  // row 3 + i couples the two edges beside edge i
                const int other = (i + o) % 3;
                s[3 + i] = s[3 + i] + k(shell_stiffness::bending + 3 + (3 - i - other)) * e[3 + other];
            }
        }
    }

    // For T = V: tr E, |E|^2 and |K|^2, the curvature K = sum of k_e n_e n_e^T (shell.py), a free edge's k_e zero.
    void invariants(V (&I)[INVARIANTS]) const {
        using S = Scalar<V>;
        I[0] = strain_[0] + strain_[1];
        I[1] = strain_[0] * strain_[0] + strain_[1] * strain_[1] + S(0.5) * strain_[2] * strain_[2];
        V along[3];
        curvature_along(along);
        I[2] = bent_[0] * along[0] + bent_[1] * along[1] + bent_[2] * along[2];
    }
    // Adds to x_bar.
    void invariants_adjoint(const V (&I_bar)[INVARIANTS], Vec3<V> (&x_bar)[CORNERS]) const {
        using S = Scalar<V>;
        V s[STRAINS], along[3];
        for (int i = 0; i < 2; ++i) s[i] = I_bar[0] + S(2) * I_bar[1] * strain_[i];
        s[2] = I_bar[1] * strain_[2];
        curvature_along(along);
        for (int e = 0; e < 3; ++e) s[3 + e] = S(2) * hinged_[e] * I_bar[2] * along[e];
        Vec3<V> f[CORNERS] = {};
        pull(s, f);
        for (int c = 0; c < CORNERS; ++c) x_bar[c] = x_bar[c] - f[c];
    }

    void stiffness_adjoint(const V (&e)[STRAINS], const V (&e_bar)[STRAINS], V (&bar)[STIFFNESS]) const {
        bar[shell_stiffness::membrane] -= area_ * e[0] * e_bar[0];
        bar[shell_stiffness::membrane + 1] -= area_ * e[1] * e_bar[1];
        bar[shell_stiffness::membrane + 2] -= area_ * (e[0] * e_bar[1] + e[1] * e_bar[0]);
        bar[shell_stiffness::membrane + 3] -= area_ * e[2] * e_bar[2];
        bar[shell_stiffness::membrane + 4] -= area_ * (e[0] * e_bar[2] + e[2] * e_bar[0]);
        bar[shell_stiffness::membrane + 5] -= area_ * (e[1] * e_bar[2] + e[2] * e_bar[1]);
        for (int i = 0; i < 3; ++i) {
            const int a = 3 + (i + 1) % 3, b = 3 + (i + 2) % 3;
            bar[shell_stiffness::bending + i] -= e[3 + i] * e_bar[3 + i];
            bar[shell_stiffness::bending + 3 + i] -= e[a] * e_bar[b] + e[b] * e_bar[a];
        }
    }

private:
    V inverse_[4], area_, width_[3], hinged_[3];
    Vec3<T> F_[2];           // columns of the deformation gradient
    T strain_[3], bent_[3];  // Green's, the last one twice; of each edge the angle by its width
    Vec3<T> own_[3], start_[3], end_[3], opposite_[3];  // derivatives of the angles

    // n_e^T K n_e of the edges, n_e along the gradient of what is one at the corner opposite to e and zero on it.
    void curvature_along(V (&along)[3]) const {
        V g[3][2], square[3];
        for (int d = 0; d < 2; ++d) g[1][d] = inverse_[d], g[2][d] = inverse_[2 + d], g[0][d] = -(g[1][d] + g[2][d]);
        for (int e = 0; e < 3; ++e) square[e] = g[e][0] * g[e][0] + g[e][1] * g[e][1], along[e] = bent_[e];
        for (int e = 0; e < 3; ++e) {
            const int other = (e + 1) % 3;
            const V product = g[e][0] * g[other][0] + g[e][1] * g[other][1];
            const V cosine_squared = product * product / (square[e] * square[other]);
            along[e] = along[e] + cosine_squared * bent_[other];
            along[other] = along[other] + cosine_squared * bent_[e];
        }
    }

    // The angle between the normals over edge a b, and its derivatives; c: the own corner opposite to it, d: the neighbour's;
    // per_square: of the normal's length.
    void bend(int e, const Vec3<T>& c, const Vec3<T>& a, const Vec3<T>& b, const Vec3<T>& neighbour, const Vec3<T>& normal,
              const T& per_square, const V (&constants)[CONSTANTS]) {
        const Mask<V> there = constants[shell::neighbour + e] > Scalar<V>(0);
        Vec3<T> d;
        for (int i = 0; i < 3; ++i) d[i] = select(there, neighbour[i], a[i] + b[i] - c[i]);
        const Vec3<T> edge = b - a, other = cross(b - d, a - d);
        const T one = lifted<T>(splat<V>(Scalar<V>(1)));
        const T squared = dot(edge, edge), length = sqrt(squared), per_edge_square = one / squared;
        const T angle = atan2(dot(cross(normal, other), edge) * (length * per_edge_square), dot(normal, other));
        bent_[e] = lifted<T>(width_[e]) * (angle - lifted<T>(constants[shell::rest_angle + e]));
        const T to_own = -length * per_square, to_other = -length / dot(other, other);
        own_[e] = to_own * normal;
        opposite_[e] = to_other * other;
        // places of c and d along the edge, from a to b
        const T c_along = dot(c - a, edge) * per_edge_square, d_along = dot(d - a, edge) * per_edge_square;
        start_[e] = (c_along - one) * own_[e] + (d_along - one) * opposite_[e];
        end_[e] = -c_along * own_[e] - d_along * opposite_[e];
    }
};

}  // namespace physreal
