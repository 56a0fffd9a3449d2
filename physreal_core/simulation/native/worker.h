// One thread's share of a frame: a range of the particles in the order of the cells, and a range of the nodes.
//
// Every thread scatters to a grid of its own; the nodes' phase adds them up, in the order of the threads, so that the
// result depends on their number but not on chance.
#pragma once
#include "barrier.h"
#include "frame.h"
#include "grip.h"
#include "material.h"
#include "nodes.h"
#include "rows.h"
#include "term_laws/term_laws.h"
#include "transfers.h"

namespace physreal {

// With TERMS, inputs beside the material have adjoints, and optional laws act as frame.terms says.
template <class S, bool TERMS, class Material>
class Worker : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    static constexpr int X = 0, VELOCITY = 3, DEFORMATION = 6, AFFINE = 15, RATE = 24;
    enum Constant { MASS, VOLUME, LOAD, YOUNGS = 5, POISSON, PLASTIC, LATENT = 9 };
    enum Bar { E_BAR, NU_BAR, PLASTIC_BAR, LATENT_BAR = 4 };

public:
    Worker(const Frame<S>& frame, int thread)
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
          material_(material_arrays(frame, thread)),
          laws_(frame, thread, term_rows(), input_bars() + TERM_BAR * frame.stride, sums() + NUMBERS_SUM),
          barrier_(frame.shared, frame.threads, frame.yield_) {}

    void forward() {
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
        check_state();
        store_state();
    }

