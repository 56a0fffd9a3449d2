// The step of thin bodies in all rollouts at once: elements leave forces at their corners, and vertices, which are particles and nodes
// at once, add up what was left at them and move.
//
// Two launches a substep, one thread for each element and one for each vertex. A vertex adds up in the order of its incidence list and
// there are no atomics, so that a rerun gives the same bytes, wherever in a batch a rollout stands. Slots count from the frame's
// first one, as everywhere (forces.h). Where the body touches itself, pairs leave their forces before the vertices move (contacts.h).
#pragma once
#include "contacts.h"
#include "elements.h"
#include "forces.h"
#include "phase.h"
#include "thin_residual.h"
#include "surface_drag.h"

namespace physreal {

// TERMS: bits of the optional laws in use; Element: see elements.h.
template <class S, Index TERMS, template <class, class> class Element>
class ElementOfRollout {
    using Elastic = Element<S, S>;
    using Drag = SurfaceDrag<S, Elastic::FACE>;
    static constexpr int CORNERS = Elastic::CORNERS, CONSTANTS = Elastic::CONSTANTS, STIFFNESS = Elastic::STIFFNESS;
    using Residual = ThinResidual<Element, S>;
    static constexpr bool VISCOUS = TERMS & term::viscosity, DRAGGED = TERMS & term::surface_drag;
    static constexpr bool CORRECTED = TERMS & term::thin_residual;
    // The numbers of an element: its stiffness, with viscosity as many of that, with drag its coefficients, and those of a residual.
    static constexpr int VISCOSITY = STIFFNESS, DRAG = VISCOUS ? 2 * STIFFNESS : STIFFNESS;
    static constexpr int RESIDUAL = DRAG + (DRAGGED ? Drag::ROWS : 0);
    static constexpr int ROWS = RESIDUAL + (CORRECTED ? Residual::ROWS : 0);
    using Corners = Vec3<S>[CORNERS];
    const ThinFrame<S>& f_;
    const int own_, rollout_;  // number in its rollout, and the rollout
    S constants_[CONSTANTS], stiffness_[STIFFNESS];

public:
    ElementOfRollout(const ThinFrame<S>& f, int thread)
        : f_(f), own_(thread % int(f.element_stride)), rollout_(thread / int(f.element_stride)) {
        UNROLLED for (int r = 0; r < CONSTANTS; ++r) constants_[r] = f.element_constants[r * f.element_stride + own_];
        numbers(0, stiffness_);
    }

    // Leaves the forces of the state in a slot.
    void forward(int slot) const {
        Vec3<S> x[CORNERS], force[CORNERS] = {};
        at_corners(f_.x, slot, x);
        if constexpr (CORRECTED) {
            S coefficients[Residual::ROWS], scaled[STIFFNESS];
            numbers(RESIDUAL, coefficients);
            Residual(x, constants_, coefficients, f_.beta_elastic).scale(stiffness_, scaled);
            add_elastic(scaled, slot, x, force);
        } else {
            add_elastic(stiffness_, slot, x, force);
        }
        if constexpr (DRAGGED) {
            S coefficients[Drag::ROWS];
            numbers(DRAG, coefficients);
            Vec3<S> v[CORNERS];
            at_corners(f_.v, slot, v);
            Drag::forces(coefficients, x, v, force);
        }
        leave(f_.element_force, force);
    }

