// One thread's share of a frame of a thin body: a range of its vertices and a range of its elements.
//
// The vertices are particles and nodes at once: each carries its mass and its velocity, and ground, clamps and gravity act on it as on a
// node of a volume's grid. In every substep the elements leave forces at their corners, and each vertex adds up what was left at it,
// always in the same order, so that the result does not depend on the number of threads. Segments of framed rods have directors besides
// (directors.h); a rollout of these is one thread's.
#pragma once
#include "barrier.h"
#include "contacts.h"
#include "directors.h"
#include "elements.h"
#include "framedrod.h"
#include "frames.h"
#include "hand.h"
#include "nodes.h"
#include "thin_residual.h"
#include "rows.h"
#include "surface_drag.h"
#include "term_laws.h"

namespace physreal {

// With TERMS, inputs beside the stiffness have adjoints, and optional forces act as frame.terms says. Element: see elements.h.
template <class S, bool TERMS, template <class, class> class Element>
class ThinWorker : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Elastic = Element<V, V>;
    static constexpr int CORNERS = Elastic::CORNERS, FRAMES = Elastic::FRAMES;
    static constexpr bool FRAMED = FRAMES > 0;
    // MEAN: velocities, averaged over substeps, which viscosity acts on (`rate_memory`); only of an element that has strains, without frames.
    static constexpr int X = 0, VELOCITY = 3, DIRECTOR = 6, SPIN = 9, MEAN = 6;
    using Drag = SurfaceDrag<V, Elastic::FACE>;
    using Residual = ThinResidual<Element, V>;
    // Of frame.element_force: forces, and torques; or what an element adds to the adjoint of x, of directors, of v (or of its mean) and of spins.
    static constexpr int TORQUE = 3, OF_DIRECTOR = 3, OF_VELOCITY = FRAMED ? 6 : 3, OF_SPIN = 9;

public:
    // pass: 0 for a frame, 1 for its adjoint after it; each has a barrier of its own.
    ThinWorker(const ThinFrame<S>& frame, int thread, int pass)
        : Rows(frame, thread),
          frame_(frame),
          thread_(thread),
          first_element_(share_of(element_blocks(), thread, frame.threads) * LANES),
          last_element_(share_of(element_blocks(), thread + 1, frame.threads) * LANES),
          laws_(frame, thread),
          hand_(frame, thread),
          barrier_(frame.shared + 64 * pass, frame.threads, frame.yield_address),
          contacts_(frame, thread, barrier_) {}

    void forward() {
        load_model();
        load_state();
        weigh();
        if (frame_.replay) return replay();
        barrier_.wait();
        for (Index s = 0; s < frame_.substeps; s++) {
            const S* now = state_at(s);
            if (contacts_.on()) {
                contacts_.update(now, s);
                contacts_.leave_forces(now);
            }
            leave_forces(now);
            barrier_.wait();
            if (stopped()) return;
            move(s);
            barrier_.wait();
        }
        if (frame_.keep_states) return;
        check_state();
        store_state();
    }

    // Adjoint of a frame that `forward` has just kept the states and velocities of.
    void backward() {
        load_adjoint();
        barrier_.wait();
        for (Index s = frame_.substeps - 1; s >= 0; s--) {
            if constexpr (FRAMED) turn_adjoint(s);
            move_adjoint(s);
            if (contacts_.on()) contacts_.measure(state(s), state(s + 1), s);
            barrier_.wait();
            leave_adjoints(state(s));
            if (contacts_.on()) leave_contact_adjoints(s);
            barrier_.wait();
            add_up(frame_.adjoint);
            if (contacts_.on()) add_up_contacts();
        }
        store_adjoint();
    }

private:
    using Rows::add_rows, Rows::clear, Rows::first_, Rows::gather_columns, Rows::gather_rows, Rows::last_,
        Rows::padded_end, Rows::put, Rows::scatter_columns, Rows::vector;

    const ThinFrame<S>& frame_;
    int thread_;
    Index first_element_, last_element_;
    TermLaws<S> laws_;
    Hand<S> hand_;
    Barrier barrier_;
    Contacts<S, Elastic::FACE, false> contacts_;

