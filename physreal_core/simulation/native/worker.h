// One thread's share of a frame: a range of the particles in the order of the cells, and a range of the nodes.
//
// Every thread scatters to a grid of its own; the nodes' phase adds them up, in the order of the threads, so that the
// result depends on their number but not on chance. Places on the grid are those of the body at rest, all the time.
#pragma once
#include "barrier.h"
#include "contacts.h"
#include "frames.h"
#include "hand.h"
#include "material.h"
#include "nodes.h"
#include "rows.h"
#include "shape.h"
#include "term_laws.h"
#include "transfers.h"

namespace physreal {

// With TERMS, inputs beside the material have adjoints, and optional laws act as frame.terms says. With SHAPED, the body's
// own shape may differ from that in which it lies on the grid: by how it starts, or because it flows. With TOUCHES, the body's surface touches
// itself.
template <class S, bool TERMS, bool SHAPED, bool TOUCHES, class Material>
class Worker : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    static constexpr int X = 0, VELOCITY = 3, DEFORMATION = 6, SHAPE = 15, RATE = SHAPED ? 24 : 15;

public:
    // pass: 0 for a frame, 1 for its adjoint after it; each has a barrier of its own.
    Worker(const Frame<S>& frame, int thread, int pass)
        : Rows(frame, thread),
          frame_(frame),
          thread_(thread),
          box_{{frame.offset[0], frame.offset[1], frame.offset[2]},
               1 / frame.cell,
               {int(frame.count[0]), int(frame.count[1]), int(frame.count[2])}},
          first_node_(share_of(box_.nodes(), thread, frame.threads)),
          last_node_(share_of(box_.nodes(), thread + 1, frame.threads)),
          scratch_(frame.scratch + 4 * thread * Index(box_.nodes() + 4)),
          material_(material_arrays<TERMS>(frame, frame.dt, frame.share, frame.network_elastic, frame.network_plastic,
                                           frame.network_elastic_bar + thread * frame.weights_elastic,
                                           frame.network_plastic_bar + thread * frame.weights_plastic,
                                           frame.networks + thread * frame.network_numbers)),
          laws_(frame, thread),
          hand_(frame, thread),
          barrier_(frame.shared + 64 * pass, frame.threads, frame.yield_address),
          contacts_(frame, thread, barrier_) {}

    void forward() {
        load_model();
        load_state();
        weigh_nodes();
        if (frame_.replay) return replay();
        for (Index s = 0; s < frame_.substeps; s++) {
            if constexpr (TOUCHES) touch(s);
            scatter_forces(s);
            barrier_.wait();
            if (stopped()) return;
            update_nodes(s);
            barrier_.wait();
            gather_velocity(s);
            if constexpr (TOUCHES) contacts_.measure(state_at(s + 1), state_at(s + 1), s + 1);
        }
        if (frame_.keep_states) return;
        check_state();
        store_state();
    }

    // Adjoint of a frame that `forward` has just kept the states and grids of.
    void backward() {
        load_adjoint();
        barrier_.wait();
        for (Index s = frame_.substeps - 1; s >= 0; s--) {
            scatter_velocity_bar(s);
            barrier_.wait();
            update_nodes_adjoint(s);
            barrier_.wait();
            gather_force_bar(s);
            if constexpr (TOUCHES) touch_adjoint(s);
        }
        weigh_nodes_adjoint();
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
    Hand<S> hand_;
    Barrier barrier_;
    Contacts<S, 3, true> contacts_;

    bool viscous() const { return TERMS && laws_.has(term::viscosity); }
    // Rows of the state behind x, v and F: the shape where it has one, with viscosity the mean rate of deformation, and
    // every Maxwell branch; 9 of each.
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
    // After s substeps.
    S* state_at(Index s) const { return state(frame_.keep_states ? s : 0); }

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
        return {f.dt,       {f.gravity[0], f.gravity[1], f.gravity[2]},
                f.mass_floor, f.touching,
                f.friction, laws_.has(term::friction_law) ? f.friction_law : nullptr};
    }

    // --- in and out
    // -----------------------------------------------------------------------------------------------------

