"""What the host learns of a frame with one copy: per rollout the first failures, where particles are and how fast.

A report is nine integers: first failure outside the grid and first one not finite, each substep x N + particle, and then
the largest values of -x, -y, -z, x, y, z over all particles, now and where their velocities take them within a frame
[m], and the largest speed [m/s], as the bits of float64 in an order that integers keep.
"""

import numpy as np
import warp as wp

from physreal_core.array_types import Array, Float, Int

COLUMNS = wp.constant(9)
FAILURES = wp.constant(2)  # the columns that hold failures
NOT_FAILED = wp.constant(wp.int64((1 << 63) - 1))
LEAST = wp.constant(wp.int64(-((1 << 63) - 1)))


@wp.func_native("""
    union { double number; long long bits; } word;
    word.number = value;
    long long key = word.bits < 0 ? word.bits ^ 0x7fffffffffffffffLL : word.bits;
    if (value != value) key = 0x7fffffffffffffffLL;
#if defined(__CUDA_ARCH__)
    unsigned mask = __activemask();
    int same = 0;
    __match_all_sync(mask, rollout, &same);
    if (mask == 0xffffffffu && same) {
        for (int step = 16; step > 0; step /= 2) {
            long long other = __shfl_xor_sync(mask, key, step);
            if (other > key) key = other;
        }
        if (threadIdx.x & 31) return;
    }
    atomicMax(reinterpret_cast<long long*>(report.data + n), key);
#else
    if (key > report.data[n]) report.data[n] = key;
#endif
""")
def raise_to(report: wp.array(dtype=wp.int64), n: int, rollout: int, value: wp.float64):
    """Entry n becomes `value` if it is larger or not a number; neighbours in a warp decide among themselves first."""


def bounds(report: Int[Array, "rollouts 9"]) -> Float[Array, "rollouts 7"]:
    """Lower and upper corner of the motion [m] and largest speed [m/s]."""
    keys = report[:, 2:]
    values = np.where(keys < 0, keys ^ np.int64((1 << 63) - 1), keys).view(np.float64)
    return np.concatenate([-values[:, :3], values[:, 3:]], axis=1)