    // Leaves what the forces' adjoint, which stands in node_bar, adds to those of the places, the velocities and their means.
    void backward(int slot) const {
        Vec3<S> x[CORNERS], along[CORNERS], x_bar[CORNERS] = {};
        at_corners(f_.x, slot, x);
        if (!(x[0][0] - x[0][0] == 0)) return;  // of a rollout that has failed
        UNROLLED for (int c = 0; c < CORNERS; ++c)
            along[c] = three(reinterpret_cast<const Vec4<S>*>(f_.node_bar)[vertex(c)]);
        S bar[STIFFNESS] = {};
        if constexpr (CORRECTED) {
            S coefficients[Residual::ROWS], coefficients_bar[Residual::ROWS] = {}, scaled[STIFFNESS];
            numbers(RESIDUAL, coefficients);
            const Residual residual(x, constants_, coefficients, f_.beta_elastic);
            residual.scale(stiffness_, scaled);
            add_elastic_adjoint(scaled, slot, x, along, x_bar, bar);
            residual.adjoint(stiffness_, coefficients, bar, x_bar, coefficients_bar);
            add(RESIDUAL, coefficients_bar);
        } else {
            add_elastic_adjoint(stiffness_, slot, x, along, x_bar, bar);
        }
        if constexpr (DRAGGED) {
            S coefficients[Drag::ROWS], drag_bar[Drag::ROWS] = {};
            numbers(DRAG, coefficients);
            Vec3<S> v[CORNERS], v_bar[CORNERS] = {};
            at_corners(f_.v, slot, v);
            Drag::adjoint(coefficients, x, v, along, x_bar, v_bar, drag_bar);
            add(DRAG, drag_bar);
            leave(f_.element_velocity, v_bar);
        }
        add(0, bar);
        leave(f_.element_force, x_bar);
    }

private:
    // With viscosity where there is one.
    void add_elastic(const S (&stiffness)[STIFFNESS], int slot, const Corners& x, Corners& force) const {
        if constexpr (VISCOUS) {
            S viscosity[STIFFNESS];
            numbers(VISCOSITY, viscosity);
            Vec3<S> mean[CORNERS];
            at_corners(f_.mean_velocity, slot, mean);
            ViscousForces<Element, S>{constants_, stiffness, viscosity}.forces(x, mean, force);
        } else {
            ElasticForces<Element, S>{constants_, stiffness}.forces(x, force);
        }
    }
    void add_elastic_adjoint(const S (&stiffness)[STIFFNESS], int slot, const Corners& x, const Corners& along,
                             Corners& x_bar, S (&bar)[STIFFNESS]) const {
        if constexpr (VISCOUS) {
            S viscosity[STIFFNESS], viscosity_bar[STIFFNESS] = {};
            numbers(VISCOSITY, viscosity);
            Vec3<S> mean[CORNERS], mean_bar[CORNERS] = {};
            at_corners(f_.mean_velocity, slot, mean);
            const ViscousForces<Element, S> forces{constants_, stiffness, viscosity};
            forces.adjoint(x, mean, along, x_bar, mean_bar, bar, viscosity_bar);
            add(VISCOSITY, viscosity_bar);
            leave(f_.element_mean, mean_bar);
        } else {
            ElasticForces<Element, S>{constants_, stiffness}.adjoint(x, along, x_bar, bar);
        }
    }
    Index number_place(int r) const { return (Index(rollout_) * ROWS + r) * f_.element_stride + own_; }
    // The element's numbers from a row on.
    template <int COUNT>
    void numbers(int row, S (&values)[COUNT]) const {
        UNROLLED for (int r = 0; r < COUNT; ++r) values[r] = f_.element_stiffness[number_place(row + r)];
    }
    template <int COUNT>
    void add(int row, const S (&bars)[COUNT]) const {
        UNROLLED for (int r = 0; r < COUNT; ++r) f_.element_bars[number_place(row + r)] += bars[r];
    }
    Index vertex(int corner) const {
        return Index(rollout_) * f_.particles + f_.corners[corner * f_.element_stride + own_];
    }
    void at_corners(const S* states, int slot, Corners& values) const {
        UNROLLED for (int c = 0; c < CORNERS; ++c) {
            const S* from = states + 3 * (Index(f_.first[0] + slot) * f_.stride + vertex(c));
            values[c] = {{from[0], from[1], from[2]}};
        }
    }
    void leave(S* to, const Corners& values) const {
        UNROLLED for (int c = 0; c < CORNERS; ++c)
            reinterpret_cast<Vec4<S>*>(to)[(Index(rollout_) * CORNERS + c) * f_.element_stride + own_] = {
                {values[c][0], values[c][1], values[c][2], 0}};
    }
};

// INPUTS, TERMS, HAND, LED: as of ParticleForces; TOUCHES: whether the body touches itself; CORNERS: of an element.
template <class S, bool INPUTS, Index TERMS, int HAND, bool LED, bool TOUCHES, int CORNERS>
class VertexOfRollout : ParticleForces<S, INPUTS, TERMS, HAND, LED> {
    using Forces = ParticleForces<S, INPUTS, TERMS, HAND, LED>;
    using typename Forces::At;
    static constexpr bool VISCOUS = TERMS & term::viscosity, DRAGGED = TERMS & term::surface_drag;
    using Forces::add_inputs, Forces::constant, Forces::dt_, Forces::fail, Forces::finite, Forces::force,
        Forces::force_adjoint, Forces::get3, Forces::own_, Forces::p_, Forces::place_in, Forces::put, Forces::rollout_,
        Forces::touching, Forces::touching_adjoint;
    const ThinFrame<S>& f_;
    const NodePhase<S> phase_;

public:
    VertexOfRollout(const ThinFrame<S>& f, int thread)
        : Forces(f, thread / int(f.particles), thread % int(f.particles)),
          f_(f),
          phase_(phase_of<S, TERMS>(f, rollout_)) {}

