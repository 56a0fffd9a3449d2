// What the hand does to a thread's particles: the pull of bonds, the push of a tool, and their adjoint.
#pragma once
#include "grip.h"
#include "rows.h"
#include "tool.h"

namespace physreal {

template <class S>
class Hand : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Rows::first_, Rows::frame_, Rows::last_, Rows::lanes_from, Rows::put, Rows::row_of, Rows::vector;

public:
    Hand(const Frame<S>& frame, Index thread) : Rows(frame, thread), thread_(thread) {}

    // Writes `before` and the hand's forces in a substep into frame.force, where `before` stands for particles that no hand can reach.
    // x, v, before: three rows each.
    void forces(Index substep, const S* x, const S* v, const S* before) const {
        if (pushes() && before != frame_.force) {
            for (Index p = first_; p < last_; p += LANES) put(frame_.force, 0, p, vector(before, 0, p));
            before = frame_.force;
        }
        const Grip<S> bonds = grip(substep);
        for_gripped([&](Index p, Index first, Index end) {
            put_at(frame_.force, p, bonds.force(first, end, at(x, p), at(v, p), at(before, p)));
        });
        if (!pushes()) return;
        const Tool<S> pusher = tool(substep);
        for (Index p = first_; p < last_; p += LANES)
            put(frame_.force, 0, p,
                pusher.force(vector(x, 0, p), vector(v, 0, p), mass(p), reach(p), vector(frame_.force, 0, p)));
    }

    // In: frame.force_bar. Adds to the adjoints of x and v, three rows each, of the masses and of what particles share.
    void adjoint(Index substep, const S* x, const S* v, S* x_bar, S* v_bar, S* mass_bar, S* sums) const {
        const Grip<S> bonds = grip(substep);
        const auto add_point = [&](int place, int controller, int axis, S value) {
            points_bar()[3 * (place * frame_.controller_points + controller) + axis] += value;
        };
        const auto add_length = [&](Index bond, S value) {
            frame_.rest_length_bar[thread_ * frame_.bonds + bond] += value;
        };
        for_gripped([&](Index p, Index first, Index last) {
            const auto back =
                bonds.adjoint(first, last, at(x, p), at(v, p), at(frame_.force_bar, p), add_point, add_length);
            put_at(x_bar, p, at(x_bar, p) + back.x);
            put_at(v_bar, p, at(v_bar, p) + back.v);
            sums[particle_sum::grip_stiffness] += back.stiffness;
            sums[particle_sum::grip_damping] += back.damping;
        });
        if (pushes()) tool_adjoint(substep, x, v, x_bar, v_bar, mass_bar, sums);
    }

private:
    Index thread_;

    bool pushes() const { return frame_.capsules > 0; }
    S* points_bar() const { return frame_.controllers_bar + 12 * thread_ * frame_.controller_points; }
    V mass(Index p) const { return row_of(frame_.constants + constant::mass * frame_.stride, 0, p); }
    V reach(Index p) const { return row_of(frame_.constants + constant::reach * frame_.stride, 0, p); }

    Vec3<S> at(const S* rows, Index p) const {
        return {{rows[p], rows[frame_.stride + p], rows[2 * frame_.stride + p]}};
    }
    void put_at(S* rows, Index p, const Vec3<S>& value) const {
        for (int d = 0; d < 3; d++) rows[d * frame_.stride + p] = value[d];
    }

    Grip<S> grip(Index substep) const {
        const Frame<S>& f = frame_;
        return {f.grip_controller, f.grip_weight,  f.grip_rest_length, f.controllers,        f.controller_points,
                f.grip_stiffness,  f.grip_damping, f.grip_softening,   S(substep) * f.share, f.frame_rate};
    }
    Tool<S> tool(Index substep) const {
        const Frame<S>& f = frame_;
        return {f.capsule_ends,   f.capsule_radius, f.capsules,           f.controllers, f.controller_points,
                f.tool_stiffness, f.tool_friction,  S(substep) * f.share, f.frame_rate};
    }

    // Calls visit(place, first bond, last bond) for the thread's gripped particles.
    template <class Visit>
    void for_gripped(Visit visit) const {
        for (Index q = 0; q < frame_.gripped; q++) {
            const Index place = frame_.place[frame_.grip_particle[q]];
            if (place >= first_ && place < last_) visit(place, frame_.grip_first[q], frame_.grip_first[q + 1]);
        }
    }

    void tool_adjoint(Index substep, const S* x, const S* v, S* x_bar, S* v_bar, S* mass_bar, S* sums) const {
        const Tool<S> pusher = tool(substep);
        for (Index p = first_; p < last_; p += LANES) {
            const int count = lanes_from(p);
            const auto within = [&](V value) {  // what fills the last block does not count
                for (int l = count; l < LANES; l++) value[l] = 0;
                return value;
            };
            const auto add_point = [&](int place, int controller, int axis, V value) {
                points_bar()[3 * (place * frame_.controller_points + controller) + axis] += sum(within(value));
            };
            const auto back = pusher.adjoint(vector(x, 0, p), vector(v, 0, p), mass(p), reach(p),
                                             vector(frame_.force_bar, 0, p), add_point);
            put(x_bar, 0, p, vector(x_bar, 0, p) + back.x);
            put(v_bar, 0, p, vector(v_bar, 0, p) + back.v);
            if (mass_bar) put(mass_bar, 0, p, row_of(mass_bar, 0, p) + back.mass);
            sums[particle_sum::tool_stiffness] += sum(within(back.stiffness));
            sums[particle_sum::tool_friction] += sum(within(back.friction));
        }
    }
};

}  // namespace physreal