    // The last particle fills the block that is not full; nothing of those lanes is scattered or stored.
    void load_state() {
        const Frame<S>& f = frame_;
        S* s = state(0);
        gather_columns(s + X * f.stride, f.x, 3);
        gather_columns(s + VELOCITY * f.stride, f.v, 3);
        gather_columns(s + DEFORMATION * f.stride, f.F, 9);
        if (SHAPED) gather_columns(s + SHAPE * f.stride, f.shape, 9);
        if (viscous()) gather_columns(rate(s), f.rate, 9);
        if (branch_rows()) gather_columns(branches(s), f.branches, branch_rows());
    }

    void load_model() {
        const Frame<S>& f = frame_;
        gather_rows(f.constants, f.given, f.constant_rows);
        gather_rows(f.force, f.given + constant::load * f.particles, 3);
    }

    void store_state() const {
        const Frame<S>& f = frame_;
        const S* s = state(0);
        scatter_columns(f.x_end, s + X * f.stride, 3);
        scatter_columns(f.v_end, s + VELOCITY * f.stride, 3);
        scatter_columns(f.F_end, s + DEFORMATION * f.stride, 9);
        if (SHAPED) scatter_columns(f.shape_end, s + SHAPE * f.stride, 9);
        if (viscous()) scatter_columns(f.rate_end, rate(s), 9);
        if (branch_rows()) scatter_columns(f.branches_end, branches(s), branch_rows());
        for (Index n = first_node_; n < last_node_; n++) write(f.nodes_end + 4 * n, read<Node<S>>(f.velocity + 4 * n));
    }

    void load_adjoint() {
        const Frame<S>& f = frame_;
        S* a = f.adjoint;
        gather_columns(a + X * f.stride, f.x_bar, 3);
        gather_columns(a + VELOCITY * f.stride, f.v_bar, 3);
        gather_columns(a + DEFORMATION * f.stride, f.F_bar, 9);
        if (SHAPED) gather_columns(a + SHAPE * f.stride, f.shape_bar, 9);
        if (viscous()) gather_columns(rate(a), f.rate_bar, 9);
        if (branch_rows()) gather_columns(branches(a), f.branches_bar, branch_rows());
        for (int r = 0; r < state_rows(); r++)
            for (Index p = last_; p < padded_end(); p++) a[r * f.stride + p] = 0;
        clear(f.bars, f.bar_rows);
        for (Index n = first_node_; n < last_node_; n++) {
            const Node<S> bar = read<Node<S>>(f.nodes_bar + 4 * n);
            write(f.carry + 4 * n, Node<S>{bar[0], bar[1], bar[2], 0});
        }
    }

    void store_adjoint() const {
        const Frame<S>& f = frame_;
        const S* a = f.adjoint;
        scatter_columns(f.x_bar, a + X * f.stride, 3);
        scatter_columns(f.v_bar, a + VELOCITY * f.stride, 3);
        scatter_columns(f.F_bar, a + DEFORMATION * f.stride, 9);
        if (SHAPED) scatter_columns(f.shape_bar, a + SHAPE * f.stride, 9);
        if (viscous()) scatter_columns(f.rate_bar, rate(a), 9);
        if (branch_rows()) scatter_columns(f.branches_bar, branches(a), branch_rows());
        add_rows(f.given_bars, f.bars, f.bar_rows);
    }

    // --- nodes between frames
    // -----------------------------------------------------------------------------------------------------

    // What is around every node, and its velocity at the frame's start.
    void weigh_nodes() {
        clear_scratch();
        scatter_blocks([&](Index p) {
            const V volume = row_of(constants(constant::volume), 0, p);
            return FieldBlock<S>({{row_of(constants(constant::mass), 0, p), volume, V{}}}, V{}, {});
        });
        barrier_.wait();
        const Frame<S>& f = frame_;
        const Scene<S> scene = {
            {f.offset[0], f.offset[1], f.offset[2]}, f.cell, f.clamps, f.clamp_lower, f.clamp_upper};
        for (Index n = first_node_; n < last_node_; n++) {
            const Node<S> sum = summed(n);
            bool held = false;
            for_copies(n, [&](Index c) { held |= scene.holds(c, f.count); });
            f.around[2 * n] = held ? S(0) : sum[0];
            f.around[2 * n + 1] = sum[1];
            write(f.velocity + 4 * n, read<Node<S>>(f.nodes + 4 * n));
        }
        barrier_.wait();
    }

