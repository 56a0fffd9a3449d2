// An optional law of particles is a class with the bit TERM and, for a force, `force(at)` and `adjoint(at, f_bar)`, for
// a stress, `stress(at, F)` and `adjoint(at, F, tau_bar, F_bar)`, tau_bar symmetric. `at` is one particle, or a block
// of lanes: it gives `x()`, `v()`, `mass()`, `rate()` (the mean rate of deformation), `value(row::name)` and
// `vector(row::name)` of the particle's own parameters, `number(number::name)` of what all share; and it takes adjoints
// by `add_x`, `add_v`, `add_mass`, `add_rate`, `add(row::name, ...)` and `add_number(number::name, ...)`.
#pragma once
#include "matrix.h"

namespace physreal {

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
