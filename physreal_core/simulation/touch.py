"""Where a body touches the ground when a frame begins: the columns of nodes in which contact acts next to the plane.

Nodes act on what is nearer than a cell and a half: those next to the plane would stop a falling body a cell above it, and those
a layer below them give under pressure like a cell of the same material. Therefore the former act where the body lies on the
plane already, and the latter (`box.CONTACT_DEPTH`) stop what falls. For a whole frame, because the adjoint takes which nodes
act as given.
"""

import functools

import warp as wp

from physreal_core.array_types import Array, Float, Int, Tensor, UInt8
from physreal_core.simulation.body import Body
from physreal_core.simulation.config import SimulationConfig
from physreal_core.simulation.scalars import kernel_module, scalar_types

REACH = 0.1
"""Cells by which the surface of a particle may lie above the plane and still touch it."""


@functools.cache
def touch_kernel(dtype: str) -> wp.Kernel:
    """Kernel over the particles of all rollouts, each with `columns` numbers to mark."""
    types = scalar_types(dtype)
    scalar, vec3 = types.scalar, types.vec3

    @wp.kernel(module=kernel_module("touch", dtype))
    def touch(
        particles: wp.int32,
        columns: wp.int32,
        highest: scalar,
        offset: vec3,
        cells_per_metre: scalar,
        box: wp.array2d(dtype=wp.int32),
        x: wp.array(dtype=vec3),
        # Data out:
        touching_out: wp.array(dtype=wp.uint8),
    ):
        p = wp.tid()
        rollout = p / particles
        if x[p][2] < highest:
            place = cells_per_metre * (x[p] - offset)
            i = int(wp.floor(place[0] - scalar(0.5))) - box[rollout, 0]
            j = int(wp.floor(place[1] - scalar(0.5))) - box[rollout, 1]
            for a in range(3):
                for b in range(3):
                    if i + a >= 0 and j + b >= 0 and i + a < box[rollout, 3] and j + b < box[rollout, 4]:
                        touching_out[rollout * columns + (i + a) * box[rollout, 4] + j + b] = wp.uint8(1)

    return touch


class Touch:
    """Marks the columns of one scene.

    Args:
        body: its particles are half a cell apart.
        config: of the simulator; without ground nothing is marked.
        offset: position of lattice node (0, 0, 0) [m].
    """

    def __init__(self, body: Body, config: SimulationConfig, offset: Float[Array, "3"]) -> None:
        self._types, self._device = scalar_types(config.dtype), config.device
        ground = config.ground_height
        self._highest = None if ground is None else ground + REACH * body.cell + 0.5 * body.spacing
        self._offset, self._cell = offset, body.cell

    def mark(
        self,
        x: Float[Tensor, "rollouts particles 3"],
        box: Int[Tensor, "rollouts 6"],
        out: UInt8[Tensor, "rollouts columns"],
    ) -> None:
        """Set `out` to 1 where a rollout's body touches the ground, to 0 elsewhere.

        Args:
            x: positions [m].
            box: origin and count of each rollout's nodes.
            out: column i, j of the box at i count_y + j.
        """
        if self._highest is None:
            return
        out.zero_()
        scalar, vec3 = self._types.scalar, self._types.vec3
        model = [x.shape[1], out.shape[1], scalar(self._highest), vec3(*self._offset), scalar(1.0 / self._cell)]
        arrays = [wp.from_torch(box), wp.from_torch(x.detach().reshape(-1, 3).contiguous(), vec3)]
        kernel = touch_kernel(self._types.name)
        wp.launch(kernel, x.shape[0] * x.shape[1], [*model, *arrays, wp.from_torch(out.view(-1))], device=self._device)
