// Plain C++ reference of the forward MLS-MPM step: fixed corotated, APIC, quadratic B-splines, float32.
//
// Particles are sorted by cell once and processed in groups of LANES: the arithmetic of a group is written as loops over
// its lanes, which the compiler turns into vector code; scatter and gather go particle by particle, a node's momentum
// and mass side by side. Each thread scatters to a grid of its own. Only nodes that the block can reach are visited.

#include <omp.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <numeric>
#include <vector>

namespace {

constexpr int LANES = 16;
constexpr int NEWTON_STEPS = 16;
constexpr float NEWTON_TOLERANCE = 1e-12f;  // squared Frobenius norm of a step

using Node = float __attribute__((vector_size(16)));  // momentum or velocity, and mass
using Lane = std::array<float, LANES>;

struct Settings {
    int32_t particles, substeps, grid_nodes, threads;
    float cell, time_step, mass, volume, mu, lambda;
    float gravity[3];
};

// A group of particles, one lane each; C and F row-major.
struct alignas(64) Group {
    Lane x[3], v[3], F[9], C[9];
    int count = 0;
};

// Where a group's particles lie on the grid: first node, distance from it in cells, weights per axis and node.
struct alignas(64) Place {
    std::array<int, LANES> node;
    Lane f[3], w[3][3];
};

struct Box {
    int first[3], count[3];
    int nodes() const { return count[0] * count[1] * count[2]; }
};

void cofactor(const Lane A[9], Lane C[9]) {
    for (int l = 0; l < LANES; ++l) {
        C[0][l] = A[4][l] * A[8][l] - A[5][l] * A[7][l];
        C[1][l] = A[5][l] * A[6][l] - A[3][l] * A[8][l];
        C[2][l] = A[3][l] * A[7][l] - A[4][l] * A[6][l];
        C[3][l] = A[2][l] * A[7][l] - A[1][l] * A[8][l];
        C[4][l] = A[0][l] * A[8][l] - A[2][l] * A[6][l];
        C[5][l] = A[1][l] * A[6][l] - A[0][l] * A[7][l];
        C[6][l] = A[1][l] * A[5][l] - A[2][l] * A[4][l];
        C[7][l] = A[2][l] * A[3][l] - A[0][l] * A[5][l];
        C[8][l] = A[0][l] * A[4][l] - A[1][l] * A[3][l];
    }
}

void determinant(const Lane A[9], const Lane C[9], Lane& J) {
    for (int l = 0; l < LANES; ++l) J[l] = A[0][l] * C[0][l] + A[1][l] * C[1][l] + A[2][l] * C[2][l];
}

// Rotation R of F = R U by Newton's iteration R <- (R + R^-T) / 2, until the whole group stands still.
void polar_rotation(const Lane F[9], Lane R[9]) {
    Lane C[9], J, change;
    std::copy(F, F + 9, R);
    for (int step = 0; step < NEWTON_STEPS; ++step) {
        cofactor(R, C);
        determinant(R, C, J);
        change.fill(0.0f);
        for (int l = 0; l < LANES; ++l) J[l] = 0.5f / J[l];
        for (int e = 0; e < 9; ++e)
            for (int l = 0; l < LANES; ++l) {
                const float next = 0.5f * R[e][l] + J[l] * C[e][l];
                change[l] += (next - R[e][l]) * (next - R[e][l]);
                R[e][l] = next;
            }
        if (*std::max_element(change.begin(), change.end()) < NEWTON_TOLERANCE) return;
    }
}

// A = dx (m C - dt V (4 / dx^2) tau), the matrix that takes a node's offset in cells to momentum.
void affine_momentum(const Settings& s, const Group& g, Lane A[9]) {
    Lane R[9], cof[9], J;
    polar_rotation(g.F, R);
    cofactor(g.F, cof);
    determinant(g.F, cof, J);
    const float inertia = s.mass * s.cell, stress = 4.0f * s.time_step * s.volume / s.cell;
    for (int i = 0; i < 3; ++i)
        for (int j = 0; j < 3; ++j)
            for (int l = 0; l < LANES; ++l) {
                float tau = 0.0f;
                for (int k = 0; k < 3; ++k) tau += (g.F[3 * i + k][l] - R[3 * i + k][l]) * g.F[3 * j + k][l];
                tau *= 2.0f * s.mu;
                if (i == j) tau += s.lambda * J[l] * (J[l] - 1.0f);
                A[3 * i + j][l] = inertia * g.C[3 * i + j][l] - stress * tau;
            }
}

void locate(const Settings& s, const Box& box, const Group& g, Place& place) {
    const float cells = 1.0f / s.cell;
    place.node.fill(0);
    for (int d = 0; d < 3; ++d)
        for (int l = 0; l < LANES; ++l) {
            const float X = g.x[d][l] * cells;
            const int base = static_cast<int>(X - 0.5f);
            const float f = X - static_cast<float>(base);
            place.f[d][l] = f;
            place.w[d][0][l] = 0.5f * (1.5f - f) * (1.5f - f);
            place.w[d][1][l] = 0.75f - (f - 1.0f) * (f - 1.0f);
            place.w[d][2][l] = 0.5f * (f - 0.5f) * (f - 0.5f);
            place.node[l] = place.node[l] * box.count[d] + base - box.first[d];
        }
}

void scatter(const Settings& s, const Box& box, const Group& g, Node* grid) {
    Place place;
    Lane A[9], q[3];
    locate(s, box, g, place);
    affine_momentum(s, g, A);
    for (int d = 0; d < 3; ++d)
        for (int l = 0; l < LANES; ++l)
            q[d][l] = s.mass * g.v[d][l] - A[3 * d][l] * place.f[0][l] - A[3 * d + 1][l] * place.f[1][l] -
                      A[3 * d + 2][l] * place.f[2][l];
    for (int l = 0; l < g.count; ++l) {
        const Node ax = {A[0][l], A[3][l], A[6][l], 0}, ay = {A[1][l], A[4][l], A[7][l], 0};
        const Node az = {A[2][l], A[5][l], A[8][l], 0};
        Node qi = {q[0][l], q[1][l], q[2][l], s.mass};
        for (int i = 0; i < 3; ++i, qi += ax) {
            Node qj = qi;
            for (int j = 0; j < 3; ++j, qj += ay) {
                const float w = place.w[0][i][l] * place.w[1][j][l];
                Node* row = grid + place.node[l] + (i * box.count[1] + j) * box.count[2];
                row[0] += w * place.w[2][0][l] * qj;
                row[1] += w * place.w[2][1][l] * (qj + az);
                row[2] += w * place.w[2][2][l] * (qj + az + az);
            }
        }
    }
}

// Sums of all threads' grids to velocities; nothing leaves through the outermost nodes of the whole grid.
void update(const Settings& s, const Box& box, std::vector<std::vector<Node>>& grids, int begin, int end) {
    constexpr int BOUND = 3;
    for (int n = begin; n < end; ++n) {
        Node p = grids[0][n];
        for (size_t t = 1; t < grids.size(); ++t) p += grids[t][n];
        if (p[3] > 0.0f) {
            const int index[3] = {n / (box.count[1] * box.count[2]) + box.first[0],
                                  n / box.count[2] % box.count[1] + box.first[1], n % box.count[2] + box.first[2]};
            for (int d = 0; d < 3; ++d) {
                p[d] = p[d] / p[3] + s.time_step * s.gravity[d];
                if (index[d] < BOUND) p[d] = std::max(p[d], 0.0f);
                if (index[d] > s.grid_nodes - BOUND) p[d] = std::min(p[d], 0.0f);
            }
        }
        grids[0][n] = p;
    }
}

void gather(const Settings& s, const Box& box, const Node* grid, Group& g) {
    Place place;
    locate(s, box, g, place);
    alignas(64) float sums[4][3][LANES] = {};  // velocity and its first moments along x, y, z in cells
    for (int l = 0; l < g.count; ++l) {
        Node V = {}, BX = {}, BY = {}, BZ = {};
        for (int i = 0; i < 3; ++i)
            for (int j = 0; j < 3; ++j) {
                const float w = place.w[0][i][l] * place.w[1][j][l];
                const Node* row = grid + place.node[l] + (i * box.count[1] + j) * box.count[2];
                const Node a = place.w[2][1][l] * row[1], b = place.w[2][2][l] * row[2];
                const Node sum = w * (place.w[2][0][l] * row[0] + a + b);
                V += sum;
                BX += static_cast<float>(i) * sum;
                BY += static_cast<float>(j) * sum;
                BZ += w * (a + b + b);
            }
        for (int d = 0; d < 3; ++d) {
            sums[0][d][l] = V[d];
            sums[1][d][l] = BX[d];
            sums[2][d][l] = BY[d];
            sums[3][d][l] = BZ[d];
        }
    }
    const float scale = 4.0f / s.cell, dt = s.time_step;
    for (int i = 0; i < 3; ++i) {
        for (int l = 0; l < LANES; ++l) {
            g.v[i][l] = sums[0][i][l];
            g.x[i][l] += dt * sums[0][i][l];
        }
        for (int d = 0; d < 3; ++d)
            for (int l = 0; l < LANES; ++l)
                g.C[3 * i + d][l] = scale * (sums[d + 1][i][l] - place.f[d][l] * sums[0][i][l]);
    }
    for (int j = 0; j < 3; ++j)
        for (int l = 0; l < LANES; ++l) {
            const float a = g.F[j][l], b = g.F[3 + j][l], c = g.F[6 + j][l];
            for (int i = 0; i < 3; ++i)
                g.F[3 * i + j][l] += dt * (g.C[3 * i][l] * a + g.C[3 * i + 1][l] * b + g.C[3 * i + 2][l] * c);
        }
}

std::vector<int> by_cell(const Settings& s, const float* x) {
    std::vector<int> order(s.particles);
    std::vector<int64_t> cell(s.particles);
    for (int p = 0; p < s.particles; ++p) {
        int64_t key = 0;
        for (int d = 0; d < 3; ++d) key = key * s.grid_nodes + static_cast<int>(x[3 * p + d] / s.cell - 0.5f);
        cell[p] = key;
    }
    std::iota(order.begin(), order.end(), 0);
    std::sort(order.begin(), order.end(), [&](int a, int b) { return cell[a] < cell[b]; });
    return order;
}

// The nodes that particles at these velocities can reach, with two cells to spare.
Box reachable(const Settings& s, const float* x, const float* v) {
    Box box;
    for (int d = 0; d < 3; ++d) {
        float low = 1e30f, high = -1e30f, speed = 0.0f;
        for (int p = 0; p < s.particles; ++p) {
            low = std::min(low, x[3 * p + d]);
            high = std::max(high, x[3 * p + d]);
            speed = std::max(speed, std::abs(v[3 * p + d]));
        }
        const float travel = speed * s.time_step * s.substeps + 2 * s.cell;
        box.first[d] = std::max(0, static_cast<int>((low - travel) / s.cell - 0.5f));
        const int last = std::min(s.grid_nodes - 1, static_cast<int>((high + travel) / s.cell - 0.5f) + 2);
        box.count[d] = last - box.first[d] + 1;
    }
    return box;
}

std::vector<Group> make_groups(const Settings& s, const std::vector<int>& order, const float* x, const float* v) {
    std::vector<Group> groups((s.particles + LANES - 1) / LANES);
    for (int i = 0; i < LANES * static_cast<int>(groups.size()); ++i) {
        Group& g = groups[i / LANES];
        const int l = i % LANES, p = order[std::min(i, s.particles - 1)];  // idle lanes repeat the last particle
        for (int d = 0; d < 3; ++d) {
            g.x[d][l] = x[3 * p + d];
            g.v[d][l] = v[3 * p + d];
        }
        for (int e = 0; e < 9; ++e) {
            g.F[e][l] = e % 4 == 0 ? 1.0f : 0.0f;
            g.C[e][l] = 0.0f;
        }
        g.count += i < s.particles;
    }
    return groups;
}

}  // namespace

