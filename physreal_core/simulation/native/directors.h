// The segments of framed rods in a frame: each has a director and a spin about its tangent, which stand at its first vertex. One thread has all of
// a rollout's.
#pragma once
#include "director.h"
#include "rows.h"

namespace physreal {

template <class S>
class Directors : ParticleRows<S> {
    using V = Lanes<S>;
    using Rows = ParticleRows<S>;
    using Rows::last_, Rows::put, Rows::row_of, Rows::vector;

public:
    static constexpr int X = 0, DIRECTOR = 6, SPIN = 9;

    explicit Directors(const ThinFrame<S>& frame) : Rows(frame, 0), frame_(frame) {}

    // From the torques [stride] of the elements.
    void spin(const S* now, S* next, const S* torque) const {
        for (Index p = 0; p < last_; p += LANES)
            put(next, SPIN, p, row_of(now, SPIN, p) + frame_.dt * row_of(frame_.mobility, 0, p) * row_of(torque, 0, p));
    }

    // Once the vertices of `next` and its spins are there.
    void turn(const S* now, S* next) const {
        for (Index p = 0; p < last_; p += LANES) put(next, DIRECTOR, p, step(now, next, p).director());
    }

    // bar: of the state after the substep. Its part of directors and spins goes to before it, that of x grows by what it is after; what it is
    // before stays in `turned` [3, stride] for `add_turned`. Writes the torques' adjoint.
    void adjoint(const S* now, const S* next, S* bar, S* torque_bar, S* turned, S* mobility_bar) const {
        for (Index p = 0; p < last_; p += LANES) {
            const auto back = step(now, next, p).adjoint(vector(bar, DIRECTOR, p));
            put(bar, DIRECTOR, p, back.director);
            const V spin_bar = row_of(bar, SPIN, p) + frame_.dt * back.angle, mobility = row_of(frame_.mobility, 0, p);
            put(bar, SPIN, p, spin_bar);
            put(torque_bar, 0, p, frame_.dt * mobility * spin_bar);
            const V gained = row_of(next, SPIN, p) - row_of(now, SPIN, p);  // mobility dt torque
            const V by_mobility = select(mobility > S(0), spin_bar * gained / mobility, V{});
            put(mobility_bar, 0, p, row_of(mobility_bar, 0, p) + by_mobility);
            put(turned, 0, p, back.before);
            add_segment(bar, p, back.after);
        }
    }

    void add_turned(S* bar, const S* turned) const {
        for (Index p = 0; p < last_; p += LANES) add_segment(bar, p, vector(turned, 0, p));
    }

private:
    const ThinFrame<S>& frame_;

    V row_after(const S* rows, int r, Index p) const { return load<S, LANES>(rows + r * frame_.stride + p + 1); }
    Mask<V> begins(Index p) const { return row_of(frame_.begins, 0, p) > S(0); }

    // The segments that begin at vertices; where none does, any that is there.
    Vec3<V> segment(const S* state, Index p) const {
        Vec3<V> e;
        for (int d = 0; d < 3; d++)
            e[d] = select(begins(p), row_after(state, X + d, p) - row_of(state, X + d, p), splat<V>(S(d == 0)));
        return e;
    }

    DirectorStep<V> step(const S* now, const S* next, Index p) const {
        return {vector(now, DIRECTOR, p), frame_.dt * row_of(next, SPIN, p), segment(now, p), segment(next, p)};
    }

    void add_segment(S* bar, Index p, const Vec3<V>& value) const {
        for (int d = 0; d < 3; d++) {
            const V own = select(begins(p), value[d], V{});
            S* row = bar + (X + d) * frame_.stride + p;
            store(row, load<S, LANES>(row) - own);
            store(row + 1, load<S, LANES>(row + 1) + own);
        }
    }
};

}  // namespace physreal
