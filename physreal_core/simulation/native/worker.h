// One thread's share of a frame: a range of the particles in the order of the cells, and a range of the nodes.
//
// Every thread scatters to a grid of its own; the nodes' phase adds them up, in the order of the threads, so that the
// result depends on their number but not on chance.
#pragma once
#include "barrier.h"
#include "grip.h"
#include "material.h"
#include "nodes.h"
#include "rows.h"
#include "term_laws.h"
#include "transfers.h"

namespace physreal {

// With TERMS, inputs beside the material have adjoints, and optional laws act as frame.terms says.
template <class S, bool TERMS, class Material>
class Worker : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    static constexpr int X = 0, VELOCITY = 3, DEFORMATION = 6, AFFINE = 15, RATE = 24;

public:
    // pass: 0 for a frame, 1 for its adjoint after it; each has a barrier of its own.
    Worker(const Frame<S>& frame, int thread, int pass)
        : Rows(frame, thread),
          frame_(frame),
          thread_(thread),
          box_{{frame.offset[0], frame.offset[1], frame.offset[2]},
               1 / frame.cell,
               {int(frame.origin[0]), int(frame.origin[1]), int(frame.origin[2])},
               {int(frame.count[0]), int(frame.count[1]), int(frame.count[2])}},
          first_node_(share_of(box_.nodes(), thread, frame.threads)),
          last_node_(share_of(box_.nodes(), thread + 1, frame.threads)),
          scratch_(frame.scratch + 4 * thread * Index(box_.nodes() + 4)),
          material_(material_arrays<TERMS>(frame, frame.dt, frame.share, frame.network_elastic, frame.network_plastic,
                                           frame.network_elastic_bar + thread * frame.weights_elastic,
                                           frame.network_plastic_bar + thread * frame.weights_plastic,
                                           frame.networks + thread * frame.network_numbers)),
          laws_(frame, thread),
          barrier_(frame.shared + 64 * pass, frame.threads, frame.yield_address) {}

    void forward() {
        if (thread_ == 0) sort_particles();
        barrier_.wait();
        load_model();
        load_state();
        barrier_.wait();
        if (frame_.replay) return replay();
        for (Index s = 0; s < frame_.substeps; s++) {
            scatter_momentum(s);
            barrier_.wait();
            if (stopped()) return;
            update_nodes(s);
            barrier_.wait();
            gather_velocity(s);
        }
        if (frame_.keep_states) return;
        check_state();
        store_state();
    }

    // Adjoint of a frame that `forward` has just kept the states and grids of.
    void backward() {
        load_adjoint();
        barrier_.wait();
        velocities_of_kept(frame_.substeps - 1);
        barrier_.wait();
        for (Index s = frame_.substeps - 1; s >= 0; s--) {
            scatter_velocity_bar(s);
            barrier_.wait();
            update_nodes_adjoint(s);
            if (s > 0) velocities_of_kept(s - 1);
            barrier_.wait();
            gather_momentum_bar(s);
        }
        material_.finish();
        store_adjoint();
    }

private:
    using Rows::add_rows, Rows::clear, Rows::fetch, Rows::first_, Rows::gather_columns, Rows::gather_rows, Rows::last_,
        Rows::lanes_from, Rows::matrix, Rows::padded_end, Rows::put, Rows::row_of, Rows::scatter_columns, Rows::vector;

    const Frame<S>& frame_;
    int thread_;
    Box<S> box_;
    Index first_node_, last_node_;
    S* scratch_;
    Material material_;
    TermLaws<S> laws_;
    Barrier barrier_;

    bool viscous() const { return TERMS && laws_.has(term::viscosity); }
    // Rows of the state: with viscosity the mean rate of deformation, 9 of them, stands behind x, v, F and C; 9 of each
    // Maxwell branch follow.
    int first_branch() const { return viscous() ? RATE + 9 : RATE; }
    int branch_rows() const { return TERMS ? 9 * branches_of(frame_.terms) : 0; }
    int state_rows() const { return first_branch() + branch_rows(); }
    S* rate(S* state) const { return state + RATE * frame_.stride; }
    const S* rate(const S* state) const { return state + RATE * frame_.stride; }
    S* branches(S* state) const { return state + first_branch() * frame_.stride; }
    const S* branches(const S* state) const { return state + first_branch() * frame_.stride; }
    const S* constants(int r) const { return frame_.constants + r * frame_.stride; }
    S* input_bars(int r) const { return frame_.bars + (bar::COUNT + r) * frame_.stride; }
    S* particle_sums() const { return frame_.particle_sums + particle_sum::COUNT * thread_; }
    S* node_sums() const { return frame_.node_sums + node_sum::COUNT * thread_; }