    // From the state in a slot to that of the next substep; `slot_next` is `slot` where nothing is kept.
    void forward(int substep, int slot, int slot_next, int last) const {
        const Index now = place_in(slot), after = place_in(slot_next);
        const At at = at_state(now);
        Vec3<S> f = force(substep, at) + left(f_.element_force);
        if constexpr (TOUCHES) f = f + sums().take_force(p_);
        const Vec4<S> push = {{dt_ * f[0], dt_ * f[1], dt_ * f[2], constant(constant::volume) * touching(at.x_[2])}};
        const Vec4<S> free = phase_.free(velocity(at), push, around());
        if (!finite(dot(at.x_, at.x_) + dot(three(free), three(free)))) fail(substep);
        if (slot_next != slot) free_in(now) = free;
        const Vec3<S> v = three(phase_.velocity(free, around())), x = at.x_ + dt_ * v;
        put(f_.v, after, v);
        put(f_.x, after, x);
        if constexpr (TOUCHES) sums().follow(p_, x);
        if constexpr (VISCOUS)
            put(f_.mean_velocity, after, remembered() * get3(f_.mean_velocity, now) + (1 - remembered()) * v);
        if (last && !finite(dot(x, x) + dot(v, v))) fail(substep + 1);
    }

    // The state's adjoint goes from after a substep, whose number is that of its slot, to before it, but for what the elements add to
    // that of x; in node_bar the adjoint of the forces. arrived: whether elements have left theirs of the substep after.
    void backward(int slot, int arrived) const {
        const Index now = place_in(slot);
        if (!finite(f_.x[3 * now])) return;  // of a rollout that has failed
        At at = at_state(now);
        if (arrived) add_left(slot + 1);
        Vec3<S> x_bar = get3(f_.x_bar, p_), v_bar = get3(f_.v_bar, p_) + dt_ * x_bar;
        if constexpr (VISCOUS) {
            const Vec3<S> mean_bar = get3(f_.mean_velocity_bar, p_);
            v_bar = v_bar + (1 - remembered()) * mean_bar;
            put(f_.mean_velocity_bar, p_, remembered() * mean_bar);
        }
        FrictionBar<S> friction_bar = {};
        const auto found = phase_.adjoint(velocity(at), free_in(now), around(), {{v_bar[0], v_bar[1], v_bar[2], 0}},
                                          friction_bar);
        const Vec4<S>& bar = found.free;
        const S share = around().mass > f_.mass_floor ? dt_ / around().mass : S(0);
        const Vec3<S> f_bar = share * three(bar);
        force_adjoint(slot, at, f_bar);
        x_bar[2] += touching_adjoint(at.x_[2], bar[3]);
        put(f_.x_bar, p_, x_bar + at.x_bar);
        put(f_.v_bar, p_, three(bar) + at.v_bar);
        reinterpret_cast<Vec4<S>*>(f_.node_bar)[p_] = {{f_bar[0], f_bar[1], f_bar[2], 0}};
        if constexpr (TOUCHES) sums().keep(p_, slot, f_bar);
        add_inputs(found.mass + at.mass_bar, f_bar);
        add_node_sums<INPUTS, TERMS>(f_, p_, friction_bar, bar);
    }

