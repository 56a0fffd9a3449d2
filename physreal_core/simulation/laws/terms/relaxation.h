// Relaxation: one Maxwell branch, with the elastic law a standard linear solid (Zener's).
#pragma once
#include "maxwell_branches.h"

namespace physreal {

struct Relaxation : MaxwellBranches<term::relaxation, row::relaxation_modulus, number::relaxation_time> {};

}  // namespace physreal