    S* state(Index slot) const { return frame_.state + slot * state_rows() * frame_.stride; }

    typename TermLaws<S>::Arrays law_arrays(const S* now) const {
        S* bar = frame_.adjoint;
        return {now + X * frame_.stride,
                now + VELOCITY * frame_.stride,
                rate(now),
                branches(now),
                constants(constant::mass),
                constants(constant::COUNT),
                bar + X * frame_.stride,
                bar + VELOCITY * frame_.stride,
                rate(bar),
                branches(bar),
                input_bars(input::mass),
                input_bars(input::COUNT),
                particle_sums() + particle_sum::numbers};
    }

    NodePhase<S> node_phase() const {
        const Frame<S>& f = frame_;
        return {f.dt,         {f.gravity[0], f.gravity[1], f.gravity[2]},
                f.mass_floor, f.touching,
                f.friction,   laws_.has(term::friction_law) ? f.friction_law : nullptr};
    }

    Grip<S> grip(Index substep) const {
        const Frame<S>& f = frame_;
        return {f.grip_controller, f.grip_weight,  f.grip_rest_length, f.controllers,        f.controller_points,
                f.grip_stiffness,  f.grip_damping, f.grip_softening,   S(substep) * f.share, f.frame_rate};
    }

    // --- in and out
    // -----------------------------------------------------------------------------------------------------

    // Particles in the order of their cells, those of a cell as the caller counts; one outside the box, which will be
    // found to be, counts to the first cell.
    void sort_particles() {
        const Frame<S>& f = frame_;
        const int nodes = box_.nodes();
        int *starts = f.cell_starts, *cells = f.place;
        for (int n = 0; n <= nodes; n++) starts[n] = 0;
        for (Index p = 0; p < f.particles; p++) starts[(cells[p] = cell_of(f.x + 3 * p)) + 1]++;
        for (int n = 0; n < nodes; n++) starts[n + 1] += starts[n];
        for (Index p = 0; p < f.particles; p++) f.order[starts[cells[p]]++] = int(p);
    }

    int cell_of(const S* x) const {
        int at[3];
        for (int d = 0; d < 3; d++) {
            const S r = (x[d] - box_.offset[d]) * box_.cells_per_metre - S(box_.origin[d]) - S(0.5);
            if (!(r >= 0 && r < S(box_.count[d]))) return 0;
            at[d] = int(r);
        }
        return (at[0] * box_.count[1] + at[1]) * box_.count[2] + at[2];
    }

    // The last particle fills the block that is not full; nothing of those lanes is scattered or stored.
    void load_state() {
        const Frame<S>& f = frame_;
        S* s = state(0);
        gather_columns(s + X * f.stride, f.x, 3);
        gather_columns(s + VELOCITY * f.stride, f.v, 3);
        gather_columns(s + DEFORMATION * f.stride, f.F, 9);
        gather_columns(s + AFFINE * f.stride, f.C, 9);
        if (viscous()) gather_columns(rate(s), f.rate, 9);
        if (branch_rows()) gather_columns(branches(s), f.branches, branch_rows());
    }

    void load_model() {
        const Frame<S>& f = frame_;
        mark_nodes();
        for (Index p = first_; p < last_; p++) f.place[f.order[p]] = int(p);
        gather_rows(f.constants, f.given, f.constant_rows);
        gather_rows(f.force, f.given + constant::load * f.particles, 3);
    }

    void store_state() const {
        const Frame<S>& f = frame_;
        const S* s = state(0);
        scatter_columns(f.x_end, s + X * f.stride, 3);
        scatter_columns(f.v_end, s + VELOCITY * f.stride, 3);
        scatter_columns(f.F_end, s + DEFORMATION * f.stride, 9);
        scatter_columns(f.C_end, s + AFFINE * f.stride, 9);
        if (viscous()) scatter_columns(f.rate_end, rate(s), 9);
        if (branch_rows()) scatter_columns(f.branches_end, branches(s), branch_rows());
    }

