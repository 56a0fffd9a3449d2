// Adding all particles' shares of a few numbers that they have in common, such as the gradient of a network's weights.
//
// On a GPU the 32 threads of a warp first sum among themselves: in each step two threads exchange half of what they
// hold, so that N numbers cost about N shuffles and end in as many threads, which add them to neighbouring addresses at
// once. It pays where neighbouring particles add to the same row.
#pragma once

namespace physreal {

// to[i] += value[i] for i below COUNT.
template <int COUNT, class S>
inline void add_shared(S* to, const S (&value)[COUNT]) {
#if defined(__CUDA_ARCH__)
    const unsigned all = 0xffffffffu;
    if (__activemask() == all && __match_any_sync(all, (unsigned long long)to) == all) {
        S part[COUNT];
        for (int i = 0; i < COUNT; ++i) part[i] = value[i];
        int lane = threadIdx.x & 31, first = 0, held = COUNT;
        bool writes = true;
#pragma unroll
        for (int step = 16; step > 0; step /= 2) {
            const bool upper = lane & step;
            if (held % 2 == 0) {
                held /= 2;
#pragma unroll
                for (int i = 0; i < held; ++i) {
                    const S given = upper ? part[i] : part[i + held], kept = upper ? part[i + held] : part[i];
                    part[i] = kept + __shfl_xor_sync(all, given, step);
                }
                first += upper ? held : 0;
            } else {
#pragma unroll
                for (int i = 0; i < held; ++i) part[i] += __shfl_xor_sync(all, part[i], step);
                writes = writes && !upper;
            }
        }
        if (writes)
            for (int i = 0; i < held; ++i) atomicAdd(to + first + i, part[i]);
    } else {
        for (int i = 0; i < COUNT; ++i) atomicAdd(to + i, value[i]);
    }
#else
    for (int i = 0; i < COUNT; ++i) to[i] += value[i];
#endif
}

}  // namespace physreal