    bool viscous() const { return TERMS && HasStrains<Elastic>::value && laws_.has(term::viscosity); }
    bool dragged() const { return TERMS && laws_.has(term::surface_drag); }
    bool corrected() const { return !FRAMED && laws_.has(term::thin_residual); }
    // Where an element leaves what its drag adds to the adjoint of v; of a viscous one OF_VELOCITY is that of the mean.
    int of_dragged() const { return viscous() ? OF_VELOCITY + 3 : OF_VELOCITY; }
    Index state_rows() const { return FRAMED ? SPIN + 1 : viscous() ? MEAN + 3 : VELOCITY + 3; }
    Index element_blocks() const { return frame_.element_stride / LANES; }
    const S* constants(int r) const { return frame_.constants + r * frame_.stride; }
    S constant_of(int r, Index p) const { return constants(r)[p]; }
    S* input_bars(int r) const { return frame_.bars + (bar::COUNT + r) * frame_.stride; }
    S* particle_sums() const { return frame_.particle_sums + particle_sum::COUNT * thread_; }
    S* node_sums() const { return frame_.node_sums + node_sum::COUNT * thread_; }
    S* state(Index slot) const { return frame_.state + slot * state_rows() * frame_.stride; }
    // After s substeps: kept, or in one of two places by turns.
    S* state_at(Index s) const { return state(frame_.keep_states ? s : s % 2); }
    S* kept_spins(Index s) const { return frame_.free + (4 * frame_.substeps + s) * frame_.particles; }
    bool damped() const { return TERMS && laws_.has(term::retardation); }
    S* kept(Index s) const { return frame_.free + 4 * s * frame_.particles; }
    Around<S> around(Index p) const { return {frame_.around[2 * p], frame_.around[2 * p + 1]}; }