    // frame.carry: adjoints of the velocities at the frame's start, and of the masses.
    void weigh_nodes_adjoint() {
        barrier_.wait();
        const Frame<S>& f = frame_;
        for (Index n = first_node_; n < last_node_; n++) write(f.nodes_bar + 4 * n, read<Node<S>>(f.carry + 4 * n));
        if constexpr (TERMS) {
            barrier_.wait();
            S* bar = input_bars(input::mass);
            for (Index p = first_; p < last_; p += LANES)
                put(bar, 0, p, row_of(bar, 0, p) + gathered(f.carry, stencil_of(p), p).fourth_value());
        }
    }

    // --- forward
    // ------------------------------------------------------------------------------------------------------

    void clear_scratch() { __builtin_memset(scratch_, 0, 4 * (box_.nodes() + 4) * sizeof(S)); }

    Stencil<S> stencil_of(Index p) const { return {vector(constants(constant::place), 0, p).v, box_}; }

    // Scatters field_of(first of a block) for the thread's particles.
    template <class FieldOf>
    void scatter_blocks(const FieldOf& field_of) {
        Scatter<S> scatter(scratch_, box_);
        for (Index p = first_; p < last_; p += LANES) scatter.add(field_of(p), stencil_of(p), lanes_from(p));
        scatter.flush();
    }

    // dt f w, and - dt V P grad w with P the stress per area of the body as it lies on the grid.
    FieldBlock<S> force_field(Index p, const S* now, const Mat3<V>& P) const {
        const V volume = row_of(constants(constant::volume), 0, p);
        Vec3<V> q;
        for (int d = 0; d < 3; d++) {
            q.v[d] = frame_.dt * row_of(frame_.force, d, p);
            if constexpr (TOUCHES) q.v[d] += frame_.dt * row_of(frame_.contact_force, d, p);
        }
        return {q, volume * touching(p, now), (volume * (-frame_.dt / frame_.cell)) * P};
    }

    // How fully a particle touches the ground, from 0 to 1.
    V touching(Index p, const S* now) const {
        const V deep = (row_of(constants(constant::touch_height), 0, p) - row_of(now, X + 2, p)) * frame_.touch_slope;
        return max(min(deep, splat<V>(1)), V{});
    }
    // Its derivative by z.
    V touching_slope(Index p, const S* now) const {
        const V a = touching(p, now);
        return select((a > V{}) & (a < splat<V>(1)), splat<V>(-frame_.touch_slope), V{});
    }

    ShapeOnGrid<SHAPED, V> shape_on_grid(Index p, const S* now, const Mat3<V>& F) const {
        return {F, SHAPED ? matrix(now, SHAPE, p) : F};
    }

    // Forces on the thread's particles in a substep, into frame.force.
    void apply_forces(Index s, const S* now) {
        const S* before_hand = constants(constant::load);
        if (TERMS && laws_.has(ForceTerms::TERMS)) {
            laws_.forces(law_arrays(now), before_hand);
            before_hand = frame_.force;
        }
        hand_.forces(s, now + X * frame_.stride, now + VELOCITY * frame_.stride, before_hand);
    }

    // The stress of a block with that of the optional laws.
    template <class Stress>
    Mat3<V> all_stress(Index p, const Stress& stress, const Mat3<V>& F, const S* now) const {
        if constexpr (TERMS)
            return laws_.stress(law_arrays(now), p, F, stress.tau);
        else
            return stress.tau;
    }

    void scatter_forces(Index s) {
        const S* now = state_at(s);
        apply_forces(s, now);
        clear_scratch();
        scatter_blocks([&](Index p) {
            const Mat3<V> F = matrix(now, DEFORMATION, p);
            const auto stress = material_.stress(p, F);
            const Mat3<V> P = shape_on_grid(p, now, F).stress(all_stress(p, stress, F, now));
            check(s, p, vector(now, X, p), vector(frame_.force, 0, p), P);
            return force_field(p, now, P);
        });
    }

    // Forces of a substep where the surface touches itself, of the thread's particles.
    void touch(Index s) {
        barrier_.wait();
        contacts_.update(state_at(s), s);
        contacts_.leave_forces(state_at(s));
        barrier_.wait();
        contacts_.add_up_forces();
    }

    void update_nodes(Index s) {
        const NodePhase<S> phase = node_phase();
        for (Index n = first_node_; n < last_node_; n++) {
            const Around<S> near = around(n);
            const Node<S> free = phase.free(read<Node<S>>(frame_.velocity + 4 * n), summed(n), near);
            if (frame_.keep_grids) write(kept(s) + 4 * n, free);
            write(frame_.velocity + 4 * n, phase.velocity(free, near));
        }
    }

