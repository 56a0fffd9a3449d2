"""What lies flat on the support plane z = 0 is not part of a thing that stands on it: its shadow, table beside it.

A segmenter that sees colours alone takes a hard shadow for a part of what casts it; depth tells them apart.
"""

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.perception.lifting import DepthNoise

SURE = 3.0
"""Standard deviations of a depth reading's error within which a point may lie on the plane."""
FLAT = 0.5
"""Share of a thing's readings within that margin from which on the thing itself lies flat, as a cloth does."""


def heights(
    depth: Float[Array, "H W"], K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"]
) -> Float[Array, "H W"]:
    """World z [m] of every pixel's reading, NaN where there is none."""
    v, u = np.indices(depth.shape)
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(depth.shape)], -1)
    z = (rays * depth[..., None]) @ T_world_camera[2, :3] + T_world_camera[2, 3]
    return np.where(depth > 0, z, np.nan)


def without_support(
    mask: Bool[Array, "H W"],
    depth: Float[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    noise: DepthNoise,
) -> Bool[Array, "H W"]:
    """A mask without the pixels on the support plane that are away from all of the thing that stands above it.

    Pixels as near to what stands above the plane as its own foot may be stay, and so do those without a reading. A mask of
    which nothing stands above the plane is left as it is: something as thin as the depth's noise.

    Args:
        mask: of one thing.
        depth: of the frame [m], 0 = no reading.
        K, T_world_camera: intrinsics [px], camera to world.
        noise: of a depth reading.
    """
    import cv2

    height, known = heights(depth, K, T_world_camera), mask & (depth > 0)
    if not known.any():
        return mask
    far = float(np.median(depth[known]))
    margin = _margin(far, noise)
    risen = known & (height > margin)
    if not risen.any():
        return mask
    foot = 1.0 + margin * K[1, 1] / far  # pixels that what is within the margin of the plane may span at most
    distance = cv2.distanceTransform((~risen).astype(np.uint8), cv2.DIST_L2, 5)
    flat = known & (np.abs(height) <= margin) & (distance > foot)
    return mask & ~flat


def lies_flat(
    mask: Bool[Array, "H W"],
    depth: Float[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    noise: DepthNoise,
) -> bool:
    """Whether a thing lies flat on the support plane, so that depth does not tell it from what it lies on; arguments as of `without_support`."""
    known = mask & (depth > 0)
    if not known.any():
        return False
    margin = _margin(float(np.median(depth[known])), noise)
    return bool((heights(depth, K, T_world_camera)[known] <= margin).mean() >= FLAT)


def _margin(far: float, noise: DepthNoise) -> float:
    """Height within which a point at this distance may lie on the plane [m]."""
    return SURE * (noise.constant + noise.quadratic * far**2)