// Positions x0 and velocities v0 [particles, 3] to positions x after all substeps.
extern "C" void simulate(const Settings* settings, const float* x0, const float* v0, float* x) {
    const Settings& s = *settings;
    const std::vector<int> order = by_cell(s, x0);
    const Box box = reachable(s, x0, v0);
    std::vector<Group> groups = make_groups(s, order, x0, v0);
    std::vector<std::vector<Node>> grids(s.threads, std::vector<Node>(box.nodes()));
#pragma omp parallel num_threads(s.threads)
    {
        const int t = omp_get_thread_num(), groups_all = static_cast<int>(groups.size());
        const auto share = [&](int total, int part) { return static_cast<int>(int64_t(total) * part / s.threads); };
        const int begin = share(groups_all, t), end = share(groups_all, t + 1);
        for (int step = 0; step < s.substeps; ++step) {
            std::memset(grids[t].data(), 0, sizeof(Node) * grids[t].size());
            for (int g = begin; g < end; ++g) scatter(s, box, groups[g], grids[t].data());
#pragma omp barrier
            update(s, box, grids, share(box.nodes(), t), share(box.nodes(), t + 1));
#pragma omp barrier
            for (int g = begin; g < end; ++g) gather(s, box, grids[0].data(), groups[g]);
#pragma omp barrier
        }
    }
    for (int i = 0; i < s.particles; ++i)
        for (int d = 0; d < 3; ++d) x[3 * order[i] + d] = groups[i / LANES].x[d][i % LANES];
}
