// The rasteriser on CUDA in phases, each for one thread of a launch: a Gaussian's, a pair's, or one of a tile's block.
#pragma once

#include "compositing.h"
#include "gaussians.h"

namespace physreal {

// On the CPU one thread stands for a whole block.
inline int block_of(int thread) {
#if defined(__CUDA_ARCH__)
  return thread / THREADS;
#else
  return thread;
#endif
}

template <class S> inline void composite_tile(const Scene<S>& s, int thread) { composite(s, block_of(thread)); }
template <class S> inline void composite_tile_adjoint(const Scene<S>& s, int thread) {
  composite_adjoint(s, block_of(thread));
}

}  // namespace physreal