    // Adjoint of a frame of which `forward` has kept states and grids, with the same order of particles and number of
    // threads.
    void backward() {
        load_model();
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
    using Rows::add_rows, Rows::clear, Rows::first_, Rows::gather_rows, Rows::last_, Rows::lanes_from, Rows::matrix,
        Rows::padded_end, Rows::put, Rows::row, Rows::scatter_rows, Rows::vector;

    const Frame<S>& frame_;
    int thread_;
    Box<S> box_;
    Index first_node_, last_node_;
    S* scratch_;
    Material material_;
    TermLaws<S> laws_;
    Barrier barrier_;

    bool viscous() const { return TERMS && laws_.has(VISCOSITY); }
    // Rows of the state: with viscosity the mean rate of deformation, 9 of them, stands behind x, v, F and C.
    int state_rows() const { return viscous() ? RATE + 9 : RATE; }
    S* rate(S* state) const { return state + RATE * frame_.stride; }
    const S* rate(const S* state) const { return state + RATE * frame_.stride; }
    int latents() const { return int(frame_.latent_elastic_size + frame_.latent_plastic_size); }
    // Rows of the optional laws' parameters (TermRow), and of the inputs' adjoints (InputBar).
    const S* term_rows() const { return frame_.constants + (LATENT + latents()) * frame_.stride; }
    S* input_bars() const { return frame_.bars + (LATENT_BAR + latents()) * frame_.stride; }
    S* sums() const { return frame_.sums + SUMS * thread_; }

    S* state(Index slot) const { return frame_.state + slot * state_rows() * frame_.stride; }
    static MaterialArrays<S> material_arrays(const Frame<S>& f, int thread) {
        auto constant = [&](int r) { return f.constants + r * f.stride; };
        auto bar = [&](int r) { return f.bars + r * f.stride; };
        MaterialArrays<S> a;
        a.E = constant(YOUNGS);
        a.nu = constant(POISSON);
        a.plastic = constant(PLASTIC);
        a.latent_elastic = constant(LATENT);
        a.latent_plastic = constant(LATENT + int(f.latent_elastic_size));
        a.network_elastic = f.network_elastic;
        a.network_plastic = f.network_plastic;
        a.E_bar = bar(E_BAR);
        a.nu_bar = bar(NU_BAR);
        a.plastic_bar = bar(PLASTIC_BAR);
        a.latent_elastic_bar = bar(LATENT_BAR);
        a.latent_plastic_bar = bar(LATENT_BAR + int(f.latent_elastic_size));
        a.network_elastic_bar = f.network_elastic_bar + thread * f.weights_elastic;
        a.network_plastic_bar = f.network_plastic_bar + thread * f.weights_plastic;
        a.stride = f.stride;
        a.dt = f.dt;
        a.share = f.share;
        a.beta_elastic = f.beta_elastic;
        a.beta_plastic = f.beta_plastic;
        a.strain_scale = f.strain_scale;
        a.workspace = f.workspace + thread * f.workspace_size;
        return a;
    }

    // --- in and out
    // -----------------------------------------------------------------------------------------------------

    // The last particle fills the block that is not full; nothing of those lanes is scattered or stored.
    void load_state() {
        const Frame<S>& f = frame_;
        S* s = state(0);
        gather_rows(s + X * f.stride, f.x, 3);
        gather_rows(s + VELOCITY * f.stride, f.v, 3);
        gather_rows(s + DEFORMATION * f.stride, f.F, 9);
        gather_rows(s + AFFINE * f.stride, f.C, 9);
        if (viscous()) gather_rows(rate(s), f.rate, 9);
    }

    void load_model() {
        const Frame<S>& f = frame_;
        mark_nodes(f, first_node_, last_node_);
        for (Index p = first_; p < last_; p++) f.place[f.order[p]] = int(p);
        S* c = f.constants;
        gather_rows(c + MASS * f.stride, f.mass, 1);
        gather_rows(c + VOLUME * f.stride, f.volume, 1);
        gather_rows(c + LOAD * f.stride, f.load, 3);
        gather_rows(f.force, f.load, 3);
        gather_rows(c + YOUNGS * f.stride, f.E, 1);
        gather_rows(c + POISSON * f.stride, f.nu, 1);
        gather_rows(c + PLASTIC * f.stride, f.plastic, 2);
        gather_rows(c + LATENT * f.stride, f.latent_elastic, int(f.latent_elastic_size));
        gather_rows(c + (LATENT + f.latent_elastic_size) * f.stride, f.latent_plastic, int(f.latent_plastic_size));
        if constexpr (TERMS) gather_rows(c + (LATENT + latents()) * f.stride, f.term_values, TERM_ROWS);
    }

    void store_state() const {
        const Frame<S>& f = frame_;
        const S* s = state(f.keep_states ? f.substeps : 0);
        scatter_rows(f.x, s + X * f.stride, 3);
        scatter_rows(f.v, s + VELOCITY * f.stride, 3);
        scatter_rows(f.F, s + DEFORMATION * f.stride, 9);
        scatter_rows(f.C, s + AFFINE * f.stride, 9);
        if (viscous()) scatter_rows(f.rate, rate(s), 9);
    }

    void load_adjoint() {
        const Frame<S>& f = frame_;
        S* a = f.adjoint;
        gather_rows(a + X * f.stride, f.x_bar, 3);
        gather_rows(a + VELOCITY * f.stride, f.v_bar, 3);
        gather_rows(a + DEFORMATION * f.stride, f.F_bar, 9);
        gather_rows(a + AFFINE * f.stride, f.C_bar, 9);
        if (viscous()) gather_rows(rate(a), f.rate_bar, 9);
        for (int r = 0; r < state_rows(); r++)
            for (Index p = last_; p < padded_end(); p++) a[r * f.stride + p] = 0;
        clear(f.bars, LATENT_BAR + latents() + (TERMS ? INPUT_BARS : 0));
    }

    void store_adjoint() const {
        const Frame<S>& f = frame_;
        const S *a = f.adjoint, *b = f.bars;
        scatter_rows(f.x_bar, a + X * f.stride, 3);
        scatter_rows(f.v_bar, a + VELOCITY * f.stride, 3);
        scatter_rows(f.F_bar, a + DEFORMATION * f.stride, 9);
        scatter_rows(f.C_bar, a + AFFINE * f.stride, 9);
        if (viscous()) scatter_rows(f.rate_bar, rate(a), 9);
        add_rows(f.E_bar, b + E_BAR * f.stride, 1);
        add_rows(f.nu_bar, b + NU_BAR * f.stride, 1);
        add_rows(f.plastic_bar, b + PLASTIC_BAR * f.stride, 2);
        add_rows(f.latent_elastic_bar, b + LATENT_BAR * f.stride, int(f.latent_elastic_size));
        add_rows(f.latent_plastic_bar, b + (LATENT_BAR + f.latent_elastic_size) * f.stride, int(f.latent_plastic_size));
        if constexpr (TERMS) {
            add_rows(f.mass_bar, input_bars() + MASS_BAR * f.stride, 1);
            add_rows(f.load_bar, input_bars() + FORCE_BAR * f.stride, 3);
            add_rows(f.term_bar, input_bars() + TERM_BAR * f.stride, TERM_ROWS);
        }
    }

    // --- forward
    // ------------------------------------------------------------------------------------------------------

    void clear_scratch() { __builtin_memset(scratch_, 0, 4 * (box_.nodes() + 4) * sizeof(S)); }

    // APIC's m (v + C n) w, and - dt V tau grad w.
    FieldBlock<S> momentum_field(Index p, const Vec3<V>& momentum, const Mat3<V>& C, const Mat3<V>& tau,
                                 const Stencil<S>& stencil) const {
        V m = row(frame_.constants, MASS, p), volume = row(frame_.constants, VOLUME, p);
        return {momentum, m, (m * (frame_.cell / 4)) * C, (volume * (-frame_.dt / frame_.cell)) * tau, stencil};
    }
    Vec3<V> pushed_momentum(Index p, const S* s) const {
        V m = row(frame_.constants, MASS, p);
        Vec3<V> q;
        for (int d = 0; d < 3; d++) q.v[d] = m * row(s, VELOCITY + d, p) + frame_.dt * row(frame_.force, d, p);
        return q;
    }

    // Forces on the thread's particles in a substep, into frame.force.
    void apply_forces(Index s, const S* now) {
        const S* before_grip = frame_.constants + LOAD * frame_.stride;
        if (TERMS && laws_.has_forces()) {
            laws_.forces(now + X * frame_.stride, now + VELOCITY * frame_.stride,
                         frame_.constants + MASS * frame_.stride, before_grip);
            before_grip = frame_.force;
        }
        grip_forces(frame_, s, now, before_grip, first_, last_);
    }

    // The stress of a block with that of the optional laws.
    template <class Stress>
    Mat3<V> all_stress(Index p, const Stress& stress, const Mat3<V>& F, const S* now) const {
        if constexpr (TERMS)
            return laws_.stress(p, F, rate(now), stress.tau);
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
            auto stress = material_.stress(int(p), F);
            Stencil<S> stencil(x.v, box_);
            const auto field =
                momentum_field(p, momentum, matrix(now, AFFINE, p), all_stress(p, stress, F, now), stencil);
            if (fails(s, p, stencil, x, momentum, field.A)) return;
            for (int l = 0; l < lanes_from(p); l++)
                scatter.add(stencil.base[l], field.of(l), stencil.weights(l), stencil.slopes(l));
        }
        scatter.flush();
    }

