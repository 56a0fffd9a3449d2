// What the host learns of a frame: the first particle of each rollout that is not finite, as substep x N + particle.
#pragma once
#include "number.h"

namespace physreal {

constexpr Index NOT_FAILED = 0x7fffffffffffffffLL;

inline void lower_to(Index* entry, Index key) {
#if defined(__CUDA_ARCH__)
    atomicMin(entry, key);
#else
    if (key < *entry) *entry = key;
#endif
}

}  // namespace physreal
