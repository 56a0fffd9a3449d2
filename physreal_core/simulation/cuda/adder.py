"""Adding particles' shares to grid nodes on a GPU: neighbours in a warp that share nodes add up first, 16 bytes at a time.

From sm_90 on, one `red.v4.f32` moves a node's (momentum, mass); Warp's vector atomics are four scalar ones, four times
the traffic that limits a transfer. Threads of up to 8 consecutive particles with the same base node sum by shuffles, and
one of them writes. On other cards, in float64 and on the CPU every particle adds its own shares.
"""

import functools

import warp as wp

from physreal_core.simulation.plain.transfer_functions import Adder, single_adder


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    return (int)__activemask();
#else
    return 0;
#endif
""")
def active_lanes() -> int:
    """Mask of the threads that scatter together; all of them make the same calls until the last `add`."""


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    unsigned mask = unsigned(lanes);
    int lane = threadIdx.x & 31;
    int before = __shfl_up_sync(mask, key, 1);
    bool known = lane > 0 && (mask >> (lane - 1) & 1u);
    bool head = (lane & 7) == 0 || !known || before != key;
    unsigned heads = __ballot_sync(mask, head) | ~mask;
    unsigned after = lane == 31 ? 0u : heads >> (lane + 1);
    int following = after == 0u ? 31 - lane : __ffs(after) - 1;
    return head ? following : -1 - following;
#else
    return 0;
#endif
""")
def lane_run(key: int, lanes: int) -> int:
    """How many lanes after this one hold the same key without a gap; -1 minus that, unless this lane is the first."""


@wp.func_native("""
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
    unsigned mask = unsigned(lanes);
    int following = run < 0 ? -1 - run : run;
    float a = value[0], b = value[1], c = value[2], d = value[3];
    #pragma unroll
    for (int step = 1; step < 8; step *= 2) {
        float a1 = __shfl_down_sync(mask, a, step), b1 = __shfl_down_sync(mask, b, step);
        float c1 = __shfl_down_sync(mask, c, step), d1 = __shfl_down_sync(mask, d, step);
        if (step <= following) { a += a1; b += b1; c += c1; d += d1; }
    }
    if (run >= 0)
        asm volatile("red.global.add.v4.f32 [%0], {%1, %2, %3, %4};"
            :: "l"(__cvta_generic_to_global(grid.data + n)), "f"(a), "f"(b), "f"(c), "f"(d) : "memory");
#elif defined(__CUDA_ARCH__)
    for (int i = 0; i < 4; ++i) atomicAdd(reinterpret_cast<float*>(grid.data + n) + i, value[i]);
#else
    for (int i = 0; i < 4; ++i) grid.data[n][i] += value[i];
#endif
""")
def add_rows(grid: wp.array(dtype=wp.vec4f), n: int, value: wp.vec4f, lanes: int, run: int):
    """grid[n] += value for contiguous rows of four floats."""


@functools.cache
def lane_adder(dtype: str) -> Adder:
    """Neighbouring lanes together in float32, every particle for itself in float64."""
    return Adder(active_lanes, lane_run, add_rows) if dtype == "float32" else single_adder(dtype)
