"""Where a body touches the ground.

A particle touches it when it is as low as half the edge of its cube above the plane, or as low as it lies at rest; it comes to do so
within `NEARLY` spacings. A node touches as fully as the share of touching volume around it has of `TOUCHING`, and the plane takes that
part of what comes down. So forces change steadily where parts of the body come to touch. Every node decides for itself in every
substep.
"""

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.simulation.body import Body

TOUCHING = 0.4
"""Share of the volume around a node from which on it touches fully. Under a flat face, half a cell thick layers of particles give the
nodes half a cell below it a share of 0.9 and those half a cell above it 0.41; the lowest particles have 0.97 of their weight there."""
NEARLY = 0.05
"""Spacings within which a particle comes to touch."""


def touch_heights(body: Body, ground_height: float | None) -> Float[Array, " particles"]:
    """The height z below which each particle begins to touch the plane [m]; minus infinity without one.

    Args:
        body: at rest.
        ground_height: z of the plane [m], or None.
    """
    if ground_height is None:
        return np.full(len(body.x0), -np.inf)
    return ground_height + np.minimum(body.reach, body.x0[:, 2] - ground_height) + NEARLY * body.spacing
