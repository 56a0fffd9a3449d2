// A triangle of a shell with its three neighbours (shell.py): St. Venant-Kirchhoff membrane, bending by the angles over its edges.
//
// Corners 0, 1, 2; corner 3 + e is the neighbour's over edge e, which is opposite to corner e.
#pragma once
#include "elements.h"

namespace physreal {

template <class T, class V>
class Shell {
public:
    static constexpr int FACE = 3, CORNERS = 6, FRAMES = 0, CONSTANTS = shell::COUNT, STIFFNESS = shell_stiffness::COUNT;

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
            bend(e, x[e], x[(e + 1) % 3], x[(e + 2) % 3], x[3 + e], normal, per_square, constants);
        }
    }

    void forces(const V (&stiffness)[STIFFNESS], Vec3<T> (&f)[CORNERS]) const {
        const auto k = [&](int row) { return lifted<T>(stiffness[row]); };
        const T S00 = k(shell_stiffness::membrane) * strain_[0] + k(shell_stiffness::membrane + 2) * strain_[1];
        const T S11 = k(shell_stiffness::membrane + 2) * strain_[0] + k(shell_stiffness::membrane + 1) * strain_[1];
        const T S01 = k(shell_stiffness::membrane + 3) * strain_[2];
        const Vec3<T> P[2] = {S00 * F_[0] + S01 * F_[1], S01 * F_[0] + S11 * F_[1]};
        const Vec3<T> f1 = lifted<T>(area_ * inverse_[0]) * P[0] + lifted<T>(area_ * inverse_[1]) * P[1];
        const Vec3<T> f2 = lifted<T>(area_ * inverse_[2]) * P[0] + lifted<T>(area_ * inverse_[3]) * P[1];
        f[0] = f[0] + (f1 + f2);
        f[1] = f[1] - f1;
        f[2] = f[2] - f2;
        for (int e = 0; e < 3; ++e) {
            T moment = k(shell_stiffness::bending + e) * bent_[e];
            for (int o = 1; o < 3; ++o) {  // row 3 + i couples the two edges beside edge i
                const int other = (e + o) % 3;
                moment = moment + k(shell_stiffness::bending + 3 + (3 - e - other)) * bent_[other];
            }
            moment = lifted<T>(width_[e]) * moment;
            f[e] = f[e] - moment * own_[e];
            f[3 + e] = f[3 + e] - moment * opposite_[e];
            f[(e + 1) % 3] = f[(e + 1) % 3] - moment * start_[e];
            f[(e + 2) % 3] = f[(e + 2) % 3] - moment * end_[e];
        }
    }

    // For T = Dual<V>.
    void stiffness_adjoint(V (&bar)[STIFFNESS]) const {
        bar[shell_stiffness::membrane] -= area_ * strain_[0].x * strain_[0].slope;
        bar[shell_stiffness::membrane + 1] -= area_ * strain_[1].x * strain_[1].slope;
        bar[shell_stiffness::membrane + 2] -= area_ * (strain_[0].x * strain_[1].slope + strain_[1].x * strain_[0].slope);
        bar[shell_stiffness::membrane + 3] -= area_ * strain_[2].x * strain_[2].slope;
        for (int e = 0; e < 3; ++e) {
            const int a = (e + 1) % 3, b = (e + 2) % 3;
            bar[shell_stiffness::bending + e] -= bent_[e].x * bent_[e].slope;
            bar[shell_stiffness::bending + 3 + e] -= bent_[a].x * bent_[b].slope + bent_[b].x * bent_[a].slope;
        }
    }

private:
    V inverse_[4], area_, width_[3];
    Vec3<T> F_[2];           // columns of the deformation gradient
    T strain_[3], bent_[3];  // Green's, the last one twice; of each edge the angle over a width
    Vec3<T> own_[3], start_[3], end_[3], opposite_[3];  // derivatives of the angles

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