    Around<S> around(Index n) const { return {frame_.around[2 * n], frame_.around[2 * n + 1]}; }
    // Free velocities of a substep.
    S* kept(Index s) const { return frame_.free + 4 * s * box_.nodes(); }

    // Calls use with a node, or with each of its copies, the first one first.
    template <class Use>
    void for_copies(Index n, Use use) const {
        if (!frame_.tied) return use(n);
        for (int c = frame_.first_copy[n]; c >= 0; c = frame_.next_copy[c]) use(c);
    }
    // Of all copies one counts.
    bool counts(Index n) const { return !frame_.tied || frame_.first_copy[n] == n; }

    // Sum of the threads' grids at a node and its copies.
    Node<S> summed(Index n) const {
        Node<S> p = {};
        for_copies(n, [&](Index c) {
            for (Index t = 0; t < frame_.threads; t++)
                p += read<Node<S>>(frame_.scratch + 4 * (t * (box_.nodes() + 4) + c));
        });
        return p;
    }

    MomentBlock<S> gathered(const S* grid, const Stencil<S>& stencil, Index p) const {
        MomentBlock<S> moments;
        for (int l = 0; l < lanes_from(p); l++)
            moments.set(l, gather(grid + 4 * Index(stencil.base[l]), box_, stencil.weights(l), stencil.slopes(l)));
        return moments;
    }

    void gather_velocity(Index s) {
        const S* now = state_at(s);
        S* next = state_at(s + 1);
        for (Index p = first_; p < last_; p += LANES) {
            const auto moments = gathered(frame_.velocity, stencil_of(p), p);
            const Vec3<V> v = moments.value();
            const Mat3<V> F = matrix(now, DEFORMATION, p);
            const auto on_grid = shape_on_grid(p, now, F);
            const Mat3<V> change = on_grid.change((frame_.dt / frame_.cell) * moments.gradient());
            Mat3<V> after = F + change;
            if constexpr (Material::flows) after = material_.flow(p, after);
            if constexpr (SHAPED) {
                Mat3<V> B = matrix(now, SHAPE, p);
                if constexpr (Material::flows) B = shape_after_flow(B, F + change, after);
                put(next, SHAPE, p, B);
            }
            for (int d = 0; d < 3; d++) put(next, X + d, p, row_of(now, X + d, p) + frame_.dt * v[d]);
            put(next, VELOCITY, p, v);
            if constexpr (TERMS)
                if (viscous() || branch_rows()) {
                    const Mat3<V> step = on_grid.step(change);
                    laws_.average_rate(p, rate(now), (1 / frame_.dt) * step, rate(next));
                    laws_.advance_branches(p, branches(now), step, branches(next));
                }
            put(next, DEFORMATION, p, after);
        }
    }

    // The states of a frame of which the grids are there: stresses and scatters are not needed again.
    void replay() {
        for (Index s = 0; s < frame_.substeps; s++) {
            velocities_after(s);
            barrier_.wait();
            gather_velocity(s);
            barrier_.wait();
        }
    }

    // --- failures
    // -----------------------------------------------------------------------------------------------------

    bool stopped() const { return __atomic_load_n(frame_.shared + 32, __ATOMIC_RELAXED) != 0; }

    void report(Index substep, Index p) {
        Index& first = frame_.status[thread_];
        Index key = substep * frame_.particles + frame_.order[p];
        if (key < first) first = key;
        __atomic_store_n(frame_.shared + 32, 1, __ATOMIC_RELAXED);
    }

    // A particle of the block that is not finite stops the frame at this substep.
    void check(Index s, Index p, const Vec3<V>& x, const Vec3<V>& v, const Mat3<V>& A) {
        const V magnitude = dot(A, A) + dot(v, v) + dot(x, x);
        const auto finite = (magnitude - magnitude) == V{};
        if (!any(~finite)) return;
        for (int l = 0; l < lanes_from(p); l++)
            if (!finite[l]) report(s, p + l);
    }

    // Failures at the frame's end.
    void check_state() {
        const S* end = state(0);
        for (Index p = first_; p < last_; p += LANES)
            check(frame_.substeps, p, vector(end, X, p), vector(end, VELOCITY, p), matrix(end, DEFORMATION, p));
    }

    // --- adjoint
    // ------------------------------------------------------------------------------------------------------