    typename TermLaws<S>::Arrays law_arrays(const S* now) const {
        S* bar = frame_.adjoint;
        return {now + X * frame_.stride,
                now + VELOCITY * frame_.stride,
                nullptr,
                nullptr,
                constants(constant::mass),
                constants(constant::COUNT),
                bar + X * frame_.stride,
                bar + VELOCITY * frame_.stride,
                nullptr,
                nullptr,
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

    // Three rows of one vertex.
    Vec3<S> at(const S* rows, int r, Index p) const {
        const S* from = rows + r * frame_.stride + p;
        return {{from[0], from[frame_.stride], from[2 * frame_.stride]}};
    }
    void put_at(S* rows, int r, Index p, const Vec3<S>& value) const {
        for (int d = 0; d < 3; d++) rows[(r + d) * frame_.stride + p] = value[d];
    }
    template <class Node>
    static Vec3<S> three(const Node& n) {
        return {{n[0], n[1], n[2]}};
    }
    using Node = Lanes<S, 4>;
    static Node read(const S* from) { return load<S, 4>(from); }

    // --- in and out

    void load_model() {
        const Frame<S>& f = frame_;
        gather_rows(f.constants, f.given, f.constant_rows);
        gather_rows(f.force, f.given + constant::load * f.particles, 3);
    }

    void load_state() {
        S* s = state(0);
        gather_columns(s + X * frame_.stride, frame_.x, 3);
        for (Index p = first_; p < padded_end(); p++)
            put_at(s, VELOCITY, p, three(read(frame_.nodes + 4 * min_of(p, frame_.particles - 1))));
        if (viscous()) gather_columns(s + MEAN * frame_.stride, frame_.mean_velocity, 3);
        if constexpr (FRAMED) {
            gather_columns(s + DIRECTOR * frame_.stride, frame_.director, 3);
            gather_columns(s + SPIN * frame_.stride, frame_.spin, 1);
        }
    }

    // Mass and volume of each vertex; what a clamp holds has no mass here.
    void weigh() {
        for (Index p = first_; p < last_; p++) {
            frame_.around[2 * p] = held(at(frame_.constants, constant::place, p)) ? S(0) : constant_of(constant::mass, p);
            frame_.around[2 * p + 1] = constant_of(constant::volume, p);
        }
    }

    bool held(const Vec3<S>& place) const {
        for (Index c = 0; c < frame_.clamps; c++) {
            bool inside = true;
            for (int d = 0; d < 3; d++)
                inside &= place[d] >= frame_.clamp_lower[3 * c + d] && place[d] <= frame_.clamp_upper[3 * c + d];
            if (inside) return true;
        }
        return false;
    }

    void store_state() const {
        const S* s = state_at(frame_.substeps);
        scatter_columns(frame_.x_end, s + X * frame_.stride, 3);
        scatter_columns(frame_.v_end, s + VELOCITY * frame_.stride, 3);
        for (Index p = first_; p < last_; p++) {
            const Vec3<S> v = at(s, VELOCITY, p);
            store(frame_.nodes_end + 4 * p, Node{v[0], v[1], v[2], 0});
        }
        if (viscous()) scatter_columns(frame_.mean_velocity_end, s + MEAN * frame_.stride, 3);
        if constexpr (FRAMED) {
            scatter_columns(frame_.director_end, s + DIRECTOR * frame_.stride, 3);
            scatter_columns(frame_.spin_end, s + SPIN * frame_.stride, 1);
        }
    }

    void load_adjoint() {
        S* a = frame_.adjoint;
        gather_columns(a + X * frame_.stride, frame_.x_bar, 3);
        gather_columns(a + VELOCITY * frame_.stride, frame_.v_bar, 3);
        if (viscous()) gather_columns(a + MEAN * frame_.stride, frame_.mean_velocity_bar, 3);
        if constexpr (FRAMED) {
            gather_columns(a + DIRECTOR * frame_.stride, frame_.director_bar, 3);
            gather_columns(a + SPIN * frame_.stride, frame_.spin_bar, 1);
        }
        clear(frame_.bars, frame_.bar_rows);
        for (Index p = first_; p < last_; p++) {
            const Vec3<S> bar = three(read(frame_.nodes_bar + 4 * p)) + at(a, VELOCITY, p);
            store(frame_.carry + 4 * p, Node{bar[0], bar[1], bar[2], 0});
        }
        clear(a + VELOCITY * frame_.stride, 3);
    }

    void store_adjoint() const {
        const S* a = frame_.adjoint;
        scatter_columns(frame_.x_bar, a + X * frame_.stride, 3);
        scatter_columns(frame_.v_bar, a + VELOCITY * frame_.stride, 3);
        if (viscous()) scatter_columns(frame_.mean_velocity_bar, a + MEAN * frame_.stride, 3);
        if constexpr (FRAMED) {
            scatter_columns(frame_.director_bar, a + DIRECTOR * frame_.stride, 3);
            scatter_columns(frame_.spin_bar, a + SPIN * frame_.stride, 1);
        }
        add_rows(frame_.given_bars, frame_.bars, frame_.bar_rows);
        for (Index p = first_; p < last_; p++) store(frame_.nodes_bar + 4 * p, read(frame_.carry + 4 * p));
    }

    // --- elements

    template <class Rows>
    Vec3<V> at_corner(const Rows* rows, int corner, Index e) const {
        const int* places = frame_.corners + corner * frame_.element_stride + e;
        Vec3<V> value;
        for (int d = 0; d < 3; d++)
            for (int l = 0; l < LANES; l++) value[d][l] = rows[d * frame_.stride + places[l]];
        return value;
    }

    template <int COUNT>
    void rows_of(const S* rows, Index e, V (&values)[COUNT]) const {
        for (int r = 0; r < COUNT; r++) values[r] = load<S, LANES>(rows + r * frame_.element_stride + e);
    }

    // What all corners leave along an axis.
    S* element_row(int d) const { return frame_.element_force + d * CORNERS * frame_.element_stride; }

    V number_at(const S* row, int corner, Index e) const {
        const int* places = frame_.corners + corner * frame_.element_stride + e;
        V value;
        for (int l = 0; l < LANES; l++) value[l] = row[places[l]];
        return value;
    }

    void leave(int row, int corner, Index e, V value) const {
        store(element_row(row) + corner * frame_.element_stride + e, value);
    }
    void leave(int row, int corner, Index e, const Vec3<V>& value) const {
        for (int d = 0; d < 3; d++) leave(row + d, corner, e, value[d]);
    }
    template <int COUNT>
    void add_rows_of(S* rows, Index e, const V (&values)[COUNT]) const {
        for (int r = 0; r < COUNT; r++) {
            S* row = rows + r * frame_.element_stride + e;
            store(row, load<S, LANES>(row) + values[r]);
        }
    }
    template <class Rows>
    void at_corners(const Rows* rows, Index e, Vec3<V> (&values)[CORNERS]) const {
        for (int c = 0; c < CORNERS; c++) values[c] = at_corner(rows, c, e);
    }
    void leave(int row, Index e, const Vec3<V> (&values)[CORNERS]) const {
        for (int c = 0; c < CORNERS; c++) leave(row, c, e, values[c]);
    }
    // Of the stiffness, then with viscosity of that.
    S* viscosity_rows(S* rows) const { return rows + Elastic::STIFFNESS * frame_.element_stride; }
    const S* viscosity_rows(const S* rows) const { return rows + Elastic::STIFFNESS * frame_.element_stride; }

    // Then the coefficients of the drag, and last those of a residual.
    template <class Any>
    Any* drag_rows(Any* rows) const {
        return rows + (viscous() ? 2 : 1) * Elastic::STIFFNESS * frame_.element_stride;
    }
    template <class Any>
    Any* residual_rows(Any* rows) const {
        return drag_rows(rows) + (dragged() ? Drag::ROWS : 0) * frame_.element_stride;
    }

    void leave_forces(const S* now) const {
        for (Index e = first_element_; e < last_element_; e += LANES) {
            V constants[Elastic::CONSTANTS], stiffness[Elastic::STIFFNESS];
            rows_of(frame_.element_constants, e, constants);
            rows_of(frame_.element_stiffness, e, stiffness);
            Vec3<V> f[CORNERS] = {};
            if constexpr (FRAMED) {
                const auto found = FramedRodForces<V>(constants, stiffness).forces(elements_at(now, e), damped());
                for (int c = 0; c < CORNERS; c++) f[c] = found.force[c];
                for (int i = 0; i < FRAMES; i++) leave(TORQUE, i, e, found.torque[i]);
            } else {
                add_elastic(constants, stiffness, now, e, f);
            }
            if (dragged()) add_drag(now, e, f);
            leave(0, e, f);
        }
    }

    // With viscosity where there is one.
    void add_elastic(const V (&constants)[Elastic::CONSTANTS], V (&stiffness)[Elastic::STIFFNESS], const S* now, Index e,
                     Vec3<V> (&f)[CORNERS]) const {
        Vec3<V> x[CORNERS];
        at_corners(now + X * frame_.stride, e, x);
        if (corrected()) {
            V coefficients[Residual::ROWS];
            rows_of(residual_rows(frame_.element_stiffness), e, coefficients);
            Residual(x, constants, coefficients, frame_.beta_elastic).scale(stiffness, stiffness);
        }
        if constexpr (HasStrains<Elastic>::value) {
            if (viscous()) {
                V viscosity[Elastic::STIFFNESS];
                rows_of(viscosity_rows(frame_.element_stiffness), e, viscosity);
                Vec3<V> v[CORNERS];
                at_corners(now + MEAN * frame_.stride, e, v);
                return ViscousForces<Element, V>{constants, stiffness, viscosity}.forces(x, v, f);
            }
        }
        ElasticForces<Element, V>{constants, stiffness}.forces(x, f);
    }

    void add_drag(const S* now, Index e, Vec3<V> (&f)[CORNERS]) const {
        V coefficients[Drag::ROWS];
        rows_of(drag_rows(frame_.element_stiffness), e, coefficients);
        Vec3<V> x[CORNERS], v[CORNERS];
        at_corners(now + X * frame_.stride, e, x);
        at_corners(now + VELOCITY * frame_.stride, e, v);
        Drag::forces(coefficients, x, v, f);
    }

    void add_drag_adjoint(const S* now, Index e, const Vec3<V> (&f_bar)[CORNERS], Vec3<V> (&x_bar)[CORNERS],
                          Vec3<V> (&v_bar)[CORNERS]) const {
        V coefficients[Drag::ROWS], bar[Drag::ROWS] = {};
        rows_of(drag_rows(frame_.element_stiffness), e, coefficients);
        Vec3<V> x[CORNERS], v[CORNERS];
        at_corners(now + X * frame_.stride, e, x);
        at_corners(now + VELOCITY * frame_.stride, e, v);
        Drag::adjoint(coefficients, x, v, f_bar, x_bar, v_bar, bar);
        add_rows_of(drag_rows(frame_.element_bars), e, bar);
    }

    typename FramedRodForces<V>::State elements_at(const S* now, Index e) const {
        typename FramedRodForces<V>::State found = {};
        for (int c = 0; c < CORNERS; c++) {
            found.x[c] = at_corner(now + X * frame_.stride, c, e);
            if (damped()) found.v[c] = at_corner(now + VELOCITY * frame_.stride, c, e);
        }
        for (int i = 0; i < FRAMES; i++) {
            found.director[i] = at_corner(now + DIRECTOR * frame_.stride, i, e);
            if (damped()) found.spin[i] = number_at(now + SPIN * frame_.stride, i, e);
        }
        return found;
    }

    // In: frame.force_bar. Leaves what the elements add to the adjoint of x, and with viscosity of the mean of v.
    void leave_adjoints(const S* now) const {
        for (Index e = first_element_; e < last_element_; e += LANES) {
            V constants[Elastic::CONSTANTS], stiffness[Elastic::STIFFNESS], bar[Elastic::STIFFNESS] = {};
            rows_of(frame_.element_constants, e, constants);
            rows_of(frame_.element_stiffness, e, stiffness);
            if constexpr (FRAMED) {
                leave_framed(FramedRodForces<V>(constants, stiffness), now, e, bar);
            } else {
                Vec3<V> x[CORNERS], f_bar[CORNERS], x_bar[CORNERS] = {};
                at_corners(now + X * frame_.stride, e, x);
                at_corners(frame_.force_bar, e, f_bar);
                const auto add_elastic_adjoint = [&](const V(&acting)[Elastic::STIFFNESS]) {
                    if (!leave_viscous_adjoint(ViscousRows{constants, acting}, now, e, x, f_bar, x_bar, bar))
                        ElasticForces<Element, V>{constants, acting}.adjoint(x, f_bar, x_bar, bar);
                };
                if (corrected()) {
                    V coefficients[Residual::ROWS], coefficients_bar[Residual::ROWS] = {}, scaled[Elastic::STIFFNESS];
                    rows_of(residual_rows(frame_.element_stiffness), e, coefficients);
                    const Residual residual(x, constants, coefficients, frame_.beta_elastic);
                    residual.scale(stiffness, scaled);
                    add_elastic_adjoint(scaled);
                    residual.adjoint(stiffness, coefficients, bar, x_bar, coefficients_bar);
                    add_rows_of(residual_rows(frame_.element_bars), e, coefficients_bar);
                } else {
                    add_elastic_adjoint(stiffness);
                }
                if (dragged()) {
                    Vec3<V> v_bar[CORNERS] = {};
                    add_drag_adjoint(now, e, f_bar, x_bar, v_bar);
                    leave(of_dragged(), e, v_bar);
                }
                leave(0, e, x_bar);
            }
            add_rows_of(frame_.element_bars, e, bar);
        }
    }

    template <class Forces>
    void leave_framed(const Forces& forces, const S* now, Index e, V (&bar)[Elastic::STIFFNESS]) const {
        typename Forces::Forces of;
        for (int c = 0; c < CORNERS; c++) of.force[c] = at_corner(frame_.force_bar, c, e);
        for (int i = 0; i < FRAMES; i++) of.torque[i] = number_at(frame_.torque, i, e);
        auto found = forces.adjoint(elements_at(now, e), of, damped(), bar);
        if (dragged()) add_drag_adjoint(now, e, of.force, found.x, found.v);
        leave(0, e, found.x);
        for (int i = 0; i < FRAMES; i++) leave(OF_DIRECTOR, i, e, found.director[i]);
        if (damped() || dragged()) leave(OF_VELOCITY, e, found.v);
        for (int i = 0; damped() && i < FRAMES; i++) leave(OF_SPIN, i, e, found.spin[i]);
    }

    struct ViscousRows {
        const V (&constants)[Elastic::CONSTANTS], (&stiffness)[Elastic::STIFFNESS];
    };
    // Whether there is viscosity.
    bool leave_viscous_adjoint(const ViscousRows& given, const S* now, Index e, const Vec3<V> (&x)[CORNERS],
                               const Vec3<V> (&f_bar)[CORNERS], Vec3<V> (&x_bar)[CORNERS],
                               V (&bar)[Elastic::STIFFNESS]) const {
        if constexpr (HasStrains<Elastic>::value) {
            if (!viscous()) return false;
            V viscosity[Elastic::STIFFNESS], viscosity_bar[Elastic::STIFFNESS] = {};
            rows_of(viscosity_rows(frame_.element_stiffness), e, viscosity);
            Vec3<V> v[CORNERS], v_bar[CORNERS] = {};
            at_corners(now + MEAN * frame_.stride, e, v);
            ViscousForces<Element, V>{given.constants, given.stiffness, viscosity}.adjoint(x, v, f_bar, x_bar, v_bar,
                                                                                          bar, viscosity_bar);
            leave(OF_VELOCITY, e, v_bar);
            add_rows_of(viscosity_rows(frame_.element_bars), e, viscosity_bar);
            return true;
        }
        return false;
    }

    // What the first `count` corners of elements left at a vertex, in the three rows from `first` on.
    Vec3<S> left_at(Index p, int first = 0, Index count = CORNERS) const {
        Vec3<S> sum = {};
        for (Index i = frame_.incident_first[p]; i < frame_.incident_first[p + 1]; i++) {
            if (count < CORNERS && frame_.incident[i] >= count * frame_.element_stride) continue;
            for (int d = 0; d < 3; d++) sum[d] += element_row(first + d)[frame_.incident[i]];
        }
        return sum;
    }
    // What elements left in one row at the segment that begins at a vertex.
    S left_at_segment(Index p, int row) const {
        S sum = 0;
        for (Index i = frame_.incident_first[p]; i < frame_.incident_first[p + 1]; i++)
            if (frame_.incident[i] < FRAMES * frame_.element_stride) sum += element_row(row)[frame_.incident[i]];
        return sum;
    }

    void add_up(S* bar) const {
        for (Index p = first_; p < last_; p++) put_at(bar, X, p, at(bar, X, p) + left_at(p));
        if (viscous())
            for (Index p = first_; p < last_; p++) put_at(bar, MEAN, p, at(bar, MEAN, p) + left_at(p, OF_VELOCITY));
        if constexpr (FRAMED) {
            Directors<S>(frame_).add_turned(bar, frame_.turned);
            for (Index p = first_; p < last_; p++) {
                put_at(bar, DIRECTOR, p, at(bar, DIRECTOR, p) + left_at(p, OF_DIRECTOR, FRAMES));
                if (damped()) bar[SPIN * frame_.stride + p] += left_at_segment(p, OF_SPIN);
            }
        }
        if (damped() || dragged())
            for (Index p = first_; p < last_; p++) add_to_velocity(p, left_at(p, of_dragged()));
    }
    // To the adjoint of the velocity.
    void add_to_velocity(Index p, const Vec3<S>& bar) const {
        const Vec3<S> sum = three(read(frame_.carry + 4 * p)) + bar;
        store(frame_.carry + 4 * p, Node{sum[0], sum[1], sum[2], 0});
    }

    // --- contact between layers

    void leave_contact_adjoints(Index s) {
        contacts_.update(state(s), s);
        contacts_.leave_adjoints(state(s), node_sums()[node_sum::layer_friction]);
    }

    // To the adjoints of x, of the velocity in frame.carry and of Young's modulus.
    void add_up_contacts() const {
        S* x_bar = frame_.adjoint + X * frame_.stride;
        contacts_.add_up_adjoints(x_bar, {frame_.carry, 1, 4}, frame_.bars + bar::youngs_modulus * frame_.stride);
    }

    // --- vertices

    // How fully a vertex touches the ground, from 0 to 1.
    S touching(Index p, S z) const {
        const S deep = (constant_of(constant::touch_height, p) - z) * frame_.touch_slope;
        return deep < 0 ? S(0) : deep < 1 ? deep : S(1);
    }

    void apply_forces(Index s, const S* now) {
        const S* before_hand = constants(constant::load);
        if (TERMS && laws_.has(ForceTerms::TERMS)) {
            laws_.forces(law_arrays(now), before_hand);
            before_hand = frame_.force;
        }
        hand_.forces(s, now + X * frame_.stride, now + VELOCITY * frame_.stride, before_hand);
    }

    void move(Index s) {
        const S* now = state_at(s);
        S* next = state_at(s + 1);
        const NodePhase<S> phase = node_phase();
        apply_forces(s, now);
        if (contacts_.on()) contacts_.add_up_forces();
        for (Index p = first_; p < last_; p++) {
            const Vec3<S> x = at(now, X, p), v = at(now, VELOCITY, p);
            Vec3<S> f = at(frame_.force, 0, p) + left_at(p);
            if (contacts_.on()) f = f + at(frame_.contact_force, 0, p);
            const Node push = {frame_.dt * f[0], frame_.dt * f[1], frame_.dt * f[2],
                               constant_of(constant::volume, p) * touching(p, x[2])};
            const Node free = phase.free(Node{v[0], v[1], v[2], 0}, push, around(p));
            check(s, p, x, three(free));
            if (frame_.keep_grids) store(kept(s) + 4 * p, free);
            step(now, next, p, three(phase.velocity(free, around(p))));
        }
        if constexpr (FRAMED) {
            for (Index p = first_; p < last_; p++) frame_.torque[p] = left_at_segment(p, TORQUE);
            const Directors<S> directors(frame_);
            directors.spin(now, next, frame_.torque);
            directors.turn(now, next);
            const S* spins = next + SPIN * frame_.stride;
            for (Index p = first_; frame_.keep_grids && p < last_; p++) kept_spins(s)[p] = spins[p];
        }
        if (contacts_.on()) contacts_.measure(next, next, s + 1);
    }

    void step(const S* now, S* next, Index p, const Vec3<S>& v) const {
        const S kept = frame_.remembered;
        put_at(next, VELOCITY, p, v);
        put_at(next, X, p, at(now, X, p) + frame_.dt * v);
        if (viscous()) put_at(next, MEAN, p, kept * at(now, MEAN, p) + (1 - kept) * v);
        if (p + 1 < last_) return;
        for (Index filled = last_; filled < padded_end(); filled++)  // the last block, as in `load_state`
            for (int r = 0; r < (viscous() ? MEAN + 3 : MEAN); r += 3) put_at(next, r, filled, at(next, r, p));
    }

    // The states of a frame of which the velocities are there.
    void replay() {
        const NodePhase<S> phase = node_phase();
        for (Index s = 0; s < frame_.substeps; s++) {
            for (Index p = first_; p < last_; p++)
                step(state(s), state(s + 1), p, three(phase.velocity(read(kept(s) + 4 * p), around(p))));
            if constexpr (FRAMED) {
                S* spins = state(s + 1) + SPIN * frame_.stride;
                for (Index p = first_; p < last_; p++) spins[p] = kept_spins(s)[p];
                Directors<S>(frame_).turn(state(s), state(s + 1));
            }
        }
        barrier_.wait();
    }

    // --- failures

    bool stopped() const { return __atomic_load_n(frame_.shared + 32, __ATOMIC_RELAXED) != 0; }

    // A vertex that is not finite stops the frame at this substep.
    void check(Index s, Index p, const Vec3<S>& x, const Vec3<S>& v) {
        const S magnitude = dot(x, x) + dot(v, v);
        if (magnitude - magnitude == 0) return;
        Index& first = frame_.status[thread_];
        const Index key = s * frame_.particles + frame_.order[p];
        if (key < first) first = key;
        __atomic_store_n(frame_.shared + 32, 1, __ATOMIC_RELAXED);
    }

    void check_state() {
        const S* s = state_at(frame_.substeps);
        for (Index p = first_; p < last_; p++) check(frame_.substeps, p, at(s, X, p), at(s, VELOCITY, p));
    }

    // --- adjoint

    // The adjoint of what the substep does to directors and spins, see `Directors::adjoint`.
    void turn_adjoint(Index s) const {
        Directors<S>(frame_).adjoint(state(s), state(s + 1), frame_.adjoint, frame_.torque, frame_.turned, frame_.mobility_bar);
    }

    // In: the adjoint of x and, in frame.carry, that of the velocity after the substep; out: the same before it but for what the
    // elements add to that of x, and the adjoint of the forces in frame.force_bar.
    void move_adjoint(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        const NodePhase<S> phase = node_phase();
        FrictionBar<S> friction_bar = {};
        Vec3<S> gravity_bar = {};
        for (Index p = first_; p < last_; p++) {
            const Around<S> near = around(p);
            const Vec3<S> x_bar = at(bar, X, p), carried = three(read(frame_.carry + 4 * p)), v = at(now, VELOCITY, p);
            const Vec3<S> v_bar = carried + frame_.dt * x_bar + mean_adjoint(bar, p);
            const auto [b, mass_bar] = phase.adjoint(Node{v[0], v[1], v[2], 0}, read(kept(s) + 4 * p), near,
                                                     Node{v_bar[0], v_bar[1], v_bar[2], 0}, friction_bar);
            const S share = near.mass > frame_.mass_floor ? frame_.dt / near.mass : S(0);
            store(frame_.carry + 4 * p, Node{b[0], b[1], b[2], 0});
            put_at(frame_.force_bar, 0, p, share * three(b));
            const S deep = touching(p, now[(X + 2) * frame_.stride + p]);
            if (deep > 0 && deep < 1)
                bar[(X + 2) * frame_.stride + p] -= constant_of(constant::volume, p) * frame_.touch_slope * b[3];
            if constexpr (TERMS) {
                input_bars(input::mass)[p] += mass_bar;
                gravity_bar = gravity_bar + frame_.dt * three(b);
                put_at(input_bars(input::load), 0, p, at(input_bars(input::load), 0, p) + share * three(b));
            }
        }
        for (Index p = last_; p < padded_end(); p++) put_at(frame_.force_bar, 0, p, Vec3<S>{});
        S* sums = node_sums();
        sums[node_sum::friction_coefficient] += friction_bar.dynamic;
        for (int d = 0; TERMS && d < 3; d++) {
            sums[node_sum::gravity + d] += gravity_bar[d];
            sums[node_sum::friction_law + d] += friction_bar.law[d];
        }
        forces_adjoint(s, now);
    }

    // What the mean velocity's adjoint adds to that of the velocity, of which the rest stays.
    Vec3<S> mean_adjoint(S* bar, Index p) const {
        if (!viscous()) return {};
        const Vec3<S> of_mean = at(bar, MEAN, p);
        put_at(bar, MEAN, p, frame_.remembered * of_mean);
        return (1 - frame_.remembered) * of_mean;
    }

    void forces_adjoint(Index s, const S* now) {
        S* bar = frame_.adjoint;
        hand_.adjoint(s, now + X * frame_.stride, now + VELOCITY * frame_.stride, bar + X * frame_.stride,
                      bar + VELOCITY * frame_.stride, TERMS ? input_bars(input::mass) : nullptr, particle_sums());
        if (TERMS && laws_.has(ForceTerms::TERMS)) laws_.forces_adjoint(law_arrays(now));
        for (Index p = first_; p < last_; p++) {
            const Vec3<S> sum = three(read(frame_.carry + 4 * p)) + at(bar, VELOCITY, p);
            store(frame_.carry + 4 * p, Node{sum[0], sum[1], sum[2], 0});
        }
        clear(bar + VELOCITY * frame_.stride, 3);
    }
};

template <class S, bool TERMS, template <class, class> class Element>
inline void forward_frames(unsigned long long frames, unsigned long long workspaces, int count, unsigned long long next,
                           int thread) {
    for_frames<S, ThinFrame>(frames, workspaces, count, next, thread, [](const ThinFrame<S>& frame, int own) {
        ThinWorker<S, TERMS, Element>(frame, own, 0).forward();
    });
}

template <class S, bool TERMS, template <class, class> class Element>
inline void backward_frames(unsigned long long frames, unsigned long long workspaces, int count,
                            unsigned long long next, int thread) {
    for_frames<S, ThinFrame>(frames, workspaces, count, next, thread, [](const ThinFrame<S>& frame, int own) {
        ThinWorker<S, TERMS, Element>(frame, own, 0).forward();
        ThinWorker<S, TERMS, Element>(frame, own, 1).backward();
    });
}

// Thin bodies have no networks.
template <class S, bool TERMS, template <class, class> class Element>
inline void network_numbers(Index* size) {
    size[0] = 0;
}

}  // namespace physreal
