// Optional terms of a substep: which are in use, and where their numbers stand. The twin of native/terms.py.
#pragma once
#include "lanes.h"

namespace physreal {

// Bits of Frame::terms; the order of LAWS in terms.py.
enum Term : Index {
    DRAG = 1 << 0,
    ADHESION = 1 << 1,
    OBSTACLE = 1 << 2,
    VISCOSITY = 1 << 3,
    STIFFENING = 1 << 4,
    FIBRES = 1 << 5,
    FRICTION_LAW = 1 << 6
};

// Columns of Frame::term_values and rows of the particles' constants and bars, from TERM on.
enum TermRow {
    LINEAR_DRAG,
    QUADRATIC_DRAG,
    PEAK_ADHESION,
    START_HEIGHT,  // z of the particle where the rollout starts
    SHEAR_VISCOSITY,
    VOLUME_VISCOSITY,
    STIFFENING_MODULUS,
    FIBRE_MODULUS,
    FIBRE_DIRECTION,
    TERM_ROWS = FIBRE_DIRECTION + 3
};

// Places in Frame::term_numbers, which all particles share, and in the threads' sums, after INPUT_SUMS.
enum TermNumber {
    ADHESION_RANGE,
    OBSTACLE_SHAPE,  // centre, half axis, radius, stiffness
    FRICTION_SHAPE = OBSTACLE_SHAPE + 8,
    TERM_NUMBERS = FRICTION_SHAPE + 3
};

// Rows of the bars from INPUTS on.
enum InputBar { MASS_BAR, FORCE_BAR, TERM_BAR = FORCE_BAR + 3, INPUT_BARS = TERM_BAR + TERM_ROWS };

// Adjoints in a thread's sums: friction, grip stiffness, grip damping, gravity, then those of the term numbers.
enum Sum { FRICTION_SUM, STIFFNESS_SUM, DAMPING_SUM, GRAVITY_SUM, NUMBERS_SUM = 6, SUMS = NUMBERS_SUM + TERM_NUMBERS };

}  // namespace physreal