    void load_adjoint() {
        const Frame<S>& f = frame_;
        S* a = f.adjoint;
        gather_columns(a + X * f.stride, f.x_bar, 3);
        gather_columns(a + VELOCITY * f.stride, f.v_bar, 3);
        gather_columns(a + DEFORMATION * f.stride, f.F_bar, 9);
        gather_columns(a + AFFINE * f.stride, f.C_bar, 9);
        if (viscous()) gather_columns(rate(a), f.rate_bar, 9);
        if (branch_rows()) gather_columns(branches(a), f.branches_bar, branch_rows());
        for (int r = 0; r < state_rows(); r++)
            for (Index p = last_; p < padded_end(); p++) a[r * f.stride + p] = 0;
        clear(f.bars, f.bar_rows);
    }

    void store_adjoint() const {
        const Frame<S>& f = frame_;
        const S* a = f.adjoint;
        scatter_columns(f.x_bar, a + X * f.stride, 3);
        scatter_columns(f.v_bar, a + VELOCITY * f.stride, 3);
        scatter_columns(f.F_bar, a + DEFORMATION * f.stride, 9);
        scatter_columns(f.C_bar, a + AFFINE * f.stride, 9);
        if (viscous()) scatter_columns(f.rate_bar, rate(a), 9);
        if (branch_rows()) scatter_columns(f.branches_bar, branches(a), branch_rows());
        add_rows(f.given_bars, f.bars, f.bar_rows);
    }

    void mark_nodes() {
        const Frame<S>& f = frame_;
        const Scene<S> scene = {
            {f.offset[0], f.offset[1], f.offset[2]}, f.cell, f.clamps, f.has_ground, f.clamp_lower, f.clamp_upper};
        for (Index n = first_node_; n < last_node_; n++) {
            const Index k = n % f.count[2], j = n / f.count[2] % f.count[1], i = n / (f.count[1] * f.count[2]);
            f.kind[n] = scene.kind_of(i + f.origin[0], j + f.origin[1], k + f.origin[2], f.origin[2]);
        }
    }

    // --- forward
    // ------------------------------------------------------------------------------------------------------

    void clear_scratch() { __builtin_memset(scratch_, 0, 4 * (box_.nodes() + 4) * sizeof(S)); }

    // APIC's m (v + C n) w, and - dt V tau grad w.
    FieldBlock<S> momentum_field(Index p, const Vec3<V>& momentum, const Mat3<V>& C, const Mat3<V>& tau,
                                 const Stencil<S>& stencil) const {
        V m = row_of(constants(constant::mass), 0, p), volume = row_of(constants(constant::volume), 0, p);
        return {momentum, m, (m * (frame_.cell / 4)) * C, (volume * (-frame_.dt / frame_.cell)) * tau, stencil};
    }
    Vec3<V> pushed_momentum(Index p, const S* s) const {
        V m = row_of(constants(constant::mass), 0, p);
        Vec3<V> q;
        for (int d = 0; d < 3; d++) q.v[d] = m * row_of(s, VELOCITY + d, p) + frame_.dt * row_of(frame_.force, d, p);
        return q;
    }

    // Forces on the thread's particles in a substep, into frame.force.
    void apply_forces(Index s, const S* now) {
        const S* before_grip = constants(constant::load);
        if (TERMS && laws_.has(ForceTerms::TERMS)) {
            laws_.forces(law_arrays(now), before_grip);
            before_grip = frame_.force;
        }
        const Grip<S> bonds = grip(s);
        for_gripped([&](Index place, Index first, Index end) {
            put_at(frame_.force, place,
                   bonds.force(first, end, at(now, X, place), at(now, VELOCITY, place), at(before_grip, 0, place)));
        });
    }

