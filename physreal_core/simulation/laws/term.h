// An optional law of particles is a class with the bit TERM and, for a force, `force(at)` and `adjoint(at, f_bar)`, for
// a stress, `stress(at, F)` and `adjoint(at, F, tau_bar, F_bar)`, tau_bar symmetric. `at` is one particle, or a block
// of lanes: it gives `x()`, `v()`, `mass()`, `rate()` (the mean rate of deformation), `value(row::name)` and
// `vector(row::name)` of the particle's own parameters, `number(number::name)` of what all share, `solids()`, the distance from them, `branch(TERM, k)`, the
// state of a term's Maxwell branch; and it takes adjoints by `add_x`, `add_v`, `add_mass`, `add_rate`,
// `add(row::name, ...)`, `add_number(number::name, ...)` and `add_branch(TERM, k, ...)`.
#pragma once
#include "matrix.h"

namespace physreal {

// Branches in a particle's state before those of a term: bits are in the order of the terms.
constexpr int branches_before(Index in_use, Index term) { return branches_of(in_use & (term - 1)); }

template <class... Law>
struct TermList {
    static constexpr Index TERMS = (Index(0) | ... | Law::TERM);

    // Calls use(Law()) for those whose bit is set.
    template <class Use>
    static void each(Index in_use, Use use) {
        ((in_use & Law::TERM ? use(Law()) : void()), ...);
    }
};

}  // namespace physreal
