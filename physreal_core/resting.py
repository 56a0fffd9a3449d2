"""The depth of a thing that lies on the support plane z = 0, from its silhouette: what a camera without depth can tell."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from physreal_core.array_types import Array, Bool, Float
from physreal_core.evidence import require_pixels

THICKNESS = 0.002
"""Of a cloth of which nothing is known [m]."""

LEVEL = 1e-3
"""Downward share of a sight line below which it counts as level, and never meets the plane."""


@dataclass(frozen=True)
class Resting:
    """What lies on the support plane z = 0 in frame 0.

    Attributes:
        geometry: linear, a rope; planar, a cloth; volumetric, a body that is thick everywhere.
        thickness: of the cloth, or the rope's diameter [m]; None where nobody knows.
    """

    geometry: Literal["linear", "planar", "volumetric"]
    thickness: float | None = None

    def depth(
        self, mask: Bool[Array, "H W"], K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"]
    ) -> Float[Array, "H W"]:
        """`resting_depth` of its mask in frame 0 [m]."""
        return resting_depth(mask, K, T_world_camera, self.geometry, self.thickness)


def resting_depth(
    mask: Bool[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    geometry: Literal["linear", "planar", "volumetric"],
    thickness: float | None = None,
) -> Float[Array, "H W"]:
    """Depth along the camera's z [m] of the side that is seen; zero off the thing.

    A cloth's upper side is a thickness above the plane. Any other thing is taken as balls that lie on the plane side by side, one around each
    pixel of the silhouette's skeleton, as wide as the silhouette is there.

    Args:
        mask: pixels that show it.
        K, T_world_camera: intrinsics [px], camera to world.
        geometry: linear, a rope; planar, a cloth; volumetric, a body that is thick everywhere.
        thickness: of the cloth, or the rope's diameter [m]; None: `THICKNESS`, or as wide as the silhouette.

    Raises:
        InputError: too little of it lies below the horizon.
    """
    rays, below = _below_the_horizon(mask, K, T_world_camera)
    if geometry == "planar":
        height = THICKNESS if thickness is None else thickness
        return np.where(below, (height - T_world_camera[2, 3]) / np.where(below, rays[..., 2], -1.0), 0.0)
    centres, radii = resting_balls(mask, K, T_world_camera, thickness)
    depth = np.zeros(mask.shape)
    depth[below] = _nearest(rays[below], centres - T_world_camera[:3, 3], radii)
    return _filled(depth, below)


def resting_balls(
    mask: Bool[Array, "H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    thickness: float | None = None,
) -> tuple[Float[Array, "balls 3"], Float[Array, " balls"]]:
    """Centres in the world and radii [m] of balls on the plane whose outlines fill the mask.

    Args:
        mask, K, T_world_camera: as of `resting_depth`.
        thickness: diameter of all [m]; None: as wide as the silhouette.

    Raises:
        InputError: as of `resting_depth`.
    """
    from scipy import ndimage
    from skimage.morphology import skeletonize

    rays, below = _below_the_horizon(mask, K, T_world_camera)
    middle = skeletonize(below)
    # from the middle of a pixel to the border of the last one
    half = ndimage.distance_transform_edt(below)[middle] - 0.5
    ray, eye = rays[middle], T_world_camera[:3, 3]
    if thickness is None:
        # a radius of half / f per metre of depth, at which the ball is as high as its radius
        depth = eye[2] / (half / K[0, 0] - ray[:, 2])
        radius = half / K[0, 0] * depth
    else:
        radius = np.full(len(ray), thickness / 2.0)
        depth = (eye[2] - radius) / -ray[:, 2]
    return eye + depth[:, None] * ray, radius


def _below_the_horizon(
    mask: Array, K: Array, T_world_camera: Array
) -> tuple[Float[Array, "H W 3"], Bool[Array, "H W"]]:
    """Sight lines of all pixels in the world, one metre along the camera's z, and those pixels of the mask whose lines meet the plane."""
    v, u = np.indices(mask.shape)
    local = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones(mask.shape)], -1)
    rays = local @ T_world_camera[:3, :3].T
    below = mask & (rays[..., 2] < -LEVEL)
    remedy = "check T_world_camera in capture.json, and the mask; or record depth"
    require_pixels(int(below.sum()), "the part of the object's mask below the horizon", "frame 0", remedy)
    return rays, below


def _nearest(rays: Array, centres: Float[Array, "balls 3"], radii: Float[Array, " balls"]) -> Float[Array, " rays"]:
    """Depth at which each ray first meets a ball, zero where it meets none; centres as seen from the eye."""
    depth = np.full(len(rays), np.inf)
    square, outside = (rays**2).sum(1), (centres**2).sum(1) - radii**2
    for part in np.array_split(np.arange(len(centres)), max(1, len(centres) // 64)):
        along = rays @ centres[part].T
        left = along**2 - square[:, None] * outside[part]
        met = np.where(left >= 0.0, along - np.sqrt(np.maximum(left, 0.0)), np.inf) / square[:, None]
        depth = np.minimum(depth, met.min(1))
    return np.where(np.isfinite(depth), depth, 0.0)


def _filled(depth: Float[Array, "H W"], mask: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """With the nearest pixel's depth where the mask goes beyond the balls, by rounding."""
    from scipy import ndimage

    at = ndimage.distance_transform_edt(depth == 0, return_distances=False, return_indices=True)
    return np.where(mask, depth[tuple(at)], 0.0)
