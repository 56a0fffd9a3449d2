"""Quadratic B-spline weights on the world-fixed lattice of grid nodes, as Warp functions shared by the transfers.

A node (i, j, k) stands at offset + dx (i, j, k), in the world, whatever box of nodes is stored. `box` is a device array
[origin i, j, k, count x, y, z] of the stored nodes, so that a frame's box can move without a new launch or graph.
"""

import functools
from types import SimpleNamespace

import warp as wp

from physreal_core.simulation.scalars import scalar_types


@functools.cache
def lattice_functions(dtype: str) -> SimpleNamespace:
    """Warp functions `relative`, `inside`, `base_cell`, `fraction`, `weights`, `weight_slopes`, `node`."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3
    half, one, three_halves, three_quarters, two = (scalar(c) for c in (0.5, 1.0, 1.5, 0.75, 2.0))

    @wp.func
    def relative(x: vec3, offset: vec3, cells_per_metre: scalar, box: wp.array(dtype=wp.int32)):
        """Position in cells from the box's first node."""
        return (x - offset) * cells_per_metre - vec3(scalar(box[0]), scalar(box[1]), scalar(box[2]))

    @wp.func
    def inside(r: vec3, box: wp.array(dtype=wp.int32)):
        """Whether all 27 nodes of a position are stored; false for a position that is not a number."""
        return (
            r[0] >= half
            and r[1] >= half
            and r[2] >= half
            and r[0] < scalar(box[3]) - three_halves
            and r[1] < scalar(box[4]) - three_halves
            and r[2] < scalar(box[5]) - three_halves
        )

    @wp.func
    def base_cell(r: vec3):
        """First of the three nodes that a position touches along each axis."""
        return wp.vec3i(int(r[0] - half), int(r[1] - half), int(r[2] - half))

    @wp.func
    def fraction(r: vec3, base: wp.vec3i):
        """Distance in cells from the base node, in [1/2, 3/2) per axis."""
        return vec3(r[0] - scalar(base[0]), r[1] - scalar(base[1]), r[2] - scalar(base[2]))

    @wp.func
    def node(base: wp.vec3i, box: wp.array(dtype=wp.int32)):
        """Storage index of a node of the box; z runs fastest."""
        return (base[0] * box[4] + base[1]) * box[5] + base[2]

    @wp.func
    def weights(f: vec3):
        """Row o, column d: weight of node base + o along axis d."""
        a = vec3(three_halves, three_halves, three_halves) - f
        b = f - vec3(one, one, one)
        c = f - vec3(half, half, half)
        middle = vec3(three_quarters, three_quarters, three_quarters) - wp.cw_mul(b, b)
        return wp.matrix_from_rows(half * wp.cw_mul(a, a), middle, half * wp.cw_mul(c, c))

    @wp.func
    def weight_slopes(f: vec3):
        """Derivatives of `weights` by f."""
        return wp.matrix_from_rows(
            f - vec3(three_halves, three_halves, three_halves),
            -two * (f - vec3(one, one, one)),
            f - vec3(half, half, half),
        )

    return SimpleNamespace(
        relative=relative,
        inside=inside,
        base_cell=base_cell,
        fraction=fraction,
        node=node,
        weights=weights,
        weight_slopes=weight_slopes,
    )
