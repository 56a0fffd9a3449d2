"""What the camera measured of the object: its points from masked depth; which simulated points it could have seen."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_erosion, maximum_filter, minimum_filter

from physreal_core.array_types import Array, Bool, Float


def lift_object(
    depth: Float[Array, "H W"],
    mask: Bool[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    *,
    edge: float = 0.02,
    margin: int = 1,
) -> Float[Array, "M 3"]:
    """World points [m] of the object's pixels that have a depth.

    Args:
        depth: along the camera's z [m], 0 = no reading.
        edge: pixels around which depth spreads by more are dropped: they mix two surfaces [m].
        margin: this many pixels along the mask's rim are dropped.
    """
    known = np.where(depth > 0, depth, np.inf)
    low, high = minimum_filter(known, 3), maximum_filter(depth, 3)
    good = mask & (depth > 0) & (high - low <= edge)
    if margin:
        good &= binary_erosion(mask, iterations=margin, border_value=0)
    v, u = np.nonzero(good)
    z = depth[v, u]
    local = np.stack([(u - K[0, 2]) / K[0, 0] * z, (v - K[1, 2]) / K[1, 1] * z, z], axis=1)
    return local @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]


def seen_points(
    points: Float[Array, "S 3"],
    spacing: float,
    hand: Bool[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
) -> Bool[Array, " S"]:
    """Which points of a closed, evenly sampled surface face the camera openly: inside the image, no other part of the
    surface before them, not behind the hand.

    A depth buffer whose cells are as wide as the points are apart decides: a point is hidden if another one in its cell
    or a neighbouring one is nearer by more than two spacings.

    Args:
        points: [m], world; spacing: distance between neighbouring points [m]; hand: the hand's pixels.
    """
    local = (points - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    z = local[:, 2]
    u, v = (K[i, i] * local[:, i] / np.maximum(z, 1e-6) + K[i, 2] for i in (0, 1))
    height, width = hand.shape
    pixel = np.rint(np.stack([v, u], axis=1)).clip(-1, [height, width]).astype(int)
    inside = (z > 0) & (pixel >= 0).all(axis=1) & (pixel < [height, width]).all(axis=1)
    cell_size = max(1.0, K[0, 0] * spacing / max(float(np.median(z)), 1e-6))
    cells = (pixel / cell_size).astype(int) + 1
    buffer = np.full((int(height / cell_size) + 3, int(width / cell_size) + 3), np.inf)
    np.minimum.at(buffer, (cells[inside, 0], cells[inside, 1]), z[inside])
    nearest = minimum_filter(buffer, 3)
    seen = inside.copy()
    seen[inside] &= z[inside] <= nearest[cells[inside, 0], cells[inside, 1]] + 2 * spacing
    seen[inside] &= ~hand[pixel[inside, 0], pixel[inside, 1]]
    return seen