    void update_nodes(Index s) {
        const auto sum_at = [&](Index n) { return summed(frame_, box_.nodes(), n); };
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = sum_at(n);
            if (frame_.keep_grids) write(frame_.momentum + 4 * (s * box_.nodes() + n), p);
            write(frame_.velocity + 4 * n, node_velocity(frame_, p, kind_now(frame_, n, p, sum_at)));
        }
    }

    template <bool ADJOINT>
    MomentBlock<ADJOINT, S> gathered(const S* grid, const Stencil<S>& stencil, Index p) const {
        MomentBlock<ADJOINT, S> moments;
        for (int l = 0; l < lanes_from(p); l++)
            moments.set(l, gather<ADJOINT>(grid + 4 * Index(stencil.base[l]), box_, stencil.weights(l), stencil.slopes(l)));
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
            F = F + (frame_.dt / frame_.cell) * (moments.gradient() * F);
            if constexpr (Material::flows) F = material_.flow(int(p), F);
            for (int d = 0; d < 3; d++) put(next, X + d, p, x.v[d] + frame_.dt * v.v[d]);
            put(next, VELOCITY, p, v);
            put(next, DEFORMATION, p, F);
            put(next, AFFINE, p, C);
            if constexpr (TERMS) laws_.average_rate(p, rate(now), C, rate(next));
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

    void check_state() {
        const S* end = state(frame_.keep_states ? frame_.substeps : 0);
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> x = vector(end, X, p);
            fails(frame_.substeps, p, Stencil<S>(x.v, box_), x, vector(end, VELOCITY, p), matrix(end, DEFORMATION, p));
        }
    }

    // --- adjoint
    // ------------------------------------------------------------------------------------------------------

    auto kept_of(Index s) const {
        return [grid = frame_.momentum + 4 * s * box_.nodes()](Index n) { return read<Node<S>>(grid + 4 * n); };
    }

    void velocities_of_kept(Index s) {
        const auto kept_at = kept_of(s);
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = kept_at(n);
            write(frame_.velocity + 4 * n, node_velocity(frame_, p, kind_now(frame_, n, p, kept_at)));
        }
    }

    void scatter_velocity_bar(Index s) {
        const S* now = state(s);
        S* bar = frame_.adjoint;
        clear_scratch();
        Scatter<S> scatter(scratch_, box_);
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> x = vector(now, X, p);
            Mat3<V> F = matrix(now, DEFORMATION, p), F_bar = matrix(bar, DEFORMATION, p), C_bar = matrix(bar, AFFINE, p);
            if constexpr (TERMS) C_bar = laws_.average_rate_adjoint(p, C_bar, rate(bar));
            Stencil<S> stencil(x.v, box_);
            const auto moments = gathered<true>(frame_.velocity, stencil, p);
            Mat3<V> step = (frame_.dt / frame_.cell) * moments.gradient();
            if constexpr (Material::flows) F_bar = material_.flow_adjoint(int(p), F + step * F, F_bar);
            Vec3<V> q;
            for (int d = 0; d < 3; d++) q.v[d] = row(bar, VELOCITY + d, p) + frame_.dt * row(bar, X + d, p);
            const FieldBlock<S> field(q, V{}, (1 / frame_.cell) * C_bar,
                                      (frame_.dt / frame_.cell) * (F_bar * transpose(F)), stencil);
            for (int l = 0; l < lanes_from(p); l++)
                scatter.add(stencil.base[l], field.of(l), stencil.weights(l), stencil.slopes(l));
            add_position_bar(p, moments.slope(field, stencil));
            put(bar, DEFORMATION, p, F_bar + transpose(step) * F_bar);
        }
        scatter.flush();
    }

    // slope: per cell.
    void add_position_bar(Index p, const Vec3<V>& slope) {
        for (int d = 0; d < 3; d++)
            put(frame_.adjoint, X + d, p, row(frame_.adjoint, X + d, p) + slope[d] * (1 / frame_.cell));
    }

    void update_nodes_adjoint(Index s) {
        const auto kept_at = kept_of(s);
        FrictionBar<S> friction_bar = {};
        Node<S> gravity_bar = {};
        for (Index n = first_node_; n < last_node_; n++) {
            Node<S> p = kept_at(n);
            Node<S> b = summed(frame_, box_.nodes(), n);
            Node<S> p_bar = node_adjoint(frame_, p, kind_now(frame_, n, p, kept_at), b, friction_bar);
            write(frame_.node_bar + 4 * n, p_bar);
            // gravity acts on the velocity as momentum / mass does, dt times
            if constexpr (TERMS) gravity_bar += (frame_.dt * p[3]) * p_bar;
        }
        sums()[FRICTION_SUM] += friction_bar.dynamic;
        if constexpr (TERMS)
            for (int d = 0; d < 3; d++) {
                sums()[GRAVITY_SUM + d] += gravity_bar[d];
                sums()[NUMBERS_SUM + FRICTION_SHAPE + d] += friction_bar.law[d];
            }
    }

    void gather_momentum_bar(Index s) {
        const S *now = state(s), *mass = frame_.constants + MASS * frame_.stride;
        S* bar = frame_.adjoint;
        apply_forces(s, now);
        for (Index p = first_; p < last_; p += LANES) {
            Vec3<V> x = vector(now, X, p), momentum = pushed_momentum(p, now);
            Mat3<V> F = matrix(now, DEFORMATION, p);
            auto stress = material_.stress(int(p), F);
            Mat3<V> C = matrix(now, AFFINE, p);
            Stencil<S> stencil(x.v, box_);
            V m = load(mass + p), volume = row(frame_.constants, VOLUME, p);
            const auto moments = gathered<true>(frame_.node_bar, stencil, p);
            Vec3<V> q_bar = moments.value();
            Mat3<V> apic_bar = moments.offset_moments(stencil);
            const auto field = momentum_field(p, momentum, C, all_stress(p, stress, F, now), stencil);
            add_position_bar(p, moments.slope(field, stencil));
            for (int d = 0; d < 3; d++) put(bar, VELOCITY + d, p, m * q_bar.v[d]);
            put(bar, AFFINE, p, (m * (frame_.cell / 4)) * apic_bar);
            Mat3<V> F_bar = matrix(bar, DEFORMATION, p);
            Mat3<V> tau_bar = (volume * (-frame_.dt / frame_.cell)) * moments.gradient();
            material_.stress_adjoint(int(p), stress, F, tau_bar, F_bar);
            if constexpr (TERMS) laws_.stress_adjoint(p, F, rate(now), tau_bar, F_bar, rate(bar));
            put(bar, DEFORMATION, p, F_bar);
            if constexpr (TERMS) inputs_adjoint(p, vector(now, VELOCITY, p), C, q_bar, moments.fourth_value(), apic_bar);
        }
        S* controllers_bar = frame_.controllers_bar + 6 * thread_ * frame_.controller_points;
        grip_forces_adjoint<TERMS>(frame_, s, now, mass, first_, last_, sums(), controllers_bar);
        if (TERMS && laws_.has_forces())
            laws_.forces_adjoint(now + X * frame_.stride, now + VELOCITY * frame_.stride, mass, bar + X * frame_.stride,
                                 bar + VELOCITY * frame_.stride, input_bars() + MASS_BAR * frame_.stride);
    }

    // Adjoints of mass and force in m v + dt f, m and the affine momentum, from those of the three.
    void inputs_adjoint(Index p, const Vec3<V>& v, const Mat3<V>& C, const Vec3<V>& q_bar, V carried_bar,
                        const Mat3<V>& apic_bar) {
        S* bars = input_bars();
        put(bars, MASS_BAR, p, row(bars, MASS_BAR, p) + carried_bar + dot(v, q_bar) + (frame_.cell / 4) * dot(C, apic_bar));
        for (int d = 0; d < 3; d++) {
            V force_bar = frame_.dt * q_bar[d];
            put(frame_.force_bar, d, p, force_bar);
            put(bars, FORCE_BAR + d, p, row(bars, FORCE_BAR + d, p) + force_bar);
        }
    }
};

template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void forward_frame(unsigned long long frame, int thread) {
    Worker<S, TERMS, Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>(
        *reinterpret_cast<const Frame<S>*>(frame), thread)
        .forward();
}

template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void backward_frame(unsigned long long frame, int thread) {
    Worker<S, TERMS, Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>>(
        *reinterpret_cast<const Frame<S>*>(frame), thread)
        .backward();
}

// Bytes of a frame, and numbers of workspace that a thread needs.
template <class S, bool TERMS, template <class> class Elastic, class Plastic, class ElasticNetwork,
          class PlasticNetwork>
inline void measure_frame(Index* sizes) {
    sizes[0] = sizeof(Frame<S>);
    sizes[1] = Material<S, Elastic, Plastic, ElasticNetwork, PlasticNetwork>::workspace_size;
}

}  // namespace physreal
