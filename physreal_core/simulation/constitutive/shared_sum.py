"""Adding all particles' shares of a few numbers that they have in common, such as the gradient of a network's weights.

On a GPU the 32 threads of a warp first sum among themselves: in each step two threads exchange half of what they hold, so
that N numbers cost about N shuffles and end in as many threads, which add them to neighbouring addresses at once.
"""

from functools import cache

import warp as wp

_ADD = """
    auto* to = target.data + row * target.shape[1] + column;
#if defined(__CUDA_ARCH__)
    const unsigned all = 0xffffffffu;
    if (__activemask() == all && __match_any_sync(all, row) == all) {{
        auto part = value;
        int lane = threadIdx.x & 31, first = 0, held = {count};
        bool writes = true;
        #pragma unroll
        for (int step = 16; step > 0; step /= 2) {{
            bool upper = lane & step;
            if (held % 2 == 0) {{
                held /= 2;
                #pragma unroll
                for (int i = 0; i < held; ++i) {{
                    auto given = upper ? part[i] : part[i + held];
                    auto kept = upper ? part[i + held] : part[i];
                    part[i] = kept + __shfl_xor_sync(all, given, step);
                }}
                first += upper ? held : 0;
            }} else {{
                #pragma unroll
                for (int i = 0; i < held; ++i) part[i] += __shfl_xor_sync(all, part[i], step);
                writes = writes && !upper;
            }}
        }}
        if (writes)
            for (int i = 0; i < held; ++i) atomicAdd(to + first + i, part[i]);
    }} else {{
        for (int i = 0; i < {count}; ++i) atomicAdd(to + i, value[i]);
    }}
#else
    for (int i = 0; i < {count}; ++i) to[i] += value[i];
#endif
"""


@cache
def shared_adder(Vector: type, scalar: type) -> wp.Function:
    """`add(target [rows, width], row, column, value)`: target[row, column:] += value, a `Vector`, from many particles.

    It pays where neighbouring particles add to the same row. Rows are contiguous.
    """

    @wp.func_native(_ADD.format(count=Vector._length_))
    def add_shared(target: wp.array2d(dtype=scalar), row: int, column: int, value: Vector):
        """target[row, column:] += value."""

    return add_shared
