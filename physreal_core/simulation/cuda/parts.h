// Sums of particles' shares at the nodes, in an order that is always the same: a rerun gives the same bytes.
//
// A particle's nodes are those of its place at rest, so who gives to a node never changes. Particles that follow one another
// and share their nodes are a group, see parts.py. It leaves a part for each of its 27 nodes, the sum over its particles; a node
// adds up its parts in the order of the groups. No atomics, which add in whatever order they come.
#pragma once
#include "vec4.h"

namespace physreal {

// Where a particle's group leaves its parts. All particles of a warp make the same calls.
template <class S>
class Parts {
    Vec4<S>* first_;
    const Index stride_;  // from one of a group's parts to the next
    const int following_;  // particles that come after this one in its group
    const bool head_;      // the first of it
    const unsigned warp_;  // threads of it that have a particle

public:
    Parts(const Frame<S>& f, int rollout, int particle)
        : first_(reinterpret_cast<Vec4<S>*>(f.parts) + Index(rollout) * f.groups + f.group[particle]),
          stride_(f.rollouts * f.groups),
          following_(f.following[particle]),
          head_(particle == 0 || f.group[particle - 1] != f.group[particle]),
          warp_(lanes(int(f.particles) - particle / WARP * WARP)) {}

#if defined(__CUDA_ARCH__)
    void leave(int node, Vec4<S> sum) const {
#pragma unroll
        for (int step = 1; step < LARGEST_GROUP; step *= 2) {
            Vec4<S> further;
            for (int i = 0; i < 4; ++i) further[i] = __shfl_down_sync(warp_, sum[i], step);
            if (step <= following_) sum += further;
        }
        if (head_) first_[node * stride_] = sum;
    }
#else
    // One particle after the other.
    void leave(int node, const Vec4<S>& value) const {
        Vec4<S>& part = first_[node * stride_];
        part = head_ ? value : part + value;
    }
#endif

private:
    static unsigned lanes(int count) { return count >= WARP ? ~0u : (1u << count) - 1; }
};

#if defined(__CUDA_ARCH__)
constexpr int LANES = NODE_THREADS;
#else
constexpr int LANES = 1;
#endif

// The sum of the parts of node n of all, for the first of its threads; its other ones, numbered by lane, take part.
template <class S>
inline Vec4<S> gathered(const Frame<S>& f, int n, int lane) {
    const int rollout = n / int(f.nodes), own = n - rollout * int(f.nodes);
    const Vec4<S>* parts = reinterpret_cast<const Vec4<S>*>(f.parts) + Index(rollout) * f.groups;
    Vec4<S> sum = {};
    for (int e = f.parts_begin[own] + lane; e < f.parts_begin[own + 1]; e += LANES) sum += parts[f.parts_of[e]];
#if defined(__CUDA_ARCH__)
    const unsigned threads = ((1u << LANES) - 1) << (threadIdx.x % WARP / LANES * LANES);
#pragma unroll
    for (int step = LANES / 2; step > 0; step /= 2)
        for (int i = 0; i < 4; ++i) sum[i] += __shfl_down_sync(threads, sum[i], step, LANES);
#endif
    return sum;
}

}  // namespace physreal
