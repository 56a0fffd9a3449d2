// Adding particles' shares to grid nodes on a GPU: neighbours in a warp that share nodes add up first, 16 bytes at a
// time.
//
// From sm_90 on, one `red.v4.f32` moves a node's four numbers; four scalar atomics would be four times the traffic that
// limits a transfer. Threads of up to 8 consecutive particles with the same base node sum by shuffles, and one of them
// writes. On other cards, in double precision and on the CPU every particle adds its own shares.
#pragma once
#include "vec4.h"

namespace physreal {

// to += value, from many threads.
template <class S>
inline void add_atomically(S* to, S value) {
#if defined(__CUDA_ARCH__)
    atomicAdd(to, value);
#else
    *to += value;
#endif
}

// The threads that scatter together; all of them make the same calls until the last `add`.
template <class S>
class Adder {
public:
    explicit Adder(int) {}

    void add(Vec4<S>* node, const Vec4<S>& value) const {
        for (int i = 0; i < 4; ++i) add_atomically(&(*node)[i], value[i]);
    }
};

#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
template <>
class Adder<float> {
    unsigned mask_;
    int following_;  // lanes after this one that hold the same base node without a gap
    bool head_;      // the first of them

public:
    explicit Adder(int base) : mask_(__activemask()) {
        const int lane = threadIdx.x & 31;
        const int before = __shfl_up_sync(mask_, base, 1);
        const bool known = lane > 0 && (mask_ >> (lane - 1) & 1u);
        head_ = (lane & 7) == 0 || !known || before != base;
        const unsigned heads = __ballot_sync(mask_, head_) | ~mask_;
        const unsigned after = lane == 31 ? 0u : heads >> (lane + 1);
        following_ = after == 0u ? 31 - lane : __ffs(after) - 1;
    }

    void add(Vec4<float>* node, const Vec4<float>& value) const {
        float a = value[0], b = value[1], c = value[2], d = value[3];
#pragma unroll
        for (int step = 1; step < 8; step *= 2) {
            const float a1 = __shfl_down_sync(mask_, a, step), b1 = __shfl_down_sync(mask_, b, step);
            const float c1 = __shfl_down_sync(mask_, c, step), d1 = __shfl_down_sync(mask_, d, step);
            if (step <= following_) a += a1, b += b1, c += c1, d += d1;
        }
        if (head_)
            asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};" ::"l"(__cvta_generic_to_global(node)), "f"(a),
                         "f"(b), "f"(c), "f"(d)
                         : "memory");
    }
};
#endif

}  // namespace physreal
