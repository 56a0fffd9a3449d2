// Code for a block of threads that runs on CUDA and, for the tests, on the CPU, where a block's threads take turns.
#pragma once

namespace physreal {

constexpr int WARP = 32;

#if defined(__CUDA_ARCH__)
#define BLOCK_SHARED __shared__
template <int Threads> constexpr int OWN = 1;  // threads whose state one thread of the machine keeps

// visit(thread, place of its state)
template <int Threads, class Visit> inline void each_thread(Visit&& visit) { visit(int(threadIdx.x), 0); }
inline void barrier() { __syncthreads(); }
inline bool any_of_block(bool mine) { return __syncthreads_or(mine); }
inline bool any_of_warp(bool mine) { return __any_sync(0xffffffffu, mine); }
#else
#define BLOCK_SHARED
template <int Threads> constexpr int OWN = Threads;

template <int Threads, class Visit> inline void each_thread(Visit&& visit) {
  for (int thread = 0; thread < Threads; ++thread) visit(thread, thread);
}
inline void barrier() {}
inline bool any_of_block(bool mine) { return mine; }
inline bool any_of_warp(bool mine) { return mine; }
#endif

#if defined(__CUDA_ARCH__)
// Hands half of the first 2 * Half values to a partner and takes the other half over, and so on until one is left.
template <int Half, class S> inline void exchange(S (&values)[16], int lane) {
  const bool upper = lane & (2 * Half);
#pragma unroll
  for (int i = 0; i < Half; ++i) {
    const S given = upper ? values[i] : values[i + Half], kept = upper ? values[i + Half] : values[i];
    values[i] = kept + __shfl_xor_sync(0xffffffffu, given, 2 * Half);
  }
  if constexpr (Half > 1) exchange<Half / 2>(values, lane);
}
#endif

// target[i] += the warp's sum of values[i], for the first Used of 16. All threads of the warp must come.
template <int Used, class S> inline void add_over_warp(S* target, S (&values)[16]) {
#if defined(__CUDA_ARCH__)
  const int lane = threadIdx.x % WARP;
  exchange<8>(values, lane);  // 16 exchanges, where a sum of its own for each value would take 5 a value
  const S sum = values[0] + __shfl_xor_sync(0xffffffffu, values[0], 1);
  if (lane % 2 == 0 && lane / 2 < Used) atomicAdd(target + lane / 2, sum);
#else
  for (int i = 0; i < Used; ++i) target[i] += values[i];
#endif
}

}  // namespace physreal