    // Calls visit(particle's place, first bond, last bond) for the thread's gripped particles.
    template <class Visit>
    void for_gripped(Visit visit) const {
        for (Index q = 0; q < frame_.gripped; q++) {
            const Index place = frame_.place[frame_.grip_particle[q]];
            if (place >= first_ && place < last_) visit(place, frame_.grip_first[q], frame_.grip_first[q + 1]);
        }
    }
    // Three rows of one particle.
    Vec3<S> at(const S* rows, int r, Index place) const {
        const S* from = rows + r * frame_.stride + place;
        return {{from[0], from[frame_.stride], from[2 * frame_.stride]}};
    }
    void put_at(S* rows, Index place, const Vec3<S>& value) const {
        for (int d = 0; d < 3; d++) rows[d * frame_.stride + place] = value[d];
    }

    // The stress of a block with that of the optional laws.
    template <class Stress>
    Mat3<V> all_stress(Index p, const Stress& stress, const Mat3<V>& F, const S* now) const {
        if constexpr (TERMS)
            return laws_.stress(law_arrays(now), p, F, stress.tau);
        else
            return stress.tau;
    }

    void scatter_momentum(Index s) {
        const S* now = state(frame_.keep_states ? s : 0);
        apply_forces(s, now);
        clear_scratch();
        Scatter<S> scatter(scratch_, box_);
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> x = vector(now, X, p), momentum = pushed_momentum(p, now);
            Mat3<V> F = matrix(now, DEFORMATION, p);
            auto stress = material_.stress(p, F);
            Stencil<S> stencil(x.v, box_);
            const auto field =
                momentum_field(p, momentum, matrix(now, AFFINE, p), all_stress(p, stress, F, now), stencil);
            if (fails(s, p, stencil, x, momentum, field.A)) return;
            scatter.add(field, stencil, lanes_from(p));
        }
        scatter.flush();
    }

    void update_nodes(Index s) {
        const NodePhase<S> phase = node_phase();
        const auto sum_at = [&](Index n) { return summed(n); };
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = summed(n);
            if (frame_.keep_grids) write(frame_.momentum + 4 * (s * box_.nodes() + n), p);
            write(frame_.velocity + 4 * n, phase.velocity(p, kind_now(phase, n, p, sum_at)));
        }
    }

    // Sum of the threads' grids at a node.
    Node<S> summed(Index n) const {
        Node<S> p = read<Node<S>>(frame_.scratch + 4 * n);
        for (Index t = 1; t < frame_.threads; t++)
            p += read<Node<S>>(frame_.scratch + 4 * (t * (box_.nodes() + 4) + n));
        return p;
    }

    // at(n): (momentum, mass) of node n.
    template <class At>
    unsigned char kind_now(const NodePhase<S>& phase, Index n, const Node<S>& p, const At& at) const {
        return phase.kind_now(frame_.kind[n], p[3], [&] { return at(n - 1)[3]; });
    }

    template <bool ADJOINT>
    MomentBlock<ADJOINT, S> gathered(const S* grid, const Stencil<S>& stencil, Index p) const {
        MomentBlock<ADJOINT, S> moments;
        for (int l = 0; l < lanes_from(p); l++)
            moments.set(
                l, gather<ADJOINT>(grid + 4 * Index(stencil.base[l]), box_, stencil.weights(l), stencil.slopes(l)));
        return moments;
    }

    void gather_velocity(Index s) {
        const S* now = state(frame_.keep_states ? s : 0);
        S* next = state(frame_.keep_states ? s + 1 : 0);
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> x = vector(now, X, p);
            Stencil<S> stencil(x.v, box_);
            const auto moments = gathered<false>(frame_.velocity, stencil, p);
            Vec3<V> v = moments.value();
            Mat3<V> C = (1 / frame_.cell) * moments.offset_moments(stencil), F = matrix(now, DEFORMATION, p);
            const Mat3<V> gradient = moments.gradient();
            F = F + (frame_.dt / frame_.cell) * (gradient * F);
            if constexpr (Material::flows) F = material_.flow(p, F);
            for (int d = 0; d < 3; d++) put(next, X + d, p, x.v[d] + frame_.dt * v.v[d]);
            put(next, VELOCITY, p, v);
            put(next, DEFORMATION, p, F);
            put(next, AFFINE, p, C);
            if constexpr (TERMS) {
                laws_.average_rate(p, rate(now), C, rate(next));
                laws_.advance_branches(p, branches(now), (frame_.dt / frame_.cell) * gradient, branches(next));
            }
        }
    }

    // The states of a frame of which the grids are there: stresses and scatters are not needed again.
    void replay() {
        for (Index s = 0; s < frame_.substeps; s++) {
            velocities_of_kept(s);
            barrier_.wait();
            gather_velocity(s);
            barrier_.wait();
        }
    }

    // --- failures
    // -----------------------------------------------------------------------------------------------------

    bool stopped() const { return __atomic_load_n(frame_.shared + 32, __ATOMIC_RELAXED) != 0; }

    void report(int kind, Index substep, Index p) {
        Index& first = frame_.status[2 * thread_ + kind];
        Index key = substep * frame_.particles + frame_.order[p];
        if (key < first) first = key;
        __atomic_store_n(frame_.shared + 32, 1, __ATOMIC_RELAXED);
    }

    // Whether a particle of the block must not be scattered; the frame then stops at this substep.
    bool fails(Index s, Index p, const Stencil<S>& at, const Vec3<V>& x, const Vec3<V>& momentum, const Mat3<V>& A) {
        V magnitude = dot(A, A);
        for (int d = 0; d < 3; d++) magnitude += momentum.v[d] * momentum.v[d] + x.v[d] * x.v[d];
        auto finite = (magnitude - magnitude) == V{};
        if (!any(~(finite & at.inside))) return false;
        bool failed = false;
        for (int l = 0; l < lanes_from(p); l++)
            if (!(finite[l] && at.inside[l])) {
                report(finite[l] ? 0 : 1, s, p + l);
                failed = true;
            }
        return failed;
    }

    // Failures at the frame's end, and the motion's bounds there.
    void check_state() {
        const S* end = state(0);
        const S frame_time = 1 / frame_.frame_rate;
        V lower[3], upper[3], square = {};
        for (int d = 0; d < 3; d++) lower[d] = upper[d] = row_of(end, X + d, first_);
        for (Index p = first_; p < last_; p += LANES) {
            const Vec3<V> x = vector(end, X, p), v = vector(end, VELOCITY, p);
            fails(frame_.substeps, p, Stencil<S>(x.v, box_), x, v, matrix(end, DEFORMATION, p));
            for (int d = 0; d < 3; d++) {
                const V ahead = x[d] + frame_time * v[d];
                lower[d] = min(lower[d], min(x[d], ahead));
                upper[d] = max(upper[d], max(x[d], ahead));
            }
            square = max(square, dot(v, v));
        }
        S* bounds = frame_.bounds + 7 * thread_;
        for (int d = 0; d < 3; d++) {
            bounds[d] = -largest(-lower[d]);
            bounds[3 + d] = largest(upper[d]);
        }
        bounds[6] = sqrt(largest(square));
    }
    static S largest(V values) {
        S found = values[0];
        for (int l = 1; l < LANES; l++) found = max(found, values[l]);
        return found;
    }

    // --- adjoint
    // ------------------------------------------------------------------------------------------------------

    auto kept_of(Index s) const {
        return [grid = frame_.momentum + 4 * s * box_.nodes()](Index n) { return read<Node<S>>(grid + 4 * n); };
    }

    void velocities_of_kept(Index s) {
        const NodePhase<S> phase = node_phase();
        const auto kept_at = kept_of(s);
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = kept_at(n);
            write(frame_.velocity + 4 * n, phase.velocity(p, kind_now(phase, n, p, kept_at)));
        }
    }

    void scatter_velocity_bar(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        clear_scratch();
        Scatter<S> scatter(scratch_, box_);
        for (Index p = first_; p < last_; p += LANES) {
            fetch(now, X, 3, p);
            fetch(now, DEFORMATION, 9, p);
            fetch(bar, X, RATE, p);
            Vec3<V> x = vector(now, X, p);
            Mat3<V> F = matrix(now, DEFORMATION, p), F_bar = matrix(bar, DEFORMATION, p),
                    C_bar = matrix(bar, AFFINE, p);
            if constexpr (TERMS) C_bar = laws_.average_rate_adjoint(p, C_bar, rate(bar));
            Stencil<S> stencil(x.v, box_);
            const auto moments = gathered<true>(frame_.velocity, stencil, p);
            Mat3<V> step = (frame_.dt / frame_.cell) * moments.gradient();
            if constexpr (Material::flows) F_bar = material_.flow_adjoint(p, F + step * F, F_bar);
            Vec3<V> q;
            for (int d = 0; d < 3; d++) q.v[d] = row_of(bar, VELOCITY + d, p) + frame_.dt * row_of(bar, X + d, p);
            Mat3<V> step_bar = F_bar * transpose(F);
            if constexpr (TERMS)
                laws_.advance_branches_adjoint(p, branches(now), step, branches(bar),
                                               particle_sums() + particle_sum::numbers, step_bar);
            const FieldBlock<S> field(q, V{}, (1 / frame_.cell) * C_bar, (frame_.dt / frame_.cell) * step_bar, stencil);
            scatter.add(field, stencil, lanes_from(p));
            add_position_bar(p, moments.slope(field, stencil));
            put(bar, DEFORMATION, p, F_bar + transpose(step) * F_bar);
        }
        scatter.flush();
    }

    // slope: per cell.
    void add_position_bar(Index p, const Vec3<V>& slope) {
        for (int d = 0; d < 3; d++)
            put(frame_.adjoint, X + d, p, row_of(frame_.adjoint, X + d, p) + slope[d] * (1 / frame_.cell));
    }

    void update_nodes_adjoint(Index s) {
        const NodePhase<S> phase = node_phase();
        const auto kept_at = kept_of(s);
        FrictionBar<S> friction_bar = {};
        Node<S> gravity_bar = {};
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = kept_at(n);
            Node<S> p_bar = phase.adjoint(p, kind_now(phase, n, p, kept_at), summed(n), friction_bar);
            write(frame_.node_bar + 4 * n, p_bar);
            // gravity acts on the velocity as momentum / mass does, dt times
            if constexpr (TERMS) gravity_bar += (frame_.dt * p[3]) * p_bar;
        }
        S* sums = node_sums();
        sums[node_sum::friction_coefficient] += friction_bar.dynamic;
        for (int d = 0; TERMS && d < 3; d++) {
            sums[node_sum::gravity + d] += gravity_bar[d];
            sums[node_sum::friction_law + d] += friction_bar.law[d];
        }
    }

    void gather_momentum_bar(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        apply_forces(s, now);
        for (Index p = first_; p < last_; p += LANES) {
            fetch(now, X, RATE, p);
            Vec3<V> x = vector(now, X, p), momentum = pushed_momentum(p, now);
            Mat3<V> F = matrix(now, DEFORMATION, p);
            auto stress = material_.stress(p, F);
            Mat3<V> C = matrix(now, AFFINE, p);
            Stencil<S> stencil(x.v, box_);
            V m = row_of(constants(constant::mass), 0, p), volume = row_of(constants(constant::volume), 0, p);
            const auto moments = gathered<true>(frame_.node_bar, stencil, p);
            Vec3<V> q_bar = moments.value();
            Mat3<V> apic_bar = moments.offset_moments(stencil);
            const auto field = momentum_field(p, momentum, C, all_stress(p, stress, F, now), stencil);
            add_position_bar(p, moments.slope(field, stencil));
            for (int d = 0; d < 3; d++) put(bar, VELOCITY + d, p, m * q_bar.v[d]);
            put(bar, AFFINE, p, (m * (frame_.cell / 4)) * apic_bar);
            Mat3<V> F_bar = matrix(bar, DEFORMATION, p);
            Mat3<V> tau_bar = (volume * (-frame_.dt / frame_.cell)) * moments.gradient();
            material_.stress_adjoint(p, stress, F, tau_bar, F_bar);
            if constexpr (TERMS) laws_.stress_adjoint(law_arrays(now), p, F, tau_bar, F_bar);
            put(bar, DEFORMATION, p, F_bar);
            if constexpr (TERMS)
                inputs_adjoint(p, vector(now, VELOCITY, p), C, q_bar, moments.fourth_value(), apic_bar);
        }
        grip_adjoint(s, now);
        if (TERMS && laws_.has(ForceTerms::TERMS)) laws_.forces_adjoint(law_arrays(now));
    }

    // Without optional terms v_bar = m q_bar on entry, of which the force's adjoint is dt q_bar; with them that stands
    // in frame.force_bar.
    void grip_adjoint(Index s, const S* now) {
        const Grip<S> bonds = grip(s);
        S* bar = frame_.adjoint;
        S* points_bar = frame_.controllers_bar + 6 * thread_ * frame_.controller_points;
        const auto add_point = [&](int end, int controller, int axis, S value) {
            points_bar[3 * (end * frame_.controller_points + controller) + axis] += value;
        };
        for_gripped([&](Index place, Index first, Index last) {
            const Vec3<S> v_bar = at(bar, VELOCITY, place);
            const Vec3<S> f_bar =
                TERMS ? at(frame_.force_bar, 0, place) : (frame_.dt / constants(constant::mass)[place]) * v_bar;
            const auto back = bonds.adjoint(first, last, at(now, X, place), at(now, VELOCITY, place), f_bar, add_point);
            put_at(bar + X * frame_.stride, place, at(bar, X, place) + back.x);
            put_at(bar + VELOCITY * frame_.stride, place, v_bar + back.v);
            particle_sums()[particle_sum::grip_stiffness] += back.stiffness;
            particle_sums()[particle_sum::grip_damping] += back.damping;
        });
    }

    // Adjoints of mass and force in m v + dt f, m and the affine momentum, from those of the three.
    void inputs_adjoint(Index p, const Vec3<V>& v, const Mat3<V>& C, const Vec3<V>& q_bar, V carried_bar,
                        const Mat3<V>& apic_bar) {
        S *mass_bar = input_bars(input::mass), *load_bar = input_bars(input::load);
        put(mass_bar, 0, p,
            row_of(mass_bar, 0, p) + carried_bar + dot(v, q_bar) + (frame_.cell / 4) * dot(C, apic_bar));
        for (int d = 0; d < 3; d++) {
            V force_bar = frame_.dt * q_bar[d];
            put(frame_.force_bar, d, p, force_bar);
            put(load_bar, d, p, row_of(load_bar, d, p) + force_bar);
        }
    }
};

