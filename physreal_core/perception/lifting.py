"""Tracks lifted to 3D: depth read off around the pixel, refused at depth edges, unlikely jumps taken out (world frame)."""

from dataclasses import dataclass

import numpy as np

from physreal_core.array_types import Array, Bool, Float


@dataclass(frozen=True)
class DepthNoise:
    """Standard deviation of a depth reading: constant + quadratic * z^2 [m], and of a track's pixel [px]."""

    constant: float = 0.001
    quadratic: float = 0.0015
    pixel: float = 0.3


@dataclass(frozen=True)
class LiftedTracks:
    """points [T, J, 3] m world (NaN: unknown), valid [T, J], sigma [T, J] m (standard deviation of a point)."""

    points: Float[Array, "T J 3"]
    valid: Bool[Array, "T J"]
    sigma: Float[Array, "T J"]


def lift_tracks(
    points: Float[Array, "T J 2"],
    visible: Bool[Array, "T J"],
    depth: Float[Array, "T H W"],
    K: Float[Array, "3 3"],
    T_world_camera: Float[Array, "4 4"],
    *,
    max_edge: float = 0.02,
    max_stray: float = 0.02,
    neighbours: int = 12,
    noise: DepthNoise | None = None,
) -> LiftedTracks:
    """Lift visible tracks with measured depth.

    Args:
        points, visible: tracks (u, v) [px].
        depth: depth along the camera's z [m], 0 = no reading.
        K, T_world_camera: intrinsics [px], camera to world.
        max_edge: a spread of depth around the pixel above this is an edge [m].
        max_stray: a point whose displacement since frame 0 differs by more from the median of its neighbours' is
            dropped [m]; the allowance grows with how much those differ among themselves.
        neighbours: how many those are.
        noise: depth noise; sigma = sqrt((constant + quadratic z^2)^2 + 2 (pixel z / f)^2).

    Returns:
        World points; invalid ones are NaN, never filled.
    """
    noise = noise or DepthNoise()
    z = np.stack([depth_at(d, p, max_edge) for d, p in zip(depth, points, strict=True)])
    valid = visible & (z > 0)
    camera = (
        np.concatenate([(points - K[:2, 2]) / K[[0, 1], [0, 1]], np.ones((*points.shape[:2], 1))], -1) * z[..., None]
    )
    world = camera @ T_world_camera[:3, :3].T + T_world_camera[:3, 3]
    valid &= ~strays(world, valid, max_stray, neighbours)
    sigma = np.hypot(noise.constant + noise.quadratic * z**2, np.sqrt(2) * noise.pixel * z / np.sqrt(K[0, 0] * K[1, 1]))
    return LiftedTracks(
        np.where(valid[..., None], world, np.nan).astype(np.float32),
        valid,
        np.where(valid, sigma, np.nan).astype(np.float32),
    )


def project(
    points: Float[Array, "T J 3"], K: Float[Array, "3 3"], T_world_camera: Float[Array, "4 4"]
) -> Float[Array, "T J 2"]:
    """Pixels (u, v) [px] of world points [m]; NaN stays NaN."""
    camera = (points - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    return (camera[..., :2] / camera[..., 2:] * K[[0, 1], [0, 1]] + K[:2, 2]).astype(np.float32)


def depth_at(depth: Float[Array, "H W"], points: Float[Array, "J 2"], max_edge: float) -> Float[Array, " J"]:
    """Depth [m] at pixels (u, v): a plane through the 3 x 3 readings around, 0 where it cannot be told.

    Unknown: the nearest pixel or more than three of the nine have no reading, or their spread is above max_edge [m].
    """
    height, width = depth.shape
    pixel = np.rint(np.nan_to_num(points)).astype(int)
    inside = ((pixel >= 1) & (pixel <= np.array([width - 2, height - 2]))).all(-1) & np.isfinite(points).all(-1)
    pixel = np.where(inside[:, None], pixel, 1)
    dv, du = (o.ravel() - 1 for o in np.indices((3, 3)))
    window = depth[pixel[:, 1, None] + dv, pixel[:, 0, None] + du].astype(np.float64)  # [J, 9]
    known = window > 0
    spread = np.where(known, window, -np.inf).max(1) - np.where(known, window, np.inf).min(1)
    good = inside & known[:, 4] & (known.sum(1) >= 6) & (spread <= max_edge)
    known = known | ~good[:, None]  # keeps the fit below regular where its answer is not used
    ones = np.stack([np.ones(9), du, dv], -1)
    normal = np.einsum("ji,ia,ib->jab", known.astype(float), ones, ones)
    plane = np.linalg.solve(normal, np.einsum("ji,ia->ja", known * window, ones)[..., None])[..., 0]
    offset = np.where(inside[:, None], points - pixel, 0)
    return np.where(good, plane[:, 0] + (plane[:, 1:] * offset).sum(1), 0.0)


def strays(
    world: Float[Array, "T J 3"], valid: Bool[Array, "T J"], max_stray: float, neighbours: int
) -> Bool[Array, "T J"]:
    """Points whose displacement since frame 0 is unlike that of the nearest ones that are seen too: occluded, lost or misread depth."""
    from scipy.spatial import cKDTree

    out = np.zeros_like(valid)
    for t in range(1, len(world)):
        both = np.flatnonzero(valid[0] & valid[t])
        if len(both) < 4:
            continue
        start = world[0, both]
        _, near = cKDTree(start).query(start, k=min(neighbours + 1, len(both)))
        moved = world[t, both] - start
        around = moved[near[:, 1:]]
        middle = np.median(around, axis=1)
        spread = np.median(np.linalg.norm(around - middle[:, None], axis=-1), axis=1)
        out[t, both] = np.linalg.norm(moved - middle, axis=-1) > max_stray + 2.0 * spread
    return out