    // Velocities at the start of the substep after s; at the frame's start for -1.
    Node<S> velocity_after(const NodePhase<S>& phase, Index s, Index n) const {
        if (s >= 0) return phase.velocity(read<Node<S>>(kept(s) + 4 * n), around(n));
        return read<Node<S>>(frame_.nodes + 4 * n);
    }

    void velocities_after(Index s) {
        const NodePhase<S> phase = node_phase();
        for (Index n = first_node_; n < last_node_; n++)
            write(frame_.velocity + 4 * n, velocity_after(phase, s, n));
    }

    // In: frame.velocity after the substep, and adjoints of the state there.
    void scatter_velocity_bar(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        clear_scratch();
        scatter_blocks([&](Index p) {
            fetch(now, X, 3, p);
            fetch(now, DEFORMATION, 9, p);
            fetch(bar, X, RATE, p);
            const auto moments = gathered(frame_.velocity, stencil_of(p), p);
            const Mat3<V> F = matrix(now, DEFORMATION, p), dD = (frame_.dt / frame_.cell) * moments.gradient();
            const auto on_grid = shape_on_grid(p, now, F);
            const Mat3<V> change = on_grid.change(dD);
            Mat3<V> after_bar = matrix(bar, DEFORMATION, p), F_bar = {}, shape_bar = {};
            if constexpr (SHAPED) shape_bar = matrix(bar, SHAPE, p);
            Mat3<V> change_bar = after_bar;
            if constexpr (Material::flows) {
                const Mat3<V> trial = F + change;
                change_bar = {};
                shape_after_flow_adjoint(matrix(now, SHAPE, p), trial, material_.flow(p, trial), shape_bar, change_bar,
                                         after_bar);
                change_bar += material_.flow_adjoint(p, trial, after_bar);
            }
            F_bar = change_bar;
            if constexpr (TERMS)
                if (viscous() || branch_rows()) {
                    Mat3<V> step_bar = laws_.average_rate_adjoint(p, rate(bar));
                    step_bar = (1 / frame_.dt) * step_bar;
                    laws_.advance_branches_adjoint(p, branches(now), on_grid.step(change), branches(bar),
                                                   particle_sums() + particle_sum::numbers, step_bar);
                    change_bar += on_grid.step_adjoint(change, step_bar, F_bar);
                }
            const Mat3<V> dD_bar = on_grid.change_adjoint(dD, change_bar, shape_bar);
            put(bar, DEFORMATION, p, F_bar);
            if constexpr (SHAPED) put(bar, SHAPE, p, shape_bar);
            const Vec3<V> q = vector(bar, VELOCITY, p) + splat<V>(frame_.dt) * vector(bar, X, p);
            return FieldBlock<S>(q, V{}, (frame_.dt / frame_.cell) * dD_bar);
        });
    }

    // In: frame.carry, adjoints of the velocities after the substep by those that follow it, which go to before it, and
    // of the masses, which grow. Leaves the adjoints of the forces times dt in frame.node_bar, and the velocities before
    // the substep in frame.velocity.
    void update_nodes_adjoint(Index s) {
        const NodePhase<S> phase = node_phase();
        FrictionBar<S> friction_bar = {}, of_copies = {};
        Node<S> gravity_bar = {};
        for (Index n = first_node_; n < last_node_; n++) {
            const Around<S> near = around(n);
            const Node<S> carried = read<Node<S>>(frame_.carry + 4 * n), before = velocity_after(phase, s - 1, n);
            const auto [bar, mass_bar] = phase.adjoint(before, read<Node<S>>(kept(s) + 4 * n), near,
                                                       carried + summed(n), counts(n) ? friction_bar : of_copies);
            const S share = near.mass > frame_.mass_floor ? 1 / near.mass : S(0);
            write(frame_.carry + 4 * n, Node<S>{bar[0], bar[1], bar[2], carried[3] + mass_bar});
            write(frame_.node_bar + 4 * n, Node<S>{share * bar[0], share * bar[1], share * bar[2], bar[3]});
            write(frame_.velocity + 4 * n, before);
            if constexpr (TERMS)
                if (counts(n)) gravity_bar += frame_.dt * bar;
        }
        S* sums = node_sums();
        sums[node_sum::friction_coefficient] += friction_bar.dynamic;
        for (int d = 0; TERMS && d < 3; d++) {
            sums[node_sum::gravity + d] += gravity_bar[d];
            sums[node_sum::friction_law + d] += friction_bar.law[d];
        }
    }

