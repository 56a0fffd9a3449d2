"""What a camera did not see of a body: of each particle, how far behind the seen surface it lies."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial import cKDTree

from physreal_core.array_types import Array, Float
from physreal_core.rendering import Camera


def unseen_share(x0: Float[Array, "particles 3"], spacing: float, camera: Camera) -> Float[Array, " particles"]:
    """0 for particles at the surface that the camera sees, 1 for those at the far side, linear in depth between them.

    A line of sight meets the particles whose lines pass within `spacing` [m]; a body of one layer along it is seen.

    Args:
        x0: particles in the world at the frame that was seen [m].
        spacing: mean distance between neighbours [m].
        camera: whose view it is.
    """
    local = camera.to_camera(torch.from_numpy(np.asarray(x0, dtype=np.float64))).numpy()
    depth = local[:, 2]
    aside = local[:, :2] / depth[:, None] * np.median(depth)
    near = cKDTree(aside).query_ball_point(aside, spacing)
    front = np.array([depth[own].min() for own in near])
    back = np.array([depth[own].max() for own in near])
    return (depth - front) / np.maximum(back - front, spacing)
