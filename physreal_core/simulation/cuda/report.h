// What the host learns of a frame with one copy, nine integers a rollout: first failure outside the grid and first one
// not finite, each substep x N + particle, and then the largest values of -x, -y, -z, x, y, z over all particles, now
// and where their velocities take them within a frame [m], and the largest speed [m/s], as the bits of double in an
// order that integers keep.
#pragma once
#include "number.h"

namespace physreal {

constexpr int REPORT_COLUMNS = 9, REPORT_FAILURES = 2, OUTSIDE = 0, NOT_FINITE = 1;
constexpr Index NOT_FAILED = 0x7fffffffffffffffLL, LEAST = -NOT_FAILED;

// Of a column at the frame's start.
inline Index empty_report(int column) { return column % REPORT_COLUMNS < REPORT_FAILURES ? NOT_FAILED : LEAST; }

inline void lower_to(Index* entry, Index key) {
#if defined(__CUDA_ARCH__)
    atomicMin(entry, key);
#else
    if (key < *entry) *entry = key;
#endif
}

// The entry becomes `value` if it is larger or not a number; neighbours in a warp decide among themselves first.
inline void raise_to(Index* entry, int rollout, double value) {
    union {
        double number;
        Index bits;
    } word;
    word.number = value;
    Index key = word.bits < 0 ? word.bits ^ NOT_FAILED : word.bits;
    if (value != value) key = NOT_FAILED;
#if defined(__CUDA_ARCH__)
    const unsigned mask = __activemask();
    int same = 0;
    __match_all_sync(mask, rollout, &same);
    if (mask == 0xffffffffu && same) {
        for (int step = 16; step > 0; step /= 2) {
            const Index other = __shfl_xor_sync(mask, key, step);
            if (other > key) key = other;
        }
        if (threadIdx.x & 31) return;
    }
    atomicMax(entry, key);
#else
    if (key > *entry) *entry = key;
#endif
}

}  // namespace physreal