    // Adds what the elements of the frame's first substep have left.
    void settle() const {
        if (finite(f_.x[3 * place_in(0)])) add_left(0);
    }

private:
    At at_state(Index now) const { return {*this, now, get3(f_.x, now), get3(f_.v, now), {}}; }
    static Vec4<S> velocity(const At& at) { return {{at.v_[0], at.v_[1], at.v_[2], 0}}; }
    Around<S> around() const { return {f_.around[2 * p_], f_.around[2 * p_ + 1]}; }
    Vec4<S>& free_in(Index place) const { return reinterpret_cast<Vec4<S>*>(f_.free)[place]; }

    // Share of the mean velocity that a substep keeps.
    S remembered() const { return f_.timing[3]; }

    ContactSums<S> sums() const { return {f_, rollout_}; }

    // Adds what the elements and contact left of the substep in a slot to the adjoints of the state before it.
    void add_left(int slot) const {
        put(f_.x_bar, p_, get3(f_.x_bar, p_) + left(f_.element_force));
        if constexpr (VISCOUS) put(f_.mean_velocity_bar, p_, get3(f_.mean_velocity_bar, p_) + left(f_.element_mean));
        if constexpr (DRAGGED) put(f_.v_bar, p_, get3(f_.v_bar, p_) + left(f_.element_velocity));
        if constexpr (TOUCHES) {
            Vec3<S> x_bar = get3(f_.x_bar, p_), v_bar = get3(f_.v_bar, p_);
            sums().add_bars(p_, own_, slot, x_bar, v_bar);
            put(f_.x_bar, p_, x_bar);
            put(f_.v_bar, p_, v_bar);
        }
    }

    // What elements left at the vertex.
    Vec3<S> left(const S* from) const {
        const Vec4<S>* of_rollout = reinterpret_cast<const Vec4<S>*>(from) + Index(rollout_) * CORNERS * f_.element_stride;
        const int end = f_.incident_first[own_ + 1];
        Vec4<S> sum = {};
        FOUR_AT_A_TIME for (int i = f_.incident_first[own_]; i < end; ++i) sum += of_rollout[f_.incident[i]];
        return three(sum);
    }
};

// The entry points: one element or one vertex of all rollouts.
template <class S, bool INPUTS, Index TERMS, int HAND, bool LED, bool TOUCHES, template <class, class> class Element>
struct ThinStep : ContactStep<S, Element<S, S>::FACE, false> {
    using Vertex = VertexOfRollout<S, INPUTS, TERMS, HAND, LED, TOUCHES, Element<S, S>::CORNERS>;
    using Body = ElementOfRollout<S, TERMS, Element>;

    static void start(const ThinFrame<S>& f, int rollout) { f.report[rollout] = NOT_FAILED; }
    static void elements(const ThinFrame<S>& f, int thread, int slot) { Body(f, thread).forward(slot); }
    static void vertices(const ThinFrame<S>& f, int thread, int substep, int slot, int slot_next, int last) {
        Vertex(f, thread).forward(substep, slot, slot_next, last);
    }

    static void vertices_adjoint(const ThinFrame<S>& f, int thread, int slot, int arrived) {
        Vertex(f, thread).backward(slot, arrived);
    }
    static void elements_adjoint(const ThinFrame<S>& f, int thread, int slot) { Body(f, thread).backward(slot); }
    static void settle(const ThinFrame<S>& f, int thread) { Vertex(f, thread).settle(); }
};

}  // namespace physreal
