// The functions of lanes.h on arrays whose length is a multiple of 16.
#pragma once
#include "lanes.h"

namespace physreal {

template <class S> void probe(const S* x, S* exps, S* powers, S* logs, S* totals, int count)
{
    for (int i = 0; i < count; i += 16) {
        const Lanes<S, 16> lanes = load<S, 16>(x + i);
        store<S, 16>(exps + i, exp(lanes));
        store<S, 16>(powers + i, exp2_between(lanes));
        store<S, 16>(logs + i, log(lanes));
        Lanes<S, 16> rows[16];
        for (int k = 0; k < 16; ++k)
            rows[k] = lanes * S(k);
        store<S, 16>(totals + i, sums<S, 16>(rows));
    }
}

}  // namespace physreal