template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
using WorkerOf = Worker<S, TERMS, Material<Lanes<S>, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>;

// Calls run(frame, thread within it) for the frames: one is shared by all threads, of many each thread takes one after
// the other.
template <class S, class Run>
inline void for_frames(unsigned long long frames, unsigned long long workspaces, int count, unsigned long long next,
                       int thread, Run run) {
    const auto all = reinterpret_cast<const Frame<S>*>(frames);
    const auto work = reinterpret_cast<const Workspace<S>*>(workspaces);
    const auto frame_on = [&](int i, int workspace) {
        Frame<S> frame = all[i];
        static_cast<Workspace<S>&>(frame) = work[workspace];
        if (frame.kept_grids) frame.momentum = frame.kept_grids;
        return frame;
    };
    if (count == 1) return run(frame_on(0, 0), thread);
    for (;;) {
        const int i = __atomic_fetch_add(reinterpret_cast<int*>(next), 1, __ATOMIC_RELAXED);
        if (i >= count) return;
        const Frame<S> frame = frame_on(i, thread);
        __builtin_memset(frame.shared, 0, 128 * sizeof(int));
        run(frame, 0);
    }
}

template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void forward_frames(unsigned long long frames, unsigned long long workspaces, int count, unsigned long long next,
                           int thread) {
    for_frames<S>(frames, workspaces, count, next, thread, [](const Frame<S>& frame, int own) {
        WorkerOf<S, TERMS, Elastic, Plastic, ElasticNetwork, PlasticNetwork>(frame, own, 0).forward();
    });
}

template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void backward_frames(unsigned long long frames, unsigned long long workspaces, int count,
                            unsigned long long next, int thread) {
    using Work = WorkerOf<S, TERMS, Elastic, Plastic, ElasticNetwork, PlasticNetwork>;
    for_frames<S>(frames, workspaces, count, next, thread, [](const Frame<S>& frame, int own) {
        Work(frame, own, 0).forward();
        Work(frame, own, 1).backward();
    });
}

// Numbers that a thread needs for the networks' adjoints.
template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void network_numbers(Index* size) {
    size[0] = Material<Lanes<S>, Elastic, Plastic, ElasticNetwork, PlasticNetwork>::workspace_size;
}

}  // namespace physreal