    void gather_force_bar(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        apply_forces(s, now);
        for (Index p = first_; p < last_; p += LANES) {
            fetch(now, X, RATE, p);
            const Mat3<V> F = matrix(now, DEFORMATION, p);
            const auto stress = material_.stress(p, F);
            const V volume = row_of(constants(constant::volume), 0, p);
            const auto moments = gathered(frame_.node_bar, stencil_of(p), p);
            const Vec3<V> force_bar = splat<V>(frame_.dt) * moments.value();
            const Mat3<V> P_bar = (volume * (-frame_.dt / frame_.cell)) * moments.gradient();
            Mat3<V> F_bar = matrix(bar, DEFORMATION, p), shape_bar = {};
            if constexpr (SHAPED) shape_bar = matrix(bar, SHAPE, p);
            const Mat3<V> tau = all_stress(p, stress, F, now);
            const Mat3<V> tau_bar = shape_on_grid(p, now, F).stress_adjoint(tau, P_bar, F_bar, shape_bar);
            material_.stress_adjoint(p, stress, F, tau_bar, F_bar);
            if constexpr (TERMS) laws_.stress_adjoint(law_arrays(now), p, F, tau_bar, F_bar);
            put(bar, DEFORMATION, p, F_bar);
            if constexpr (SHAPED) put(bar, SHAPE, p, shape_bar);
            put(bar, VELOCITY, p, Vec3<V>{});
            put(bar, X + 2, p,
                row_of(bar, X + 2, p) + volume * touching_slope(p, now) * moments.fourth_value());
            put(frame_.force_bar, 0, p, force_bar);
            if constexpr (TERMS) {
                S* load_bar = input_bars(input::load);
                put(load_bar, 0, p, vector(load_bar, 0, p) + force_bar);
            }
        }
        hand_.adjoint(s, now + X * frame_.stride, now + VELOCITY * frame_.stride, bar + X * frame_.stride,
                      bar + VELOCITY * frame_.stride, TERMS ? input_bars(input::mass) : nullptr, particle_sums());
        if (TERMS && laws_.has(ForceTerms::TERMS)) laws_.forces_adjoint(law_arrays(now));
    }

    // In: frame.force_bar. To the adjoints of x, v and Young's modulus.
    void touch_adjoint(Index s) {
        contacts_.measure(state(s), state(s + 1), s);
        barrier_.wait();
        contacts_.update(state(s), s);
        contacts_.leave_adjoints(state(s), node_sums()[node_sum::layer_friction]);
        barrier_.wait();
        S *x_bar = frame_.adjoint + X * frame_.stride, *v_bar = frame_.adjoint + VELOCITY * frame_.stride;
        contacts_.add_up_adjoints(x_bar, {v_bar, frame_.stride, 1}, frame_.bars + bar::youngs_modulus * frame_.stride);
    }
};

template <class S, bool TERMS, bool SHAPED, bool TOUCHES, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
using WorkerOf = Worker<S, TERMS, SHAPED, TOUCHES, Material<Lanes<S>, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>;

template <class S, bool TERMS, bool SHAPED, bool TOUCHES, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void forward_frames(unsigned long long frames, unsigned long long workspaces, int count, unsigned long long next,
                           int thread) {
    for_frames<S, Frame>(frames, workspaces, count, next, thread, [](const Frame<S>& frame, int own) {
        WorkerOf<S, TERMS, SHAPED, TOUCHES, Elastic, Plastic, ElasticNetwork, PlasticNetwork>(frame, own, 0).forward();
    });
}

template <class S, bool TERMS, bool SHAPED, bool TOUCHES, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void backward_frames(unsigned long long frames, unsigned long long workspaces, int count,
                            unsigned long long next, int thread) {
    using Work = WorkerOf<S, TERMS, SHAPED, TOUCHES, Elastic, Plastic, ElasticNetwork, PlasticNetwork>;
    for_frames<S, Frame>(frames, workspaces, count, next, thread, [](const Frame<S>& frame, int own) {
        Work(frame, own, 0).forward();
        Work(frame, own, 1).backward();
    });
}

// Numbers that a thread needs for the networks' adjoints.
template <class S, bool TERMS, bool SHAPED, bool TOUCHES, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void network_numbers(Index* size) {
    size[0] = Material<Lanes<S>, Elastic, Plastic, ElasticNetwork, PlasticNetwork>::workspace_size;
}

}  // namespace physreal
