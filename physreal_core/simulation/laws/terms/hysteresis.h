// Hysteresis: three Maxwell branches, whose times together span the frequencies at which the loss is to be the same.
#pragma once
#include "maxwell_branches.h"

namespace physreal {

struct Hysteresis : MaxwellBranches<term::hysteresis, row::hysteresis_modulus, number::hysteresis_time> {};

}  // namespace physreal
